"""A naive NumPy twin of the global method: slow, plain, any number of dimensions.

It shares nothing with the package but random signs.  Cubic Hermite functions are written out, every
integral is a loop over cells and Gauss points, the matrix is dense, the solver is
``numpy.linalg.solve``.  Everything is float64.

Unknowns are the value and all mixed first derivatives, per cell, at every vertex.  The field
minimises, over what the samples leave free,

    sum over cells and points of weight (tr(H M H) + tension g^T M g + smoothness tr(D^3 M D^3))
    + stiffness sum over samples of ((f - a) / sigma)^2

with ``M = I - (1 - w) N`` constant in a cell, spacing relative to the smallest and values scaled
to spread 1.  The first fit is a thin plate, ``N = 0``.  With a `norm` below 2 every cell counts by
the power ``norm / 2 - 1`` of the energy that the last fit has in it, in every fit but the first.
Springs hold the field also to the outermost `layers` of samples, but do not judge the noise there.
"""

import functools
import itertools
import math
from typing import NamedTuple

import jax
import numpy as np

FLAT = 1e-6
FLOOR = 0.01
REACH = 6
GAUSS_POINTS = 4

# value and slope at t = 0, value and slope at t = 1: coefficients of 1, t, t^2, t^3
HERMITE = {
    (0, 0): (1, 0, -3, 2),
    (0, 1): (0, 1, -2, 1),
    (1, 0): (0, 0, 3, -2),
    (1, 1): (0, 0, -1, 1),
}


class Settings(NamedTuple):
    """As of the engine's method, with its defaults."""

    thin_plate_weight: float = 0.05
    iterations: int = 3
    coherence: float = 1.2
    sharpness: int = 1
    hessian_weight: float = 0.0
    tension: float = 0.0
    smoothness: float = 0.0
    norm: float = 2.0
    sigma: object = None
    cell_weights: object = None
    layers: int = 0


# One cell --------------------------------------------------------------------------------


def hermite(end, part, t, order):
    """Cubic Hermite function of `part` (0 value, 1 slope) at `end`, or a derivative, at `t`."""
    total = 0.0
    for power, coefficient in enumerate(HERMITE[end, part]):
        if power >= order:
            falling = math.prod(range(power - order + 1, power + 1))
            total += coefficient * falling * t ** (power - order)
    return total


def cell_functions(ndim):
    """Corner and parts of the 4^d functions of a cell: two tuples of 0 and 1 each."""
    binary = list(itertools.product((0, 1), repeat=ndim))
    return [(corner, parts) for corner in binary for parts in binary]


def derivative(t, orders, spacing):
    """One physical partial derivative at `t` in [0, 1]^d of every function of a cell: (4^d,)."""
    return np.array(
        [
            math.prod(
                hermite(end, part, x, order) / h**order
                for end, part, x, order, h in zip(corner, parts, t, orders, spacing, strict=True)
            )
            for corner, parts in cell_functions(len(t))
        ]
    )


class Point(NamedTuple):
    """A Gauss point of a cell with the derivatives of all 4^d functions there."""

    weight: float
    gradients: np.ndarray  # (4^d, d)
    hessians: np.ndarray  # (4^d, d, d)
    thirds: np.ndarray  # (4^d, d * d, d)


@functools.cache
def gauss_points(spacing):
    """Gauss points of a cell; its volume counts as 1."""
    nodes, weights = np.polynomial.legendre.leggauss(GAUSS_POINTS)
    on_axis = [((node + 1) / 2, weight / 2) for node, weight in zip(nodes, weights, strict=True)]
    axes = range(len(spacing))
    points = []
    for point in itertools.product(on_axis, repeat=len(spacing)):
        t = [node for node, _ in point]
        gradients = [derivative(t, [int(a == k) for k in axes], spacing) for a in axes]
        hessians = [
            [derivative(t, [(a == k) + (b == k) for k in axes], spacing) for b in axes]
            for a in axes
        ]
        thirds = [
            [derivative(t, [(a, b, c).count(k) for k in axes], spacing) for c in axes]
            for a in axes
            for b in axes
        ]
        points.append(
            Point(
                math.prod(weight for _, weight in point),
                np.moveaxis(np.array(gradients), -1, 0),
                np.moveaxis(np.array(hessians), -1, 0),
                np.moveaxis(np.array(thirds), -1, 0),
            )
        )
    return points


# All cells -------------------------------------------------------------------------------


def cells_of(shape):
    """Indices of all cells of a grid."""
    return itertools.product(*(range(n - 1) for n in shape))


def unknowns_of(cell, shape):
    """Numbers of the 4^d unknowns of a cell; a vertex has 2^d in a row."""
    numbers = []
    for corner, parts in cell_functions(len(shape)):
        vertex = np.ravel_multi_index([c + k for c, k in zip(cell, corner, strict=True)], shape)
        numbers.append(int(vertex) * 2 ** len(shape) + int("".join(map(str, parts)), 2))
    return numbers


def structure_tensors(unknowns, shape, spacing, hessian_weight):
    """Integral of g g^T + hessian_weight H H^T over every cell, shape (*cells, d, d)."""
    ndim = len(shape)
    tensors = np.zeros([n - 1 for n in shape] + [ndim, ndim])
    for cell in cells_of(shape):
        local = unknowns[unknowns_of(cell, shape)]
        for point in gauss_points(spacing):
            g = local @ point.gradients
            h = np.tensordot(local, point.hessians, 1)
            tensors[cell] += point.weight * (np.outer(g, g) + hessian_weight * h @ h.T)
    return tensors


def mirrored(index, count):
    """The cell that stands at `index` when the cells are mirrored at both borders, repeatedly."""
    index %= 2 * count
    return index if index < count else 2 * count - 1 - index


def smoothed(tensors, width, ndim):
    """Gaussian average of the tensors over cells, one axis after the other."""
    offsets = range(-REACH, REACH + 1)
    weights = np.array([math.exp(-0.5 * (k / width) ** 2) for k in offsets])
    weights /= weights.sum()
    for axis in range(ndim):
        result = np.zeros_like(tensors)
        for cell in np.ndindex(*tensors.shape[:ndim]):
            for k, weight in zip(offsets, weights, strict=True):
                source = list(cell)
                source[axis] = mirrored(cell[axis] + k, tensors.shape[axis])
                result[cell] += weight * tensors[tuple(source)]
        tensors = result
    return tensors


def normal_tensors(tensors, sharpness, ndim):
    """``J^p / tr(J^p)``, fading to zero where gradients are below `FLAT`."""
    normals = np.zeros_like(tensors)
    for cell in np.ndindex(*tensors.shape[:ndim]):
        trace = np.trace(tensors[cell]) + FLAT**2
        power = np.linalg.matrix_power(tensors[cell] / trace, sharpness)
        normals[cell] = power / (np.trace(power) + FLAT**2 / trace)
    return normals


def cell_matrices(normals, shape, spacing, settings):
    """The matrix of the energy of every cell; `normals` None means ``N = 0``."""
    ndim, weight = len(shape), settings.thin_plate_weight
    matrices = {}
    for cell in cells_of(shape):
        m = np.eye(ndim) if normals is None else np.eye(ndim) - (1 - weight) * normals[cell]
        local = np.zeros((4**ndim, 4**ndim))
        for point in gauss_points(spacing):
            left = (point.hessians @ m).reshape(4**ndim, -1)
            local += point.weight * left @ point.hessians.reshape(4**ndim, -1).T
            local += point.weight * settings.tension * (point.gradients @ m) @ point.gradients.T
            left = (point.thirds @ m).reshape(4**ndim, -1)
            right = point.thirds.reshape(4**ndim, -1)
            local += point.weight * settings.smoothness * left @ right.T
        matrices[cell] = local
    return matrices


def cell_powers(matrices, unknowns, shape, norm):
    """How much every cell counts: a power of its energy in the last fit, with a mean of 1."""
    powers = {}
    for cell, local in matrices.items():
        own = unknowns[unknowns_of(cell, shape)]
        powers[cell] = max(own @ local @ own, 0.0)
    mean = np.mean(list(powers.values())) + FLAT**2
    powers = {cell: (e / mean + FLOOR) ** (norm / 2 - 1) for cell, e in powers.items()}
    mean = np.mean(list(powers.values()))
    return {cell: power / mean for cell, power in powers.items()}


def energy_matrix(normals, unknowns, shape, spacing, settings):
    """The dense matrix of the energy, after a fit with normals and unknowns, or before any."""
    size = math.prod(shape) * 2 ** len(shape)
    matrix = np.zeros((size, size))
    matrices = cell_matrices(normals, shape, spacing, settings)
    powers = dict.fromkeys(matrices, 1.0)
    if unknowns is not None:
        powers = cell_powers(matrices, unknowns, shape, settings.norm)
    for cell, local in matrices.items():
        weight = powers[cell]
        if settings.cell_weights is not None:
            weight = weight * settings.cell_weights[cell]
        numbers = unknowns_of(cell, shape)
        matrix[np.ix_(numbers, numbers)] += weight * local
    return matrix


# The fit ---------------------------------------------------------------------------------


def solve_exactly(matrix, samples):
    """Least energy with the known samples fixed."""
    twos = len(matrix) // samples.size
    fixed = np.flatnonzero(~np.isnan(samples)) * twos
    free = np.setdiff1d(np.arange(len(matrix)), fixed)
    unknowns = np.zeros(len(matrix))
    unknowns[fixed] = samples[~np.isnan(samples)]
    right = -matrix[np.ix_(free, fixed)] @ unknowns[fixed]
    unknowns[free] = np.linalg.solve(matrix[np.ix_(free, free)], right)
    return unknowns


def solve_with_springs(matrix, samples, pins):
    """Least energy with springs of strength `pins` to the known samples."""
    twos = len(matrix) // samples.size
    values = np.arange(samples.size) * twos
    springs = matrix.copy()
    springs[values, values] += pins
    right = np.zeros(len(matrix))
    right[values] = pins * np.nan_to_num(samples)
    return np.linalg.solve(springs, right)


def next_stiffness(stiffnesses, excesses, first, left):
    """Softer than what the forces of the exact fit ask for, then along a secant of logarithms."""
    if len(stiffnesses) == 1:
        return 0.03 * np.sqrt(max(first, FLAT**2))
    power = 1 / max(1 - left, 1 / 3)
    if len(stiffnesses) > 2 and abs(np.log(excesses[-1] / excesses[-2])) > 0.1:
        stiffer = np.log(stiffnesses[-1] / stiffnesses[-2])
        power = -stiffer / np.log(excesses[-1] / excesses[-2])
    return stiffnesses[-1] * excesses[-1] ** np.clip(power, 0.7, 3)


def fit(values, spacing, settings):
    """Unknowns (vertices, 2^d) in the units of the values."""
    shape, ndim = values.shape, values.ndim
    spacing = tuple(float(h) / min(spacing) for h in spacing)
    low, high = np.nanmin(values), np.nanmax(values)
    centre, spread = (low + high) / 2, (high - low) or 1.0
    samples = ((values - centre) / spread).ravel()
    signs = None
    if settings.sigma is not None:
        relative = np.broadcast_to(np.asarray(settings.sigma, float), shape).ravel() / spread
        trust = np.where(np.isnan(samples), 0, 1 / relative**2)
        stiffnesses, excesses = [np.inf], []
        signs = np.asarray(jax.random.rademacher(jax.random.key(0), samples.shape, float))
        signs = np.where(trust > 0, signs, 0)
        judged = np.zeros(shape, bool)
        judged[tuple(slice(settings.layers, n - settings.layers) for n in shape)] = True
        known = judged.ravel() & (trust > 0)

    unknowns, normals = None, None
    for iteration in range(settings.iterations + 1):
        if iteration:
            tensors = structure_tensors(unknowns, shape, spacing, settings.hessian_weight)
            tensors = smoothed(tensors, settings.coherence, ndim)
            normals = normal_tensors(tensors, settings.sharpness, ndim)
        matrix = energy_matrix(normals, unknowns, shape, spacing, settings)
        if settings.sigma is None or not iteration:
            unknowns, followed = solve_exactly(matrix, samples), signs
        else:
            pins = stiffnesses[-1] * trust
            unknowns = solve_with_springs(matrix, samples, pins)
            followed = solve_with_springs(matrix, signs, pins)[:: 2**ndim]
        if settings.sigma is not None:
            left = max((signs * (signs - followed))[known].mean(), 1e-3)
            forces = (matrix @ unknowns)[:: 2**ndim][known]
            deviations = (unknowns[:: 2**ndim] - np.nan_to_num(samples)) ** 2 * trust
            excesses.append(max(deviations[known].sum() / (left * known.sum()), FLAT**2))
            first = (forces**2).sum() / trust[known].sum()
            stiffness = next_stiffness(stiffnesses, excesses, first, left)
            stiffnesses.append(max(stiffness, 1e-6 / max(trust[known].max(), 1)))
    unknowns = unknowns.reshape(-1, 2**ndim) * spread
    unknowns[:, 0] += centre
    return unknowns


def fair_net(values, spacing, **settings):
    """Control net, shape ``3 (n - 1) + 1`` per axis, of the globally fair field."""
    values = np.asarray(values, float)
    unknowns = fit(values, spacing, Settings(**settings))
    net = np.full([3 * (n - 1) + 1 for n in values.shape], np.nan)
    binary = list(itertools.product((0, 1), repeat=values.ndim))
    for index in np.ndindex(*net.shape):
        vertex = [round(k / 3) for k in index]
        thirds = [(k - 3 * v) / 3 for k, v in zip(index, vertex, strict=True)]
        local = unknowns[np.ravel_multi_index(vertex, values.shape)]
        net[index] = sum(
            value * math.prod(x for x, part in zip(thirds, parts, strict=True) if part)
            for value, parts in zip(local, binary, strict=True)
        )
    return net
