"""Local fairing as a JAX function: types, batches, traces, gradients, NaN and flat data.

Every shape and setting is another program, and those in 3-D compile long: they are `slow`.
"""

import cases
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import twin
from helpers import assert_close, matrix_products, net_of, samples_of

import contourfair_jax as cf
from contourfair_jax._support.xla import apart

BOTH = pytest.mark.both_precisions
IN_2D_AND_SLOWLY_3D = pytest.mark.parametrize("ndim", [2, pytest.param(3, marks=pytest.mark.slow)])


# Types, batches and traces ---------------------------------------------------------------


@BOTH
@pytest.mark.parametrize("dtype", ["float32", "float64", "int16", "int32", "uint8", "bool"])
def test_dtypes(dtype, x64):
    if dtype == "float64" and not x64:
        pytest.skip("float64 needs JAX_ENABLE_X64=1")
    values = (np.arange(30).reshape(6, 5) * 7 % 11 % 5).astype(dtype)
    default = "float64" if x64 else "float32"
    field = cf.fair_field(values)
    expected = dtype if dtype.startswith("float") else default
    assert {str(x.dtype) for x in field.jet(np.array([1.2, 3.4]))} == {expected}
    reference = net_of(values.astype(expected))
    np.testing.assert_array_equal(field.control_points, reference)


@IN_2D_AND_SLOWLY_3D
def test_float32_is_close_to_float64(ndim):
    for grid in cases.GRIDS[ndim]:
        for name in ("ridge", "disk", "smooth_random"):
            samples = samples_of(name, grid)
            ours = net_of(samples.astype(np.float32), grid.spacing)
            assert_close(ours, net_of(samples, grid.spacing), 2e-4)


@pytest.mark.requires_x64
@pytest.mark.parametrize("ratio", [0.1, 10.0, 100.0])
def test_float32_holds_in_stretched_cells(ratio):
    """Slices far apart, or axes in different units."""
    grid = cases.GRIDS[2][0]
    for name in ("disk", "cone", "quadratic", "smooth_random"):
        samples = np.float32(samples_of(name, grid))
        ours, expected = (net_of(v, (1.0, ratio)) for v in (samples, np.float64(samples)))
        assert_close(ours, expected, 2e-3)


def test_wider_settings_do_not_widen_the_field():
    values = np.float32(np.arange(30).reshape(6, 5) * 7 % 11)
    method = cf.LocalFairing(thin_plate_weight=jnp.asarray(0.02, np.float64))
    field = cf.fair_field(values, spacing=np.float64([1, 1]), origin=np.zeros(2), method=method)
    assert field.dtype == field(np.ones(2)).dtype == np.float32
    assert_close(field.control_points, net_of(values), 1e-4)


@BOTH
def test_float64_without_x64_warns(x64):
    values = np.zeros((6, 5))
    if x64:
        assert cf.fair_field(values).dtype == np.float64
    else:
        with pytest.warns(UserWarning, match=r"values is float64 .* float32"):
            assert cf.fair_field(values).dtype == np.float32


@BOTH
@IN_2D_AND_SLOWLY_3D
def test_batches_through_vmap(ndim, rng, x64):
    grid = cases.GRIDS[ndim][1]
    dtype = np.float64 if x64 else np.float32
    batch = jnp.asarray(rng.normal(size=(2, 3, *grid.shape)), dtype)

    def fair(values):
        return cf.fair_field(values, spacing=grid.spacing)

    fields = jax.vmap(jax.vmap(fair))(batch)
    for index in np.ndindex(2, 3):
        one = fair(batch[index]).control_points
        assert_close(fields.control_points[index], one, 1e-12 if x64 else 1e-5)


@BOTH
def test_jit_changes_nothing(rng, x64):
    values = jnp.asarray(rng.normal(size=(6, 5)), np.float64 if x64 else np.float32)
    jitted = jax.jit(cf.fair_field)(values)
    assert_close(jitted.control_points, net_of(values), 1e-12 if x64 else 1e-5)


@pytest.fixture
def events():
    """Names of the tracing and compilation events since the list was last cleared."""
    seen = []

    def listen(event, duration, **_):
        if event.startswith("/jax/core/compile/"):
            seen.append(event)

    jax.monitoring.register_event_duration_secs_listener(listen)
    yield seen
    jax.monitoring.unregister_event_duration_listener(listen)


def test_one_trace_per_shape(events, rng):
    def fair(shape, weight=0.02, spacing=1.0):
        method = cf.LocalFairing(thin_plate_weight=weight, iterations=0)
        events.clear()
        field = cf.fair_field(rng.normal(size=shape), spacing=spacing, method=method)
        jax.block_until_ready(field)
        return len(events)

    assert fair((3, 4)) > 0
    assert fair((3, 4)) == 0
    assert fair((3, 4), weight=0.05) == 0
    assert fair((3, 4), spacing=2.0) == 0
    assert fair((4, 4)) > 0
    assert fair((3, 4)) == fair((4, 4)) == 0


# Degenerate data -------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize(
    ("shape", "where"),
    [
        ((9, 10), (4, 5)),
        ((9, 10), (0, 7)),
        pytest.param((6, 7, 5), (3, 3, 2), marks=pytest.mark.slow),
        pytest.param((6, 7, 5), (5, 0, 3), marks=pytest.mark.slow),
    ],
)
def test_one_nan_stays_within_the_cells_it_touches(shape, where, rng, x64):
    """A NaN at vertex v reaches the vertices v-1..v+1 and so the cells v-2..v+1 of every axis."""
    values = rng.normal(size=shape).astype(np.float64 if x64 else np.float32)
    clean = net_of(values)
    values[where] = np.nan
    net = net_of(values)
    assert np.isnan(net[tuple(3 * v for v in where)])

    # Net points strictly between the first and last face, and on the border where cells end there.
    touched = [
        slice(3 * (v - 2) + 1 if v > 2 else 0, 3 * (v + 2) if v + 2 < n - 1 else None)
        for v, n in zip(where, shape, strict=True)
    ]
    outside = np.ones(net.shape, bool)
    outside[tuple(touched)] = False
    assert outside.any()
    np.testing.assert_allclose(net[outside], clean[outside], rtol=1e-6 if x64 else 1e-3, atol=0)


@eqx.filter_jit
@eqx.filter_grad
def gradients(arguments, weights):
    """Of a weighted sum over the net, in the samples, the settings and the spacing."""
    samples, method, spacing = arguments
    field = cf.fair_field(samples, spacing=spacing, method=method)
    return jnp.sum(weights * field.control_points)


def gradients_at(samples, grid, weights):
    method = cf.LocalFairing(thin_plate_weight=jnp.asarray(0.02, samples.dtype), iterations=2)
    spacing = jnp.asarray(grid.spacing, samples.dtype)
    return gradients((jnp.asarray(samples), method, spacing), jnp.asarray(weights, samples.dtype))


def weights_on(grid, rng):
    return rng.normal(size=[3 * (n - 1) + 1 for n in grid.shape])


@pytest.mark.slow
@BOTH
@pytest.mark.parametrize("ndim", [2, 3])
def test_gradients_are_finite(ndim, rng, x64):
    """In the samples, the weight and the spacing, on every field, flat ones included."""
    grid = cases.GRIDS[ndim][1]
    weights = weights_on(grid, rng)
    for name in cases.field_cases(ndim):
        samples = samples_of(name, grid).astype(np.float64 if x64 else np.float32)
        leaves = jax.tree.leaves(gradients_at(samples, grid, weights))
        assert len(leaves) == 3
        assert all(bool(jnp.isfinite(leaf).all()) for leaf in leaves), name
        assert float(jnp.abs(leaves[0]).max()) > 0


@IN_2D_AND_SLOWLY_3D
def test_gradients_equal_differences_of_the_twin(ndim, rng):
    grid = cases.GRIDS[ndim][1]
    samples, weights = samples_of("smooth_random", grid), weights_on(grid, rng)
    direction, stretch = rng.normal(size=grid.shape), rng.normal(size=ndim)
    in_samples, in_method, in_spacing = gradients_at(samples, grid, weights)

    def of_twin(t, along):
        moved = {"samples": samples, "spacing": np.array(grid.spacing), "weight": 0.02}
        moved[along] = moved[along] + t * {"samples": direction, "spacing": stretch}.get(along, 1)
        net = twin.fair_net(moved["samples"], moved["spacing"], moved["weight"], iterations=2)
        return np.sum(weights * net)

    def difference(along):
        return (of_twin(1e-5, along) - of_twin(-1e-5, along)) / 2e-5

    assert np.sum(np.asarray(in_samples) * direction) == pytest.approx(
        difference("samples"), rel=1e-5
    )
    assert np.sum(np.asarray(in_spacing) * stretch) == pytest.approx(
        difference("spacing"), rel=1e-5
    )
    weight = float(in_method.thin_plate_weight)
    assert weight == pytest.approx(difference("weight"), rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(6, 5), (4, 3, 4)])
@pytest.mark.parametrize(
    "method",
    [
        cf.LocalFairing(iterations=1),
        cf.GlobalFairing(iterations=1, norm=1.5, sigma=0.1, coarse_grids=True),
    ],
    ids=["local", "global"],
)
def test_products_keep_float32(method, shape):
    """No product of matrices that a GPU may round to ten bits, forward or backward."""

    def everything(values, points):
        field = cf.fair_field(values, method=method)
        return sum(x.sum() for x in (*field.jet(points), field.refine(2)))

    values = jax.ShapeDtypeStruct(shape, jnp.float32)
    points = jax.ShapeDtypeStruct((3, len(shape)), jnp.float32)
    products = matrix_products(jax.value_and_grad(everything), values, points)
    assert len(products) > 5
    assert all("precision = [HIGHEST, HIGHEST]" in line for line in products)


# What XLA compiles -----------------------------------------------------------------------


@pytest.mark.skipif(jax.default_backend() != "cpu", reason="units are kept apart on the CPU only")
def test_units_are_kept_apart(rng):
    """`apart` stops XLA from fusing; values, derivatives and batches are those of the function."""
    values = rng.normal(size=(4, 5))

    def step(x):
        return jnp.where(x > 0, jnp.sin(x), x * x)  # `where` is a function of its own as well

    def twice(function):
        return jax.jit(lambda x: function(function(x)))

    plain, units = twice(step), twice(apart(step))
    assert units.lower(values).compile().as_text().count(" call(") == 2
    assert " call(" not in plain.lower(values).compile().as_text()
    slope, expected = (jax.grad(lambda x, f=f: f(x).sum())(values) for f in (units, plain))
    assert_close(units(values), plain(values), 1e-15)
    assert_close(jax.vmap(units)(values), plain(values), 1e-15)
    assert_close(slope, expected, 1e-14)
