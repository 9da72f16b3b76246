"""What people use instead, behind one signature.

Every method is ``callable(values, spacing, factor) -> refined``: the samples come first and every
``factor`` th value of the result, in each direction, is a sample again.  `jax.image.resize` and
the zoom of image libraries shift by half a pixel and are left out for that reason.
"""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.interpolate import RBFInterpolator, make_interp_spline
from skimage.restoration import inpaint_biharmonic

Array = NDArray[np.float64]
Spacing: TypeAlias = float | Sequence[float]
Method: TypeAlias = Callable[[Array, Spacing, int], Array]
Points: TypeAlias = Callable[[Array, Array], Array]


def refined_axes(shape: Sequence[int], factor: int) -> list[Array]:
    """Index coordinates of the refined grid, one array per axis."""
    return [np.arange((n - 1) * factor + 1) / factor for n in shape]


def _along_axes(values: Array, factor: int, build: Callable[[int, int], Array]) -> Array:
    """Apply one sparse matrix per axis: refined samples of a tensor-product method."""
    for axis, count in enumerate(values.shape):
        first = np.moveaxis(values, axis, 0)
        # Sparse, so that a NaN meets no zero weights and stays within the support of the kernel.
        flat = sparse.csr_array(build(count, factor)) @ first.reshape(count, -1)
        values = np.moveaxis(flat.reshape(-1, *first.shape[1:]), 0, axis)
    return values


def _linear_matrix(count: int, factor: int) -> Array:
    (x,) = refined_axes((count,), factor)
    return np.maximum(1.0 - np.abs(x[:, None] - np.arange(count)), 0.0)


def _catmull_rom_matrix(count: int, factor: int) -> Array:
    """Keys' cubic convolution, one ghost sample per end by linear continuation."""
    (x,) = refined_axes((count,), factor)
    t = np.abs(x[:, None] - np.arange(-1, count + 1))
    near = 1.5 * t**3 - 2.5 * t**2 + 1.0
    far = -0.5 * t**3 + 2.5 * t**2 - 4.0 * t + 2.0
    kernel = np.where(t < 1.0, near, np.where(t < 2.0, far, 0.0))
    ghosts = np.zeros((count + 2, count))
    ghosts[1:-1] = np.eye(count)
    ghosts[0, :2] = ghosts[-1, :-3:-1] = (2.0, -1.0)
    return kernel @ ghosts


def linear(values: Array, spacing: Spacing, factor: int) -> Array:
    """Bilinear or trilinear interpolation."""
    return _along_axes(values, factor, _linear_matrix)


def catmull_rom(values: Array, spacing: Spacing, factor: int) -> Array:
    """Cubic convolution: what image libraries call bicubic."""
    return _along_axes(values, factor, _catmull_rom_matrix)


def _not_a_knot(values: Array, factor: int, degree: int) -> Array:
    for axis, x in enumerate(refined_axes(values.shape, factor)):
        knots = np.arange(values.shape[axis])
        values = make_interp_spline(knots, values, k=degree, axis=axis)(x)
    return values


def _mirror(values: Array, factor: int, degree: int) -> Array:
    where = np.meshgrid(*refined_axes(values.shape, factor), indexing="ij", sparse=False)
    return ndimage.map_coordinates(values, where, order=degree, mode="mirror")


def cubic(values: Array, spacing: Spacing, factor: int) -> Array:
    """Cubic B-spline with not-a-knot ends, as RectBivariateSpline and RegularGridInterpolator."""
    return _not_a_knot(values, factor, 3)


def cubic_mirror(values: Array, spacing: Spacing, factor: int) -> Array:
    """Cubic B-spline mirrored at the ends, as `scipy.ndimage`."""
    return _mirror(values, factor, 3)


def quintic(values: Array, spacing: Spacing, factor: int) -> Array:
    """Quintic B-spline mirrored at the ends, as `scipy.ndimage`."""
    return _mirror(values, factor, 5)


def quintic_not_a_knot(values: Array, spacing: Spacing, factor: int) -> Array:
    """Quintic B-spline with not-a-knot ends, as RectBivariateSpline with ``kx = ky = 5``."""
    return _not_a_knot(values, factor, 5)


def _grid_points(axes: Sequence[Array], spacing: Spacing) -> Array:
    steps = np.broadcast_to(np.asarray(spacing, float), (len(axes),))
    grids = np.meshgrid(*[a * s for a, s in zip(axes, steps, strict=True)], indexing="ij")
    return np.stack([g.ravel() for g in grids], axis=-1)


def thin_plate_rbf(
    values: Array,
    spacing: Spacing,
    factor: int,
    smoothing: float = 0.0,
    neighbors: int | None = 30,
) -> Array:
    """Thin-plate radial basis functions over the nearest samples, or all for None."""
    known = _grid_points([np.arange(n, dtype=float) for n in values.shape], spacing)
    axes = refined_axes(values.shape, factor)
    wanted = _grid_points(axes, spacing)
    valid = np.isfinite(values.ravel())
    kernel = RBFInterpolator(
        known[valid],
        values.ravel()[valid],
        neighbors=neighbors,
        smoothing=smoothing,
        kernel="thin_plate_spline",
    )
    return kernel(wanted).reshape([len(a) for a in axes])


def interpax_cubic2(values: Array, spacing: Spacing, factor: int) -> Array:
    """Interpax's C2 cubic splines (JAX)."""
    import interpax

    knots = [np.arange(n, dtype=float) for n in values.shape]
    where = np.meshgrid(*refined_axes(values.shape, factor), indexing="ij")
    flat = [w.ravel() for w in where]
    evaluate: Callable[..., Any] = interpax.interp2d if values.ndim == 2 else interpax.interp3d
    return np.asarray(evaluate(*flat, *knots, values, method="cubic2")).reshape(where[0].shape)


def biharmonic(values: Array) -> Array:
    """Fill NaN by biharmonic inpainting (scikit-image)."""
    missing = np.isnan(values)
    return inpaint_biharmonic(np.where(missing, 0.0, values), missing)


LINEAR, CATMULL_ROM, CUBIC, QUINTIC = "linear", "Catmull-Rom", "cubic", "quintic"
SPLINES: dict[str, Method] = {
    LINEAR: linear,
    CATMULL_ROM: catmull_rom,
    CUBIC: cubic,
    QUINTIC: quintic,
}
"""The four that real data are compared with."""

OTHER_ENDS: dict[str, Method] = {
    "cubic, mirror": cubic_mirror,
    "quintic, not-a-knot": quintic_not_a_knot,
}


def at_points(order: int) -> Points:
    """Spline of ``order`` at arbitrary points: ``callable(values, index_points) -> values``."""

    def evaluate(values: Array, points: Array) -> Array:
        return ndimage.map_coordinates(values, points.T, order=order, mode="mirror")

    return evaluate


def catmull_rom_at(values: Array, points: Array) -> Array:
    """Cubic convolution at arbitrary interior points, given in index coordinates."""
    base = np.floor(points).astype(int)
    t = points - base
    total = np.zeros(len(points))
    weights = np.stack(
        [
            -0.5 * t + t**2 - 0.5 * t**3,
            1.0 - 2.5 * t**2 + 1.5 * t**3,
            0.5 * t + 2.0 * t**2 - 1.5 * t**3,
            -0.5 * t**2 + 0.5 * t**3,
        ]
    )
    for offset in np.ndindex(*(4,) * values.ndim):
        weight = np.prod([weights[o, :, k] for k, o in enumerate(offset)], axis=0)
        total += weight * values[tuple((base + np.array(offset) - 1).T)]
    return total


POINTS: dict[str, Points] = {
    LINEAR: at_points(1),
    CATMULL_ROM: catmull_rom_at,
    CUBIC: at_points(3),
    QUINTIC: at_points(5),
}
