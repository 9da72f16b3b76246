"""The layer: batches, derivatives, learned settings, one trace per shape."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import splines
from shape_checks import refused

import contourfair_jax as cf

BOTH = pytest.mark.both_precisions
METHOD = splines.CatmullRom()


@BOTH
def test_every_image_of_a_batch_is_faired_on_its_own():
    x = np.random.default_rng(0).normal(size=(2, 3, 5, 4)).astype("float32")
    fine = cf.FairUpsample(3, method=METHOD)(x)
    assert fine.shape == (2, 3, 13, 10)
    assert fine.dtype == jnp.float32
    np.testing.assert_array_equal(fine[..., ::3, ::3], x)
    alone = cf.fair_field(x[1, 2], method=METHOD).refine(3)
    np.testing.assert_allclose(fine[1, 2], alone, atol=1e-5)


def test_volumes_and_single_images():
    layer = cf.FairUpsample(2, ndim=3, method=METHOD)
    assert layer(jnp.zeros((6, 4, 3, 5))).shape == (6, 7, 5, 9)
    assert layer(jnp.zeros((4, 3, 5))).shape == (7, 5, 9)
    assert cf.FairUpsample(1, method=METHOD)(jnp.zeros((0, 4, 3))).shape == (0, 4, 3)


@pytest.mark.slow
def test_spacing_is_part_of_the_energy():
    x = jnp.asarray(np.random.default_rng(3).normal(size=(2, 5, 6)))
    layer = cf.FairUpsample(2, spacing=[1.0, 2.5])
    alone = cf.fair_field(x[1], spacing=(1.0, 2.5)).refine(2)
    np.testing.assert_allclose(layer(x)[1], alone, atol=1e-12)
    assert float(jnp.abs(cf.FairUpsample(2)(x)[1] - alone).max()) > 1e-3
    assert hash(layer.spacing)
    with pytest.raises(ValueError, match="spacing must be"):
        cf.FairUpsample(2, spacing=(1.0, 2.0, 3.0))
    with pytest.raises(ValueError, match="spacing must be finite and above zero"):
        cf.FairUpsample(2, spacing=-1.0)


def test_in_a_network_of_equinox():
    """Gradients reach the layers before it, and it adds no parameters."""
    convolution = eqx.nn.Conv2d(1, 2, 3, padding=1, key=jax.random.key(0))
    network = eqx.nn.Sequential([convolution, cf.FairUpsample(2, method=METHOD)])
    x = jnp.asarray(np.random.default_rng(1).normal(size=(1, 6, 6)))

    @eqx.filter_grad
    def slope(network):
        return jnp.sum(network(x, key=jax.random.key(1)) ** 2)

    found = jax.tree.leaves(slope(network))
    expected = jax.tree.leaves(eqx.filter(network, eqx.is_inexact_array))
    assert [leaf.shape for leaf in found] == [leaf.shape for leaf in expected]
    assert all(np.abs(leaf).max() > 0 for leaf in found)


@pytest.mark.slow
def test_settings_given_as_arrays_are_learned():
    layer = cf.FairUpsample(2, method=cf.LocalFairing(thin_plate_weight=jnp.asarray(0.05)))
    x = jnp.asarray(np.random.default_rng(2).normal(size=(5, 5)))

    def loss(layer):
        return jnp.sum(layer(x) ** 2)

    found = eqx.filter_grad(loss)(layer).method.thin_plate_weight

    def at(weight):
        return float(loss(eqx.tree_at(lambda t: t.method.thin_plate_weight, layer, weight)))

    step = 1e-5
    expected = (at(jnp.asarray(0.05 + step)) - at(jnp.asarray(0.05 - step))) / (2 * step)
    assert float(found) == pytest.approx(expected, rel=1e-5)


def test_each_shape_is_traced_once():
    traces = []

    class Counted(splines.CatmullRom):
        def fit(self, values, spacing):
            traces.append(values.shape)
            return super().fit(values, spacing)

    layer = cf.FairUpsample(2, method=Counted())
    for _ in range(3):
        for shape in ((2, 5, 6), (2, 4, 4), (3, 5, 6)):
            layer(jnp.ones(shape))
    # The size of the batch is another shape to the layer, though not to the fit.
    assert len(traces) <= 3
    assert set(traces) == {(5, 6), (4, 4)}


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: cf.FairUpsample(0), r"^factor must be an integer that is at least 1"),
        (lambda: cf.FairUpsample(2.0), r"^factor must be an integer"),
        (
            lambda: cf.FairUpsample((2, 3), ndim=3),
            r"^factor must be one integer or 3, one per axis",
        ),
        (lambda: cf.FairUpsample(2, ndim=4), r"^ndim must be one of 2, 3, got 4"),
        (lambda: cf.FairUpsample(2, method="local"), r"^method must be an object such as"),
        (lambda: cf.FairUpsample(2)(jnp.zeros(5)), r"^x must have at least 2 axes"),
        (lambda: cf.FairUpsample(2)(jnp.zeros((4, 2, 5))), r"at least 3 samples along every axis"),
    ],
)
def test_bad_input(make, message):
    with refused(ValueError, match=message):
        make()
