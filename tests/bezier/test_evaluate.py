"""Values and derivatives on JAX, against the host."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from splines import catmull_rom

from contourfair_jax._bezier import evaluate
from contourfair_jax._bezier.host import HostField
from contourfair_jax._support.xla import CACHED

SHAPE, SPACING, ORIGIN = (4, 5), np.array([0.5, 2.0]), np.array([-1.0, 3.0])


@pytest.fixture
def net(rng):
    return np.asarray(catmull_rom(rng.normal(size=SHAPE)).control_points)


def partials(net, points, outside="nan", order=2, **more):
    arrays = (jnp.asarray(x) for x in (net, SPACING, ORIGIN, points))
    return [np.asarray(x) for x in evaluate.partials(*arrays, outside, order, **more)]


def test_per_length_as_on_the_host(net, rng):
    points = rng.uniform([0, 0], [3, 4], (7, 2))
    value, first, second = HostField(net).jet(points, 2)
    h, k = SPACING
    expected = value, first / [[h], [k]], second / [[h * h], [h * k], [k * k]]
    for ours, theirs in zip(partials(net, points * SPACING + ORIGIN), expected, strict=True):
        np.testing.assert_allclose(ours, theirs.T, atol=1e-11)
    for one, many in zip(partials(net, points[3] * SPACING + ORIGIN), expected, strict=True):
        np.testing.assert_allclose(one, many[:, 3], atol=1e-11)


def test_outside_the_grid(net):
    grid = np.array([[-1.0, 2], [1, 5], [3 + 1e-9, 1], [3, 4], [np.nan, 1]])
    points = grid * SPACING + ORIGIN
    (value,) = partials(net, points, order=0)
    np.testing.assert_array_equal(np.isnan(value[:, 0]), [1, 1, 1, 0, 1])
    nearest = np.clip(grid, 0, [3, 4])
    (clamped,) = partials(net, points, "clamp", 0)
    expected = HostField(net).jet(nearest, 0)[0][0]
    np.testing.assert_allclose(clamped[:, 0], expected, atol=1e-12)
    (extended,) = partials(net, points, "extend", 0)
    # The cubic of the border's cell, from its values at four places within.
    inside = HostField(net).jet(np.stack([np.arange(4) / 3, np.full(4, 2.0)], axis=1), 0)[0][0]
    cubic = np.polynomial.Polynomial.fit(np.arange(4) / 3, inside, 3)
    assert extended[0, 0] == pytest.approx(cubic(-1.0))
    assert np.isnan(extended[4, 0])


def test_cells_that_are_given(net):
    """On a face the second derivative is that of the cell asked for, or of the one above."""
    points = np.array([[1.0, 1.5]] * 3) * SPACING + ORIGIN
    cells = jnp.asarray([[-1, -1], [0, 1], [1, 1]])
    _, _, second = partials(net, points, cells=cells)
    assert second[0, 0] == second[2, 0]
    points = np.array([[1 - 1e-9, 1.5], [1 + 1e-9, 1.5]])
    below, above = HostField(net).jet(points, 2)[2][0] / SPACING[0] ** 2
    np.testing.assert_allclose(second[:, 0], [above, below, above], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("count", [1, 23, 24, 25, 26])
def test_batches_are_the_same_as_all_at_once(count, net, rng, monkeypatch):
    """A working set that holds eight points at a time."""
    few = CACHED._replace(batch_bytes=8 * 16 * 8 + 5)
    points = rng.uniform([0, 0], [3, 4], (count, 2))
    cells = np.floor(points).astype(int)
    monkeypatch.setattr(evaluate, "working_set", lambda: few)
    lengths = []
    once = evaluate._jets_at_once

    def counted(net, cells, *rest):
        lengths.append(len(cells))
        return once(net, cells, *rest)

    monkeypatch.setattr(evaluate, "_jets_at_once", counted)
    arrays = (jnp.asarray(net), jnp.asarray(cells), jnp.asarray(points - cells))
    value, first = evaluate.jets(*arrays, 1)
    expected = HostField(net).jet(points, 1)
    np.testing.assert_allclose(value, expected[0].T, atol=1e-12)
    np.testing.assert_allclose(first, expected[1].T, atol=1e-11)
    assert max(lengths) == -(-count // -(-count // 8))


def test_derivatives_in_the_net_and_in_the_points(net):
    points = jnp.asarray(np.array([[1.25, 2.5], [0.5, 3.75]]) * SPACING + ORIGIN)

    def total(net, points):
        value, _ = evaluate.partials(net, *map(jnp.asarray, (SPACING, ORIGIN)), points, "nan", 1)
        return jnp.sum(value)

    by_net, by_point = jax.grad(total, (0, 1))(jnp.asarray(net), points)
    # The field is linear in its net: weights of Bezier points, which sum to one for each point.
    assert float(jnp.sum(by_net)) == pytest.approx(2.0)
    assert float(jnp.sum(by_net * net)) == pytest.approx(float(total(jnp.asarray(net), points)))
    np.testing.assert_allclose(by_point, partials(net, points, order=1)[1], atol=1e-11)
