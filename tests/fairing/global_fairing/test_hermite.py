"""The C1 space in Hermite form: corners of cells, integrals and nets, against loops."""

import itertools

import jax.numpy as jnp
import numpy as np
import pytest

from contourfair_jax._bezier.bernstein import bernstein_derivative, quadrature
from contourfair_jax._fairing.global_fairing import hermite

SHAPES = [(3, 4), (3, 2, 4)]


@pytest.mark.parametrize("shape", SHAPES)
def test_corners_of_cells(shape, rng):
    ndim = len(shape)
    dofs = rng.normal(size=(2**ndim, *shape))
    cells = np.asarray(hermite.gather_corners(jnp.asarray(dofs.reshape(2**ndim, -1)), shape))
    shifts = hermite.corner_shifts(shape)
    corners = list(itertools.product((0, 1), repeat=ndim))
    assert shifts == [int(np.ravel_multi_index(corner, shape)) for corner in corners]
    inner = hermite.rows_to_cells(jnp.asarray(cells), shape)
    for cell in np.ndindex(*(n - 1 for n in shape)):
        expected = [dofs[(slice(None), *np.add(cell, corner))] for corner in corners]
        np.testing.assert_array_equal(inner[(slice(None), *cell)], np.concatenate(expected))
    rows = np.asarray(hermite.cells_to_rows(inner)).reshape(-1, *shape)
    np.testing.assert_array_equal(rows[(slice(None), *(slice(-1),) * ndim)], inner)
    for axis in range(ndim):
        assert not np.take(rows, -1, axis=axis + 1).any()


@pytest.mark.parametrize("shape", SHAPES)
def test_scattering_is_the_transpose_of_gathering(shape, rng):
    ndim, count = len(shape), int(np.prod(shape))
    dofs, cells = rng.normal(size=(2**ndim, count)), rng.normal(size=(4**ndim, count))
    gathered = hermite.gather_corners(jnp.asarray(dofs), shape)
    scattered = hermite.scatter_corners(jnp.asarray(cells), shape)
    assert float(jnp.sum(gathered * cells)) == pytest.approx(float(jnp.sum(scattered * dofs)))


def basis(corner, slopes, orders, t):
    """A function of a unit cell, or a derivative, at one point."""
    value = 1.0
    for end, slope, order, x in zip(corner, slopes, orders, t, strict=True):
        points = hermite.HERMITE_TO_BEZIER[:, 2 * end + slope]
        value *= bernstein_derivative(order, np.array(x)) @ points
    return value


@pytest.mark.parametrize(("left", "right"), [((0, 0), (0, 0)), ((2, 0), (0, 2)), ((1, 1), (2, 1))])
def test_integrals_of_products(left, right):
    """In the order of corners, and for each the slopes."""
    functions = list(itertools.product(itertools.product((0, 1), repeat=2), repeat=2))
    points, weights = quadrature(4)
    expected = np.zeros((16, 16))
    for (p, u), (q, v) in itertools.product(zip(points, weights, strict=True), repeat=2):
        first = np.array([basis(*each, left, (p, q)) for each in functions])
        second = np.array([basis(*each, right, (p, q)) for each in functions])
        expected += u * v * np.outer(first, second)
    np.testing.assert_allclose(hermite.gram(left, right), expected, atol=1e-10)


def test_values_and_slopes_at_the_ends():
    for end, slope in itertools.product((0, 1), repeat=2):
        points = hermite.HERMITE_TO_BEZIER[:, 2 * end + slope]
        for order, at in itertools.product((0, 1), repeat=2):
            expected = float(order == slope and at == end)
            assert bernstein_derivative(order, np.array(float(at))) @ points == pytest.approx(
                expected
            )


@pytest.mark.parametrize("shape", SHAPES)
def test_nets_have_the_values_and_slopes(shape, rng):
    """Products of quadratics: their Bezier points are known along every axis."""
    factors = [np.polynomial.Polynomial(rng.normal(size=3)) for _ in shape]
    ndim = len(shape)
    dofs = np.empty((2,) * ndim + shape)
    for slopes in np.ndindex(*(2,) * ndim):
        axes = [f.deriv(s)(np.arange(n)) for f, s, n in zip(factors, slopes, shape, strict=True)]
        dofs[slopes] = _outer(axes)
    net = hermite.to_net(jnp.asarray(dofs.reshape(2**ndim, -1)), shape)
    lines = []
    for f, n in zip(factors, shape, strict=True):
        at = np.arange(n)
        points = np.stack([f(at) - f.deriv()(at) / 3, f(at), f(at) + f.deriv()(at) / 3], 1).ravel()
        lines.append(points[1:-1])
    np.testing.assert_allclose(net, _outer(lines), atol=1e-12)


def _outer(axes):
    product = np.ones(())
    for axis in axes:
        product = np.multiply.outer(product, axis)
    return product
