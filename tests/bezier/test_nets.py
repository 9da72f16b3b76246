"""Nets: cells, refinement, bounds and gaps, against loops."""

import itertools

import jax.numpy as jnp
import numpy as np
import pytest
from splines import catmull_rom

from contourfair_jax._bezier import nets
from contourfair_jax._bezier.bernstein import bernstein


def value_at(net, point):
    """The net at one point in grid coordinates."""
    cell = [min(int(x), (n - 1) // 3 - 1) for x, n in zip(point, net.shape, strict=True)]
    value = net[tuple(slice(3 * k, 3 * k + 4) for k in cell)]
    for x, k in zip(point, cell, strict=True):
        value = np.tensordot(bernstein(3, np.array(x - k)), value, 1)
    return float(value)


def cells_of(net):
    """Every cell and its points."""
    for cell in np.ndindex(*((n - 1) // 3 for n in net.shape)):
        yield cell, net[tuple(slice(3 * k, 3 * k + 4) for k in cell)]


@pytest.mark.parametrize("shape", [(4, 7), (4, 7, 10)])
def test_points_of_cells(shape, rng):
    net = rng.normal(size=shape)
    found = dict(cells_of(net))
    cells = np.array(list(found))
    ours = nets.gather_cells(jnp.asarray(net), jnp.asarray(cells))
    np.testing.assert_array_equal(ours, np.stack([found[tuple(cell)] for cell in cells]))
    one = nets.gather_cells(jnp.asarray(net), jnp.asarray(cells[-1]))
    np.testing.assert_array_equal(one, found[tuple(cells[-1])])
    for reduce, numpy in ((np.minimum, np.min), (np.maximum, np.max)):
        extreme = nets.cell_extreme(net, reduce)
        assert extreme.shape == tuple((n - 1) // 3 for n in shape)
        for cell, points in found.items():
            assert extreme[cell] == numpy(points)


@pytest.mark.parametrize("axis", [0, 1])
def test_values_between_samples_along_an_axis(axis, rng):
    samples = rng.normal(size=(4, 3))
    net = np.asarray(catmull_rom(samples).control_points)
    fine = np.asarray(nets.refine_axis(jnp.asarray(net), axis, 4))
    assert fine.shape[axis] == 4 * (samples.shape[axis] - 1) + 1
    np.testing.assert_array_equal(
        np.take(fine, range(0, fine.shape[axis], 4), axis),
        np.take(net, range(0, net.shape[axis], 3), axis),
    )
    both = np.asarray(nets.refine_axis(jnp.asarray(fine), 1 - axis, 4))
    for place in np.ndindex(both.shape):
        assert both[place] == pytest.approx(value_at(net, np.array(place) / 4), abs=1e-12)


def test_flat_is_rounding_of_the_value_and_no_more():
    eps, value = np.finfo(float).eps, np.array([1.0, -1.0, 4.0, 1.0, 0.0, 0.0])
    size = np.array([7.9, 7.9, 33.0, 8.1, 0.0, 1e-300]) * np.array([eps] * 4 + [1, 1])
    gradient = np.stack([size / 2, np.zeros(6)], axis=-1)
    flat = nets.is_flat(*map(jnp.asarray, (value, gradient, np.array([2.0, 1e30]))))
    np.testing.assert_array_equal(flat, [True, True, False, False, True, False])


def test_gaps_are_the_cells_around_missing_samples(rng):
    missing = np.zeros((4, 5), bool)
    missing[1, 2] = missing[3, 4] = True
    net = nets.without_gaps(jnp.asarray(rng.normal(size=nets.net_shape(missing.shape))), missing)
    valid = nets.cells_with_values(np.asarray(net))
    for cell in np.ndindex(valid.shape):
        corners = [
            missing[cell[0] + a, cell[1] + b] for a, b in itertools.product((0, 1), repeat=2)
        ]
        assert valid[cell] == (not any(corners))
    # Faces between samples that are there keep their values.
    assert np.isfinite(np.asarray(net)[0]).all()
    assert np.isnan(np.asarray(net)[2:5, 5:8]).all()
    assert np.isnan(np.asarray(net)).sum() == 9 + 4


def test_samples_are_every_third_point(rng):
    values = rng.normal(size=(3, 4))
    net = nets.set_samples(jnp.zeros(nets.net_shape(values.shape)), jnp.asarray(values))
    assert net.shape == (7, 10)
    np.testing.assert_array_equal(np.asarray(net)[::3, ::3], values)
    assert np.count_nonzero(net) == values.size
