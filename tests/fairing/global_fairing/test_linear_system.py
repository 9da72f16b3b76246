"""Conjugate gradients: whatever the guess, and however little there is to solve."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from contourfair_jax._fairing.global_fairing.linear_system import conjugate_gradients

SIZE = 12
BOTH = pytest.mark.both_precisions


def problem(rng):
    """A matrix, a right-hand side, the solution, and a preconditioner."""
    factor = rng.normal(size=(SIZE, SIZE)) / np.sqrt(SIZE)
    matrix = factor @ factor.T + np.diag(rng.uniform(0.1, 1.0, SIZE))
    solution = rng.normal(size=SIZE)
    own = jnp.zeros(()).dtype
    arrays = (matrix, matrix @ solution, solution, 1 / np.diag(matrix))
    return [jnp.asarray(array, own) for array in arrays]


@BOTH
@pytest.mark.parametrize("scale", [None, 0.0, 0.5, 1.0, -1.0, 1e4])
def test_solves_from_any_guess(scale, rng):
    matrix, right, solution, inverse = problem(rng)
    guess = None if scale is None else scale * solution
    tolerance = 1e-5
    found = jax.jit(
        lambda guess: conjugate_gradients(
            lambda x: matrix @ x, right, guess, lambda x: inverse * x, tolerance, 100
        )
    )(guess)
    np.testing.assert_allclose(found.value, solution, atol=1e-3)
    assert found.residual <= tolerance
    # Along the solution the first step, which does not count, is the last.
    assert found.steps == 0 if scale else 0 < found.steps <= 2 * SIZE


def test_a_guess_saves_steps(rng):
    matrix, right, solution, inverse = problem(rng)
    near = solution + 1e-3 * jnp.asarray(rng.normal(size=SIZE), solution.dtype)
    steps = [
        int(
            conjugate_gradients(
                lambda x: matrix @ x, right, guess, lambda x: inverse * x, 1e-2, 100
            ).steps
        )
        for guess in (None, near)
    ]
    assert steps[1] < steps[0]


@pytest.mark.parametrize("guess", [None, np.zeros(SIZE), np.ones(SIZE)])
def test_nothing_to_solve(guess, rng):
    matrix, right, _, inverse = problem(rng)
    guess = None if guess is None else jnp.asarray(guess, right.dtype)
    found = conjugate_gradients(
        lambda x: matrix @ x, 0 * right, guess, lambda x: inverse * x, 1e-6, 100
    )
    np.testing.assert_array_equal(found.value, 0)
    assert found.steps == 0
    assert found.residual == 0


def test_residuals_are_relative_to_a_size_that_is_larger(rng):
    """In the norm of the preconditioner, against products written out."""
    matrix, right, _, inverse = problem(rng)
    own = float(np.sqrt(right @ (inverse * right)))
    steps = []
    for least in (0.0, 0.5 * own, 30 * own, 1e4 * own):
        found = conjugate_gradients(
            lambda x: matrix @ x, right, None, lambda x: inverse * x, 1e-3, 100, least
        )
        assert float(found.size) == pytest.approx(max(own, least))
        left = right - matrix @ found.value
        residual = float(np.sqrt(left @ (inverse * left))) / float(found.size)
        assert float(found.residual) == pytest.approx(residual, rel=1e-6)
        assert residual <= 1e-3
        steps.append(int(found.steps))
    assert steps[0] == steps[1] > steps[2] > steps[3] == 0
