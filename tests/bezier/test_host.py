"""Fields on the host: values, derivatives, cells and lattices against loops."""

import numpy as np
import pytest
from splines import catmull_rom

from contourfair_jax._bezier.bernstein import bernstein_derivative, derivatives
from contourfair_jax._bezier.host import HostField, lattice_values


def field_of(shape, rng):
    return HostField(np.asarray(catmull_rom(rng.normal(size=shape)).control_points))


def partial_at(net, point, axes):
    """One partial derivative at one point, in the cell above where there are two."""
    cells = [(n - 1) // 3 for n in net.shape]
    cell = [min(int(x), n - 1) for x, n in zip(point, cells, strict=True)]
    value = net[tuple(slice(3 * k, 3 * k + 4) for k in cell)]
    for axis, (x, k) in enumerate(zip(point, cell, strict=True)):
        value = np.tensordot(bernstein_derivative(axes.count(axis), np.array(x - k)), value, 1)
    return float(value)


@pytest.mark.parametrize("shape", [(4, 5), (3, 4, 5)])
def test_derivatives_of_all_orders(shape, rng):
    field, ndim = field_of(shape, rng), len(shape)
    assert field.cells == tuple(n - 1 for n in shape)
    points = rng.uniform(0, np.array(shape) - 1, (9, ndim))
    points[0], points[1], points[2] = 0, np.array(shape) - 1, 1
    for n, values in enumerate(field.jet(points, 2)):
        expected = [
            [partial_at(field.net, p, axes) for p in points] for axes in derivatives(n, ndim)
        ]
        np.testing.assert_allclose(values, expected, atol=1e-11)


def test_more_points_than_are_evaluated_at_once(rng):
    field = field_of((4, 5), rng)
    points = rng.uniform(0, 3, (40_000, 2))
    value, slopes = field.jet(points, 1)
    assert value.shape == (1, 40_000)
    for k in (0, 16_383, 16_384, 39_999):
        assert value[0, k] == pytest.approx(partial_at(field.net, points[k], ()))
        assert slopes[1, k] == pytest.approx(partial_at(field.net, points[k], (1,)))
    assert [part.shape for part in field.jet(points[:0], 1)] == [(1, 0), (2, 0)]


def test_outside_is_nan(rng):
    field = field_of((4, 5), rng)
    points = np.array([[-1e-9, 1], [1, -1e-9], [3 + 1e-9, 1], [1, 4 + 1e-9], [np.nan, 1], [3, 4]])
    found = field.jet(points, 1)
    for values in found:
        np.testing.assert_array_equal(np.isnan(values), [[1, 1, 1, 1, 1, 0]] * len(values))


def test_points_on_faces_are_in_a_cell_with_values(rng):
    net = rng.normal(size=(10, 13))
    net[5, 5] = np.nan
    field = HostField(net)
    expected = np.ones((3, 4), bool)
    expected[1, 1] = False
    np.testing.assert_array_equal(field.valid, expected)
    points = np.array([[1, 1.5], [1.5, 1], [1, 1], [2, 1.5], [1.5, 2], [1.5, 1.5], [0, 0], [3, 4]])
    cells = [[0, 1], [1, 0], [1, 0], [2, 1], [1, 2], [1, 1], [0, 0], [2, 3]]
    np.testing.assert_array_equal(field.locate(points), cells)
    missing = np.isnan(field.jet(points, 0)[0][0])
    np.testing.assert_array_equal(missing, [0, 0, 0, 0, 0, 1, 0, 0])


def test_points_of_cells(rng):
    net = rng.normal(size=(4, 7, 10))
    field = HostField(net)
    cells = np.array(list(np.ndindex(field.cells)))
    points = field.gather(cells)
    low, high = field.bounds
    for k, cell in enumerate(cells):
        mine = net[tuple(slice(3 * c, 3 * c + 4) for c in cell)]
        np.testing.assert_array_equal(points[..., k], mine)
        assert (low[tuple(cell)], high[tuple(cell)]) == (mine.min(), mine.max())


@pytest.mark.parametrize("factor", [1, 2, 5])
def test_values_on_a_lattice_of_cells(factor, rng):
    field = field_of((3, 4, 3), rng)
    cells = np.array(list(np.ndindex(field.cells)))
    values = lattice_values(field.gather(cells), factor)
    assert values.shape == (factor + 1,) * 3 + (len(cells),)
    for place in np.ndindex(values.shape[:-1]):
        expected = field.jet(cells + np.array(place) / factor, 0)[0][0]
        np.testing.assert_allclose(values[place], expected, atol=1e-12)
