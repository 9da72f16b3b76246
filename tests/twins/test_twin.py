"""The twin itself: against SciPy, an independent minimiser and what the method promises."""

import itertools

import cases
import numpy as np
import pytest
import scipy.integrate
import scipy.interpolate
import scipy.linalg
import scipy.ndimage
import twin

SPACINGS = [(1.0, 1.0), (0.5, 1.75), (1.0, 1.0, 1.0), (0.8, 1.0, 2.0)]
S = np.linspace(0, 2, 41)


# The basis -------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("i", range(5))
def test_bsplines_equal_scipy(i, order):
    reference = scipy.interpolate.BSpline(twin.KNOTS, np.eye(5)[i], 3).derivative(order)
    ours = [twin.bspline_derivative(i, 3, s, order) for s in S]
    np.testing.assert_allclose(ours, reference(S), atol=1e-13)


def test_bsplines_are_a_partition_of_unity():
    np.testing.assert_allclose([sum(twin.bspline(i, 3, s) for i in range(5)) for s in S], 1)


# Cubic coefficients of phi_0..phi_4, constant term first: s in [0, 1], then s in [1, 2].
PUBLISHED = [
    [(1, -3, 3, -1), (0, 0, 0, 0)],
    [(0, 3, -5.25, 2.25), (3, -6, 3.75, -0.75)],
    [(0, 0, 3, -2), (-4, 12, -9, 2)],
    [(0, 0, -0.75, 0.75), (3, -9, 8.25, -2.25)],
    [(0, 0, 0, 0), (-1, 3, -3, 1)],
]


@pytest.mark.parametrize("k", range(5))
@pytest.mark.parametrize("order", [0, 1, 2])
def test_phi_equals_the_published_polynomials(k, order):
    pieces = [np.polynomial.Polynomial(c).deriv(order) for c in PUBLISHED[k]]
    expected = [pieces[0](s) if s < 1 else pieces[1](s) for s in S]
    np.testing.assert_allclose([twin.phi(k, s, order) for s in S], expected, atol=1e-12)


def test_phi_interpolates_at_the_knots():
    at_knots = [[twin.phi(k, s) for s in (0.0, 1.0, 2.0)] for k in range(5)]
    expected = [[1, 0, 0], [0, 0, 0], [0, 1, 0], [0, 0, 0], [0, 0, 1]]
    np.testing.assert_allclose(at_knots, expected, atol=1e-15)


def test_bezier_rows_are_the_same_function(rng):
    c = rng.normal(size=5)
    b = twin.bezier_row(c)
    for s in S:
        cell = min(int(s), 1)
        bezier = sum(b[3 * cell + i] * twin.bernstein(i, 3, s - cell) for i in range(4))
        assert bezier == pytest.approx(sum(c[k] * twin.phi(k, s) for k in range(5)), abs=1e-13)


# The energy ------------------------------------------------------------------------------


def nd_bspline(coefficients, spacing):
    """SciPy's tensor-product spline with ordinary B-spline coefficients, on physical knots."""
    knots = tuple(np.array(twin.KNOTS) * h for h in spacing)
    return scipy.interpolate.NdBSpline(knots, coefficients, 3)


def to_bspline_coefficients(coefficients):
    """From the transformed basis to ordinary B-spline coefficients: ``d_2 = 2c_2 - ...``."""
    transform = np.eye(5)
    transform[2] = [0, -0.5, 2, -0.5, 0]
    for axis in range(coefficients.ndim):
        coefficients = np.moveaxis(np.tensordot(transform, coefficients, (1, axis)), 0, axis)
    return coefficients


def partial_orders(ndim):
    """Orders per axis of every second partial derivative, row by row of the Hessian."""
    unit = np.eye(ndim, dtype=int)
    return [tuple(unit[a] + unit[b]) for a in range(ndim) for b in range(ndim)]


def scipy_jet(spline, points):
    """Gradients (n, d) and Hessians (n, d, d) of a SciPy spline at points (n, d)."""
    ndim = points.shape[-1]
    gradient = [spline(points, nu=tuple(row)) for row in np.eye(ndim, dtype=int)]
    hessian = [spline(points, nu=orders) for orders in partial_orders(ndim)]
    return np.stack(gradient, -1), np.stack(hessian, -1).reshape(-1, ndim, ndim)


@pytest.mark.parametrize("spacing", SPACINGS[:2])
def test_thin_plate_energy_equals_scipy_quadrature(spacing, rng):
    coefficients = rng.normal(size=(5, 5))
    spline = nd_bspline(to_bspline_coefficients(coefficients), spacing)

    def integrand(y, x):
        (hessian,) = scipy_jet(spline, np.array([[x, y]]))[1]
        return np.sum(hessian**2)

    (h, k), cells = spacing, itertools.product((0, 1), repeat=2)
    expected = sum(
        scipy.integrate.dblquad(integrand, i * h, (i + 1) * h, j * k, (j + 1) * k, epsrel=1e-9)[0]
        for i, j in cells
    )
    assert twin.local_energy(coefficients, None, 0, spacing) == pytest.approx(expected, rel=1e-8)


def test_fair_energy_converges_to_the_energy_of_equation_12(rng):
    """In 2-D and with w = 0 it is ``(n2 fxx - n1 fxy)^2 + (n2 fxy - n1 fyy)^2``."""
    spacing = (1.0, 1.5)
    coefficients, previous = rng.normal(size=(2, 5, 5))
    # A steep plane added to the previous iterate keeps its gradient away from zero.
    previous = previous + 40 * np.add.outer([0, 1 / 3, 1, 5 / 3, 2], np.zeros(5))
    spline = nd_bspline(to_bspline_coefficients(coefficients), spacing)
    before = nd_bspline(to_bspline_coefficients(previous), spacing)

    expected = 0.0
    nodes, weights = np.polynomial.legendre.leggauss(24)
    for cell in itertools.product((0, 1), repeat=2):
        axes = [(c + (nodes + 1) / 2) * h for c, h in zip(cell, spacing, strict=True)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 2)
        gradient, hessian = scipy_jet(before, points)[0], scipy_jet(spline, points)[1]
        n1, n2 = (gradient / np.linalg.norm(gradient, axis=1, keepdims=True)).T
        fxx, fxy, fyy = hessian[:, 0, 0], hessian[:, 0, 1], hessian[:, 1, 1]
        integrand = (n2 * fxx - n1 * fxy) ** 2 + (n2 * fxy - n1 * fyy) ** 2
        expected += np.outer(weights, weights).ravel() @ integrand * np.prod(spacing) / 4

    def error(order):
        return abs(twin.local_energy(coefficients, previous, 0, spacing, 0.0, order) / expected - 1)

    assert error(12) < 1e-9
    assert error(12) < error(4) < 1e-2


# The minimum -----------------------------------------------------------------------------


def independent_minimum(samples, spacing, previous=None, weight=1.0):
    """Ordinary B-spline coefficients of the constrained minimum, by residuals and a null space.

    Residuals are ``sqrt(weight) (H - (1 - sqrt w) (H n) n^T)`` at Gauss points; their sum of
    squares is ``integral tr(H M H)``.  Only SciPy's splines and dense least squares are used.
    """
    ndim = samples.ndim
    nodes, weights = np.polynomial.legendre.leggauss(4)
    nodes, weights = np.append(nodes + 1, nodes + 3) / 2, np.append(weights, weights) / 2
    axes = [nodes * h for h in spacing]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, ndim)
    measure = weights
    for _ in range(ndim - 1):
        measure = np.multiply.outer(measure, weights)
    basis = nd_bspline(np.eye(5**ndim).reshape((5,) * ndim + (-1,)), spacing)
    hessian = np.stack([basis(points, nu=o) for o in partial_orders(ndim)], 1)
    hessian = hessian.reshape(len(points), ndim, ndim, 5**ndim)
    if previous is not None:
        gradient = scipy_jet(nd_bspline(previous, spacing), points)[0]
        n = gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
        along = np.einsum("qabi,qb,qc->qaci", hessian, n, n)
        hessian = hessian - (1 - np.sqrt(weight)) * along
    rows = (np.sqrt(measure.ravel())[:, None, None, None] * hessian).reshape(-1, 5**ndim)

    grid = [np.array([0, 1, 2]) * h for h in spacing]
    at_samples = basis(np.stack(np.meshgrid(*grid, indexing="ij"), -1)).reshape(-1, 5**ndim)
    particular = np.linalg.lstsq(at_samples, samples.ravel())[0]
    free = scipy.linalg.null_space(at_samples)
    change = np.linalg.lstsq(rows @ free, -rows @ particular)[0]
    return (particular + free @ change).reshape((5,) * ndim)


@pytest.mark.parametrize("spacing", SPACINGS)
def test_every_iterate_is_the_minimum(spacing, rng):
    samples = rng.normal(size=(3,) * len(spacing))
    expected, weight = None, 1.0
    for iterations in (0, 1, 2):
        expected = independent_minimum(samples, spacing, expected, weight)
        ours = twin.local_coefficients(samples, spacing, 0.02, iterations)
        np.testing.assert_allclose(to_bspline_coefficients(ours), expected, atol=1e-8)
        weight = 0.02


def test_other_coefficients_have_more_energy(rng):
    samples, spacing = rng.normal(size=(3, 3)), (1.0, 0.6)
    eps = twin.gradient_scale(samples, spacing)
    previous = twin.local_coefficients(samples, spacing, iterations=1)
    best = twin.local_coefficients(samples, spacing, iterations=2)
    least = twin.local_energy(best, previous, eps, spacing)
    for index in np.ndindex(5, 5):
        if any(k % 2 for k in index):
            for change in (1e-3, -1e-3):
                other = best.copy()
                other[index] += change
                assert twin.local_energy(other, previous, eps, spacing) > least


def test_weight_one_is_thin_plate(rng):
    samples = rng.normal(size=(3, 3))
    thin_plate = twin.local_coefficients(samples, (1.0, 2.0), iterations=0)
    blended = twin.local_coefficients(samples, (1.0, 2.0), 1.0, iterations=2)
    np.testing.assert_allclose(blended, thin_plate, atol=1e-12)


# The net ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("grid", "name"), cases.grid_field_cases(2, 3))
def test_net_interpolates_and_is_c1(grid, name, rng):
    samples = cases.FIELDS[name].samples(grid.shape, rng)
    net = twin.fair_net(samples, grid.spacing, iterations=1, quadrature_order=3)
    assert net.shape == tuple(3 * (n - 1) + 1 for n in grid.shape)
    np.testing.assert_array_equal(net[(slice(None, None, 3),) * grid.ndim], samples)
    scale = np.abs(net).max()
    for axis, n in enumerate(grid.shape):
        for face in range(3, 3 * (n - 1), 3):
            before, at, after = (np.take(net, face + i, axis) for i in (-1, 0, 1))
            np.testing.assert_allclose(after - at, at - before, atol=1e-12 * scale)


@pytest.mark.parametrize("grid", [*cases.GRIDS[2], *cases.GRIDS[3]], ids=lambda g: g.name)
@pytest.mark.parametrize("iterations", [0, 2])
def test_planes_are_reproduced(grid, iterations, rng):
    slope, origin = rng.normal(size=grid.ndim), rng.normal(size=grid.ndim)
    axes = [o + h * np.arange(n) for o, h, n in zip(origin, grid.spacing, grid.shape, strict=True)]
    samples = 1 + np.stack(np.meshgrid(*axes, indexing="ij"), -1) @ slope
    net = twin.fair_net(samples, grid.spacing, iterations=iterations)
    extent = np.array(grid.spacing) * (np.array(grid.shape) - 1)
    points = origin + rng.uniform(-0.2, 1.2, (20, grid.ndim)) * extent
    ours = twin.evaluate(net, grid.spacing, origin, points)
    np.testing.assert_allclose(ours, 1 + points @ slope, atol=1e-10)
    for axis in range(grid.ndim):
        orders = tuple(np.eye(grid.ndim, dtype=int)[axis])
        ours = twin.evaluate(net, grid.spacing, origin, points, orders)
        np.testing.assert_allclose(ours, slope[axis], atol=1e-10)


@pytest.mark.parametrize("spacing", SPACINGS)
def test_one_neighbourhood_is_its_own_net(spacing, rng):
    samples = rng.normal(size=(3,) * len(spacing))
    coefficients = twin.local_coefficients(samples, spacing)
    net = twin.fair_net(samples, spacing)
    for s in rng.uniform(0, 2, (10, len(spacing))):
        for orders in [(0,) * len(spacing), *partial_orders(len(spacing))]:
            ours = twin.evaluate(net, spacing, np.zeros(len(spacing)), s * spacing, orders)
            expected = twin.evaluate_local(coefficients, spacing, s, orders)
            np.testing.assert_allclose(ours, expected, atol=1e-10)


@pytest.mark.parametrize("n", [3, 4, 5, 8])
def test_every_net_index_has_its_nearest_inner_vertex(n):
    for k in range(3 * (n - 1) + 1):
        nearest = min(range(1, n - 1), key=lambda v, k=k: abs(3 * v - k))
        assert twin.owner(k, n) == nearest


# What fairing is for ---------------------------------------------------------------------


def test_fairing_follows_an_oblique_step_better_than_thin_plate():
    """The published order of errors: fair < thin plate on the oblique step, at 8x."""
    field = cases.ANALYTIC["step"]
    axis = np.linspace(-1, 1, 37)
    points = np.stack(np.meshgrid(axis, axis, indexing="ij"), -1)
    truth = field.truth(points[..., 0], points[..., 1])

    def error(iterations):
        net = twin.fair_net(field.samples(), field.spacing, 0.01, iterations)
        return np.sqrt(np.mean((twin.evaluate(net, field.spacing, (-1, -1), points) - truth) ** 2))

    assert error(3) < 0.75 * error(0)


# The table of cases ----------------------------------------------------------------------


@pytest.mark.parametrize(("grid", "name"), cases.grid_field_cases(2, 3))
def test_cases_are_finite_and_repeat(grid, name):
    field = cases.FIELDS[name]
    first, second = (field.samples(grid.shape, np.random.default_rng(3)) for _ in range(2))
    assert np.isfinite(first).all()
    np.testing.assert_array_equal(first, second)


# Errors of linear interpolation on the refined grid, as recorded for these fields.
BILINEAR = [("ridge", 0.0699), ("step", 0.0338), ("disk", 0.0312), ("cone", 0.0120)]
BILINEAR += [("franke", 0.0106), ("marschner_lobb_slice", 0.0352)]


@pytest.mark.parametrize(("name", "expected"), BILINEAR)
def test_analytic_fields_have_the_known_bilinear_error(name, expected):
    field = cases.ANALYTIC[name]
    zoomed = scipy.ndimage.zoom(field.samples(), 8 - 7 / field.size, order=1)
    truth = field.refined(8)
    assert zoomed.shape == truth.shape
    assert np.sqrt(np.mean((zoomed - truth) ** 2)) == pytest.approx(expected, abs=6e-5)
