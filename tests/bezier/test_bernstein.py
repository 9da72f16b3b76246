"""Bernstein polynomials, quadrature and products, against closed forms."""

from math import comb

import jax.numpy as jnp
import numpy as np
import pytest

from contourfair_jax._bezier.bernstein import (
    bernstein,
    bernstein_derivative,
    cubic_bernstein,
    derivatives,
    kronecker,
    quadrature,
)

T = np.array([0.0, 0.1, 0.35, 0.5, 0.8, 1.0])
# The four cubic polynomials as powers of t, lowest first.
POWERS = [
    np.polynomial.Polynomial([0] * k + [comb(3, k)]) * np.polynomial.Polynomial([1, -1]) ** (3 - k)
    for k in range(4)
]


@pytest.mark.parametrize("degree", [0, 1, 2, 3, 5])
def test_values_are_those_of_the_formula(degree):
    expected = [comb(degree, k) * T**k * (1 - T) ** (degree - k) for k in range(degree + 1)]
    np.testing.assert_allclose(bernstein(degree, T), np.stack(expected, axis=-1), atol=1e-15)
    assert bernstein(degree, np.ones((2, 3))).shape == (2, 3, degree + 1)


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_derivatives_are_those_of_the_powers(order):
    expected = np.stack([power.deriv(order)(T) for power in POWERS], axis=-1)
    np.testing.assert_allclose(bernstein_derivative(order, T), expected, atol=1e-13)
    if order < 3:
        ours = cubic_bernstein(jnp.asarray(T), order)
        np.testing.assert_allclose(ours, expected, atol=1e-13)


@pytest.mark.parametrize("order", [1, 2, 4])
def test_quadrature_is_exact_for_powers_below_twice_its_order(order):
    points, weights = quadrature(order)
    assert ((points > 0) & (points < 1)).all()
    for power in range(2 * order):
        assert weights @ points**power == pytest.approx(1 / (power + 1))
    assert abs(weights @ points ** (2 * order) - 1 / (2 * order + 1)) > 1e-6


def test_kronecker_applies_a_matrix_along_each_axis(rng):
    matrix, values = rng.normal(size=(2, 3)), rng.normal(size=(3, 3, 3))
    expected = np.einsum("ai,bj,ck,ijk->abc", matrix, matrix, matrix, values)
    np.testing.assert_allclose(kronecker(matrix, 3) @ values.ravel(), expected.ravel())
    np.testing.assert_array_equal(kronecker(matrix, 0), np.ones((1, 1)))


def test_partial_derivatives_by_name():
    assert derivatives(0, 3) == [()]
    assert derivatives(1, 2) == [(0,), (1,)]
    assert derivatives(2, 3) == [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
