"""A naive NumPy twin of the local method: slow, plain, any number of dimensions.

It shares nothing with the package.  B-splines come from the Cox-de Boor recursion,
energies from sums over quadrature points, the net from a loop over its indices.
Everything is float64.  One vertex of a 3-D grid takes a hundredth of a second.

For one inner vertex the field is ``f = sum_i c_i phi_i`` over multi-indices ``i`` in
``{0..4}^d`` on the square (cube) ``[0, 2]^d``.  The coefficients whose indices are all even
are the samples; the others minimise ``integral tr(H M H)``, ``M = I - (1 - w) N``, with
``N = g g^T / (|g|^2 + eps^2)`` taken from the previous iterate and ``N = 0`` in the first.
"""

import functools
import itertools
import math
from typing import NamedTuple

import numpy as np

KNOTS = (0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 2.0, 2.0, 2.0)
RELATIVE_EPS = 1e-6


# One-dimensional basis -------------------------------------------------------------------


def bspline(i, degree, s):
    """B-spline number `i` of `degree` on `KNOTS`; the last interval includes its end."""
    if degree == 0:
        inside = KNOTS[i] <= s < KNOTS[i + 1]
        at_the_end = s == KNOTS[-1] == KNOTS[i + 1] > KNOTS[i]
        return 1.0 if inside or at_the_end else 0.0
    total = 0.0
    if KNOTS[i + degree] > KNOTS[i]:
        rising = (s - KNOTS[i]) / (KNOTS[i + degree] - KNOTS[i])
        total += rising * bspline(i, degree - 1, s)
    if KNOTS[i + degree + 1] > KNOTS[i + 1]:
        falling = (KNOTS[i + degree + 1] - s) / (KNOTS[i + degree + 1] - KNOTS[i + 1])
        total += falling * bspline(i + 1, degree - 1, s)
    return total


def bspline_derivative(i, degree, s, order):
    """Derivative ``N_i' = p (N_{i,p-1} / (t_{i+p} - t_i) - N_{i+1,p-1} / (...))``, repeated."""
    if order == 0:
        return bspline(i, degree, s)
    total = 0.0
    if KNOTS[i + degree] > KNOTS[i]:
        lower = bspline_derivative(i, degree - 1, s, order - 1)
        total += degree * lower / (KNOTS[i + degree] - KNOTS[i])
    if KNOTS[i + degree + 1] > KNOTS[i + 1]:
        lower = bspline_derivative(i + 1, degree - 1, s, order - 1)
        total -= degree * lower / (KNOTS[i + degree + 1] - KNOTS[i + 1])
    return total


@functools.cache
def phi(k, s, order=0):
    """Basis function ``phi_k`` at `s` in [0, 2], or its derivative of `order`."""
    n = [bspline_derivative(i, 3, s, order) for i in range(5)]
    return (n[0], n[1] - n[2] / 2, 2 * n[2], n[3] - n[2] / 2, n[4])[k]


# The energy of one neighbourhood ---------------------------------------------------------


class QuadraturePoints(NamedTuple):
    """Weights (volumes), and the physical derivatives of all 5^d basis functions at q points."""

    weights: np.ndarray  # (q,)
    gradients: np.ndarray  # (q, 5^d, d)
    hessians: np.ndarray  # (q, 5^d, d, d)


def basis_derivative(s, orders, spacing):
    """One physical partial derivative of every product basis function at `s`: (5^d,)."""
    per_axis = [
        [phi(k, x, order) / h**order for k in range(5)]
        for x, order, h in zip(s, orders, spacing, strict=True)
    ]
    return functools.reduce(np.multiply.outer, per_axis).ravel()


def basis_jet(s, spacing):
    """Gradients (5^d, d) and Hessians (5^d, d, d) of every product basis function at `s`."""
    axes = range(len(s))
    gradients = [basis_derivative(s, [int(a == k) for k in axes], spacing) for a in axes]
    hessians = [
        [basis_derivative(s, [(a == k) + (b == k) for k in axes], spacing) for b in axes]
        for a in axes
    ]
    return np.moveaxis(np.array(gradients), -1, 0), np.moveaxis(np.array(hessians), -1, 0)


@functools.cache
def quadrature_points(spacing, quadrature_order):
    """Gauss-Legendre points of all 2^d cells around a vertex."""
    nodes, weights = np.polynomial.legendre.leggauss(quadrature_order)
    on_axis = [
        (cell + (node + 1) / 2, weight / 2)
        for cell in (0, 1)
        for node, weight in zip(nodes, weights, strict=True)
    ]
    points = []
    for point in itertools.product(on_axis, repeat=len(spacing)):
        weight = math.prod(w for _, w in point) * math.prod(spacing)
        points.append((weight, *basis_jet([s for s, _ in point], spacing)))
    return QuadraturePoints(*map(np.array, zip(*points, strict=True)))


def gradient_scale(samples, spacing):
    """``eps``: the gradient below which a normal fades away."""
    spread = samples.max() - samples.min()
    return RELATIVE_EPS * (spread if spread > 0 else 1.0) / min(spacing)


def energy_matrix(previous, eps, spacing, thin_plate_weight, quadrature_order):
    """The 5^d x 5^d matrix of ``integral tr(H M H)``; `previous` None means ``N = 0``."""
    points = quadrature_points(spacing, quadrature_order)
    m = np.broadcast_to(np.eye(len(spacing)), (len(points.weights), len(spacing), len(spacing)))
    if previous is not None:
        g = np.einsum("i,qia->qa", previous.ravel(), points.gradients)
        size = np.sum(g * g, axis=1) + eps**2
        m = m - (1 - thin_plate_weight) * np.einsum("q,qa,qb->qab", 1 / size, g, g)
    # tr(H_i M H_j) = sum of (H_i M)_ab (H_j)_ab, both Hessians being symmetric
    left = np.einsum("q,qiab,qbc->qiac", points.weights, points.hessians, m, optimize=True)
    return np.tensordot(left, points.hessians, axes=([0, 2, 3], [0, 2, 3]))


def local_coefficients(samples, spacing, thin_plate_weight=0.02, iterations=3, quadrature_order=4):
    """Coefficients, shape (5,)*d, of the fair field of one 3^d neighbourhood."""
    samples = np.asarray(samples, float)
    spacing = tuple(float(h) for h in spacing)
    ndim = samples.ndim
    eps = gradient_scale(samples, spacing)
    interpolating = np.array([all(k % 2 == 0 for k in i) for i in np.ndindex(*(5,) * ndim)])
    fairing = ~interpolating

    coefficients = np.zeros(5**ndim)
    coefficients[interpolating] = samples.ravel()
    previous = None
    for _ in range(iterations + 1):
        matrix = energy_matrix(previous, eps, spacing, thin_plate_weight, quadrature_order)
        right = -matrix[np.ix_(fairing, interpolating)] @ samples.ravel()
        coefficients[fairing] = np.linalg.solve(matrix[np.ix_(fairing, fairing)], right)
        previous = coefficients.copy()
    return coefficients.reshape((5,) * ndim)


# From neighbourhoods to one net ----------------------------------------------------------


def bezier_row(c):
    """Equation 19: the seven Bezier points of one row of five coefficients."""
    return np.array(
        [
            c[0],
            c[1],
            c[2] + c[1] / 4 - c[3] / 4,
            c[2],
            c[2] - c[1] / 4 + c[3] / 4,
            c[3],
            c[4],
        ]
    )


def bezier_patch(coefficients):
    """Equation 19 along every axis: (5,)*d coefficients to (7,)*d Bezier points."""
    patch = coefficients
    for axis in range(coefficients.ndim):
        patch = np.apply_along_axis(bezier_row, axis, patch)
    return patch


def owner(k, n):
    """The inner vertex (1..n-2) nearest to net index `k` of an axis with `n` samples."""
    return min(max(round(k / 3), 1), n - 2)


def fair_net(values, spacing, thin_plate_weight=0.02, iterations=3, quadrature_order=4):
    """Control net, shape ``3 (n - 1) + 1`` per axis, of the fair field through `values`."""
    values = np.asarray(values, float)
    patches = {}
    for vertex in itertools.product(*(range(1, n - 1) for n in values.shape)):
        neighbourhood = values[tuple(slice(v - 1, v + 2) for v in vertex)]
        coefficients = local_coefficients(
            neighbourhood, spacing, thin_plate_weight, iterations, quadrature_order
        )
        patches[vertex] = bezier_patch(coefficients)

    net = np.full([3 * (n - 1) + 1 for n in values.shape], np.nan)
    for index in np.ndindex(*net.shape):
        vertex = tuple(owner(k, n) for k, n in zip(index, values.shape, strict=True))
        local = tuple(k - 3 * (v - 1) for k, v in zip(index, vertex, strict=True))
        net[index] = patches[vertex][local]
    return net


# Evaluation ------------------------------------------------------------------------------


def bernstein(i, degree, t, order=0):
    """Bernstein polynomial, or its derivative of `order`, at `t`."""
    if not 0 <= i <= degree:
        return 0.0
    if order > 0:
        lower = bernstein(i - 1, degree - 1, t, order - 1) - bernstein(i, degree - 1, t, order - 1)
        return degree * lower
    return math.comb(degree, i) * t**i * (1 - t) ** (degree - i)


def evaluate(net, spacing, origin, points, derivative=None):
    """Value (or the partial `derivative`, an order per axis) of the field at `points` (..., d).

    Points outside use the polynomial of the nearest cell.
    """
    net = np.asarray(net, float)
    points = np.asarray(points, float)
    derivative = (0,) * net.ndim if derivative is None else derivative
    result = np.zeros(points.shape[:-1])
    for where in np.ndindex(*result.shape):
        corner, rows = [], []
        for axis in range(net.ndim):
            cells = (net.shape[axis] - 1) // 3
            x = (points[where][axis] - origin[axis]) / spacing[axis]
            cell = min(max(math.floor(x), 0), cells - 1)
            order = derivative[axis]
            corner.append(3 * cell)
            rows.append(
                [bernstein(i, 3, x - cell, order) / spacing[axis] ** order for i in range(4)]
            )
        for i in itertools.product(range(4), repeat=net.ndim):
            weight = math.prod(row[k] for row, k in zip(rows, i, strict=True))
            result[where] += weight * net[tuple(c + k for c, k in zip(corner, i, strict=True))]
    return result


def evaluate_local(coefficients, spacing, s, orders=None):
    """Value (or a physical partial derivative) of one local field at `s` in [0, 2]^d."""
    orders = (0,) * len(s) if orders is None else orders
    return float(coefficients.ravel() @ basis_derivative(s, orders, spacing))


def local_energy(coefficients, previous, eps, spacing, thin_plate_weight=0.02, quadrature_order=4):
    """``integral tr(H M H)`` of one local field with the normals of `previous`."""
    matrix = energy_matrix(previous, eps, tuple(spacing), thin_plate_weight, quadrature_order)
    return float(coefficients.ravel() @ matrix @ coefficients.ravel())
