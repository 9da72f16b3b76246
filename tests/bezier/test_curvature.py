"""Curvature of spheres, cylinders and random fields, on JAX and on the host."""

import jax.numpy as jnp
import numpy as np
import pytest

from contourfair_jax._bezier.curvature import (
    full_hessian,
    host_gaussian_curvature,
    host_mean_curvature,
    mean_curvature,
)


def naive(gradient, hessian):
    """Mean and Gaussian curvature of one point from the shape operator in the tangent plane."""
    size = np.linalg.norm(gradient)
    tangents = np.linalg.svd(gradient[None])[2][1:]
    principal = np.linalg.eigvalsh(tangents @ hessian @ tangents.T) / size
    return principal.mean(), principal.prod()


def random_jets(rng, ndim, count=6):
    hessian = rng.normal(size=(count, ndim, ndim))
    return rng.normal(size=(count, ndim)), hessian + hessian.swapaxes(1, 2)


def test_the_full_matrix_has_every_derivative_twice():
    second = np.arange(12).reshape(2, 6)
    expected = [[0, 1, 2], [1, 3, 4], [2, 4, 5]]
    np.testing.assert_array_equal(full_hessian(second, 3), [expected, np.add(expected, 6)])
    np.testing.assert_array_equal(full_hessian(np.arange(3), 2), [[0, 1], [1, 2]])


@pytest.mark.parametrize("ndim", [2, 3])
def test_mean_curvature_is_that_of_the_shape_operator(ndim, rng):
    gradient, hessian = random_jets(rng, ndim)
    expected = [naive(g, h)[0] for g, h in zip(gradient, hessian, strict=True)]
    ours = mean_curvature(*map(jnp.asarray, (np.ones(6), gradient, hessian, np.ones(ndim))))
    np.testing.assert_allclose(ours, expected, rtol=1e-10)
    second = hessian[(slice(None), *np.triu_indices(ndim))].T
    size, mean = host_mean_curvature(list(gradient.T), list(second))
    np.testing.assert_allclose(size, np.linalg.norm(gradient, axis=1))
    np.testing.assert_allclose(mean, expected, rtol=1e-10)


def test_gaussian_curvature_is_that_of_the_shape_operator(rng):
    gradient, hessian = random_jets(rng, 3)
    expected = [naive(g, h)[1] for g, h in zip(gradient, hessian, strict=True)]
    np.testing.assert_allclose(host_gaussian_curvature(gradient, hessian), expected, rtol=1e-10)


@pytest.mark.parametrize("radius", [0.5, 3.0])
def test_spheres_bend_by_one_over_their_radius(radius):
    """Of |x|^2: the gradient is 2 x, the Hessian twice the unit matrix."""
    point = radius * np.array([[2.0, -1.0, 2.0]]) / 3
    _, mean = host_mean_curvature(
        list(2 * point.T), [np.full(1, 2.0 * (k in (0, 3, 5))) for k in range(6)]
    )
    assert mean == pytest.approx(1 / radius)
    assert host_gaussian_curvature(2 * point, 2 * np.eye(3)[None]) == pytest.approx(radius**-2)


def test_no_curvature_where_the_gradient_vanishes(rng):
    _, hessian = random_jets(rng, 3)
    nothing = np.zeros((6, 3))
    second = hessian[(slice(None), *np.triu_indices(3))].T
    size, mean = host_mean_curvature(list(nothing.T), list(second))
    assert not size.any()
    assert not mean.any()
    assert not host_gaussian_curvature(nothing, hessian).any()
    arrays = (np.ones(6), 1e-16 * np.ones((6, 3)), hessian, np.ones(3))
    assert not np.asarray(mean_curvature(*map(jnp.asarray, arrays))).any()


def test_curvature_does_not_depend_on_the_size_of_values():
    gradient, hessian = np.array([[3.0, 4.0]]), np.array([[[1.0, 2.0], [2.0, 5.0]]])
    (expected,) = [naive(g, h)[0] for g, h in zip(gradient, hessian, strict=True)]
    for scale in (1e-160, 1e160):
        arrays = (np.zeros(1), scale * gradient, scale * hessian, np.ones(2))
        ours = mean_curvature(*map(jnp.asarray, arrays))
        np.testing.assert_allclose(ours, expected, rtol=1e-12)
