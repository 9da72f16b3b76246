"""Coarse grids: refined fields are the same fields; supports within holes, against loops."""

import jax.numpy as jnp
import numpy as np
import pytest

from contourfair_jax._fairing.global_fairing import coarse_grids
from contourfair_jax._fairing.global_fairing.cell_form import energy_form
from contourfair_jax._fairing.global_fairing.hermite import to_net


def halves_of(net):
    """The net on half the spacing along the last axis, by de Casteljau."""
    parts = []
    for k in range(0, net.shape[-1] - 1, 3):
        p = net[..., k : k + 4]
        q = (p[..., 1:] + p[..., :-1]) / 2
        r = (q[..., 1:] + q[..., :-1]) / 2
        s = (r[..., 1:] + r[..., :-1]) / 2
        pieces = [p[..., :1], q[..., :1], r[..., :1], s, r[..., 1:], q[..., 2:]]
        parts += pieces
    return np.concatenate([*parts, net[..., -1:]], axis=-1)


@pytest.mark.parametrize(
    ("coarse", "fine"), [((3, 2), (5, 3)), ((3, 3), (4, 5)), ((2, 3, 2), (3, 5, 3))]
)
def test_a_refined_field_is_the_same_field(coarse, fine, rng):
    ndim = len(coarse)
    grid = rng.normal(size=(2,) * ndim + coarse)
    ours = coarse_grids._prolong(jnp.asarray(grid), fine)
    found = np.asarray(to_net(ours.reshape(2**ndim, -1), fine))
    net = np.asarray(to_net(jnp.asarray(grid.reshape(2**ndim, -1)), coarse))
    for axis in range(ndim):
        net = np.moveaxis(halves_of(np.moveaxis(net, axis, -1)), -1, axis)
    expected = net[tuple(slice(3 * n - 2) for n in fine)]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def supports(missing, coarse):
    """Which coarse vertices have all fine vertices beside them missing; none is beyond the grid."""
    padded = np.pad(missing, 3, constant_values=True)
    found = np.empty(coarse, bool)
    for vertex in np.ndindex(*coarse):
        found[vertex] = padded[tuple(slice(2 * k + 2, 2 * k + 5) for k in vertex)].all()
    return found


@pytest.mark.parametrize("shape", [(7, 6), (5, 6, 4)])
def test_functions_within_holes(shape, rng):
    coarse = tuple(n // 2 + 1 for n in shape)
    for part in (0.02, 0.1, 0.5):
        missing = rng.uniform(size=shape) > part
        ours = coarse_grids._supports(jnp.asarray(missing), coarse)
        np.testing.assert_array_equal(ours, supports(missing, coarse))


def test_wide_holes_are_three_samples_wide():
    missing = np.zeros((7, 8), bool)
    missing[2:5, 3:5] = True
    assert not coarse_grids.has_wide_holes(missing)
    missing[2:5, 5] = True
    assert coarse_grids.has_wide_holes(missing)
    border = np.zeros((7, 8), bool)
    border[:2, :2] = True
    assert coarse_grids.has_wide_holes(border)
    border[0, 0] = False
    assert not coarse_grids.has_wide_holes(border)


@pytest.mark.parametrize("ndim", [2, 3])
def test_inverse_of_a_vertex_with_cells_all_around(ndim):
    """The block of the middle vertex of the whole matrix of 3^d vertices."""
    shape, twos = (3,) * ndim, 2**ndim
    form = energy_form(jnp.linspace(1.0, 1.5, ndim), shape)
    weights = np.zeros((len(form.matrices), *shape))
    for g, (a, b) in enumerate(coarse_grids._pairs(ndim)):
        weights[(g, *(slice(2),) * ndim)] = float(a == b)
    middle = 3**ndim // 2
    columns = []
    for k in range(twos):
        unit = np.zeros((twos, 3**ndim))
        unit[k, middle] = 1
        forces = form.apply(jnp.asarray(weights.reshape(len(weights), -1)), jnp.asarray(unit))
        columns.append(np.asarray(forces)[:, middle])
    expected = np.linalg.inv(np.stack(columns, axis=1))
    np.testing.assert_allclose(
        coarse_grids._interior_inverse(form), expected, rtol=1e-8, atol=1e-10
    )


def test_entries_are_woven():
    even, odd = jnp.arange(4.0)[None], 10 + jnp.arange(3.0)[None]
    found = coarse_grids._weave(even, odd, 1, 7)
    np.testing.assert_array_equal(found, [[0, 10, 1, 11, 2, 12, 3]])
    np.testing.assert_array_equal(coarse_grids._weave(even, odd, 1, 6), found[:, :6])
