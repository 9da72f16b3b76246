"""Small systems against NumPy."""

import jax.numpy as jnp
import numpy as np
import pytest

from contourfair_jax._fairing.local_fairing.solvers import LU, Cholesky, eliminate
from contourfair_jax._fairing.small_systems import batched, invert, solve_small


def matrices(size, count, rng):
    """Symmetric positive definite, the batch last."""
    factor = rng.normal(size=(count, size, size))
    return np.moveaxis(factor @ factor.swapaxes(1, 2) + 0.5 * np.eye(size), 0, -1)


@pytest.mark.parametrize("size", [1, 2, 5])
def test_inverses(size, rng):
    square = matrices(size, 3, rng)
    expected = np.linalg.inv(np.moveaxis(square, -1, 0))
    found = invert(jnp.asarray(square))
    np.testing.assert_allclose(found, np.moveaxis(expected, 0, -1), rtol=1e-9, atol=1e-11)


def test_one_system_for_many_sides(rng):
    square, sides = matrices(4, 1, rng)[..., 0], rng.normal(size=(4, 3))
    found = solve_small(jnp.asarray(square), jnp.asarray(sides))
    np.testing.assert_allclose(found, np.linalg.solve(square, sides), rtol=1e-9, atol=1e-11)


def test_the_batch_is_last(rng):
    arrays = rng.normal(size=(3, 5))
    found = batched(lambda x: jnp.stack([jnp.sum(x), x[0]]))(jnp.asarray(arrays))
    np.testing.assert_allclose(found, [arrays.sum(0), arrays[0]])


@pytest.mark.parametrize(("size", "panels"), [(4, 1), (5, 2), (9, 3), (28, 7), (29, 6), (31, 7)])
def test_elimination_in_panels(size, panels, rng):
    """Four rows at a time, or more, so that there are seven panels at most."""
    square, sides = matrices(size, 2, rng), rng.normal(size=(size, 2))
    assert len(eliminate(jnp.asarray(square))) == panels
    expected = np.linalg.solve(np.moveaxis(square, -1, 0), sides.T[..., None])[..., 0].T
    for solver in (Cholesky(), LU()):
        found = solver.factorise(jnp.asarray(square))(jnp.asarray(sides))
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-8)
