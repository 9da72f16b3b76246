"""The result of fairing: an immutable C1 piecewise cubic field."""

from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._bezier.curvature import full_hessian, mean_curvature
from ._bezier.evaluate import OUTSIDE, partials
from ._bezier.nets import cell_extreme, refine_axis
from ._fairing.method import FitReport
from ._support import checks
from ._support.arrays import finest
from ._support.public import former_keyword

if TYPE_CHECKING:
    from vtkmodules.vtkCommonDataModel import vtkUnstructuredGrid

    from ._level_sets import Levels
    from .adaptive import AdaptiveField
    from .contours import Bands, Contours
    from .isosurface import Isosurface


class BezierField(eqx.Module):
    """A C1 piecewise bicubic (tricubic) field in Bezier form.

    Sample (i, j) lies at `origin + (i, j) * spacing`; array axis k is coordinate k.  A pytree whose
    leaves are the three arrays below: fields pass through `jax.jit`, `jax.vmap` and `jax.grad`.

    Parameters
    ----------
    control_points : array, shape (3 (n_1 - 1) + 1, ..., 3 (n_d - 1) + 1)
        The Bezier net; every third point along all axes is a sample.
    spacing : array, shape (ndim,)
        Distance of samples along each axis.
    origin : array, shape (ndim,)
        Position of the first sample.  `fair_field` keeps both in float64, as NumPy arrays, where
        they are known.
    report : FitReport or None
        Steps, residuals, convergence and filled samples of an iterative fit (`GlobalFairing`).

    Notes
    -----
    Points outside the grid follow the `outside` argument of each call: "nan" gives NaN, "clamp"
    moves the point to the nearest point of the grid (derivatives are those of the field there),
    "extend" continues the polynomials of the border cells.  A cell with NaN among its net points is
    NaN, and a point on a face is in the cell above: next to missing samples `samples` and `refine`
    have values that a call at the same place may not have.  A point with a NaN coordinate is NaN.

    Points that are NumPy arrays or lists are placed in the grid in float64, whatever JAX computes
    in: coordinates of maps have more digits than float32.  That needs spacing and origin that are
    NumPy arrays too; those of a field that comes out of `jax.jit` are JAX arrays.

    `jax.vmap` gives a batch of fields in one object: its arrays have an axis more, and its methods
    are to be called inside `jax.vmap` too.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> import contourfair_jax as cf
    >>> x = jnp.arange(5.0)
    >>> field = cf.fair_field(x[:, None] + 2 * x[None, :])
    >>> float(field(jnp.array([1.25, 2.5])).round(4))
    6.25
    """

    control_points: Float[Array, "*net"]
    spacing: Float[Array | np.ndarray, " ndim"]
    origin: Float[Array | np.ndarray, " ndim"]
    report: FitReport | None = None

    @property
    def ndim(self) -> int:
        """Spatial dimensions, 2 or 3.

        Raises
        ------
        ValueError
            For a batch of fields.
        """
        ndim = self.spacing.shape[-1]
        if self.control_points.ndim != ndim:
            raise ValueError(
                f"field must be one field, got a batch of them, with control points of shape "
                f"{self.control_points.shape} in {ndim}-D; call its methods inside jax.vmap, as in "
                "jax.vmap(lambda field: field.refine(2))(fields)"
            )
        return ndim

    @property
    def shape(self) -> tuple[int, ...]:
        """Samples along each axis."""
        return tuple((n - 1) // 3 + 1 for n in self.control_points.shape[-self.ndim :])

    @property
    def dtype(self) -> jnp.dtype:
        """The dtype of the field's values."""
        return self.control_points.dtype

    @property
    def samples(self) -> Float[Array, "*shape"]:
        """The samples the field passes through."""
        return self.control_points[(slice(None, None, 3),) * self.ndim]

    def __call__(self, points: checks.Points, outside: str = "nan") -> Float[Array, " *batch"]:
        """Values at physical coordinates, shape (..., ndim) -> (...).

        Raises
        ------
        ValueError
            For points whose last axis is not `ndim` long, or an unknown `outside`.
        """
        return self._derivatives(points, outside, 0)[0][..., 0]

    def gradient(self, points: checks.Points, outside: str = "nan") -> Float[Array, "*batch ndim"]:
        """Gradients at physical coordinates, in units of value per length.

        Raises
        ------
        ValueError
            As for a call of the field.
        """
        return self.value_and_gradient(points, outside)[1]

    def value_and_gradient(
        self, points: checks.Points, outside: str = "nan"
    ) -> tuple[Array, Array]:
        """Values (...) and gradients (..., ndim) at physical coordinates, from one gather.

        Raises
        ------
        ValueError
            As for a call of the field.
        """
        value, gradient = self._derivatives(points, outside, 1)
        return value[..., 0], gradient

    def hessian(
        self, points: checks.Points, outside: str = "nan"
    ) -> Float[Array, "*batch ndim ndim"]:
        """Hessians at physical coordinates; on the faces of cells, of the cell above.

        Raises
        ------
        ValueError
            As for a call of the field.
        """
        return self.jet(points, outside)[2]

    def jet(self, points: checks.Points, outside: str = "nan") -> tuple[Array, Array, Array]:
        """Value (...), gradient (..., ndim) and Hessian (..., ndim, ndim), from one gather.

        Raises
        ------
        ValueError
            As for a call of the field.
        """
        value, gradient, second = self._derivatives(points, outside, 2)
        return value[..., 0], gradient, full_hessian(second, self.ndim)

    def mean_curvature(
        self, points: checks.Points, outside: str = "nan"
    ) -> Float[Array, " *batch"]:
        """Mean curvature of the level set through each point, in units of 1 / length.

        `tr(H P) / ((ndim - 1) |g|)` with `P = I - n n^T`: the curvature of a contour in 2-D, the
        mean of the principal curvatures of an isosurface in 3-D.  Positive where the level set
        bends away from the gradient: 1 / r for the field |x|.  Zero where the gradient vanishes, up
        to the rounding of the values.

        Raises
        ------
        ValueError
            As for a call of the field.
        """
        value, gradient, hessian = self.jet(points, outside)
        return mean_curvature(value, gradient, hessian, jnp.asarray(self.spacing, value.dtype))

    def refine(self, factor: checks.Factors) -> Float[Array, "*fine"]:
        """Samples on the `factor` times finer grid, factor (n - 1) + 1 per axis.

        Sample i of the field is sample `factor * i` of the result, bit for bit.

        Parameters
        ----------
        factor : int or sequence of ndim ints
            One for each axis where they differ: ``(1, 1, 5)`` for slices that are far apart.

        Raises
        ------
        ValueError
            For a factor that is not an integer of at least 1.
        """
        values = self.control_points
        for axis, finer in enumerate(checks.check_factors(factor, self.ndim)):
            values = refine_axis(values, axis, finer)
        return values

    def bounds(self) -> tuple[Float[Array, "*cells"], Float[Array, "*cells"]]:
        """Lower and upper bound of the field in every cell, n - 1 cells per axis.

        The smallest and largest net point: a polynomial stays within its Bezier points.
        """
        lower = cell_extreme(self.control_points, jnp.minimum)
        upper = cell_extreme(self.control_points, jnp.maximum)
        return lower, upper

    def contours(self, levels: "Levels", tolerance: checks.Scalar = 0.01) -> "Contours":
        """Contour lines of a 2-D field; see `contourfair_jax.contours.contours`."""
        from .contours import contours

        return contours(self, levels, tolerance)

    def filled(self, levels: "Levels", tolerance: checks.Scalar = 0.01) -> "Bands":
        """Polygons between levels of a 2-D field; see `contourfair_jax.contours.filled`."""
        from .contours import filled

        return filled(self, levels, tolerance)

    def isosurface(self, level: checks.Scalar, tolerance: checks.Scalar = 0.01) -> "Isosurface":
        """The surface of a 3-D field at a level; see `contourfair_jax.isosurface.isosurface`."""
        from .isosurface import isosurface

        return isosurface(self, level, tolerance)

    @former_keyword("tolerance", "error")
    def adaptive(self, error: checks.Scalar) -> "AdaptiveField":
        """A quadtree or octree within `error`; see `contourfair_jax.adaptive.adaptive`."""
        from .adaptive import adaptive

        return adaptive(self, error)

    def to_vtk(self) -> "vtkUnstructuredGrid":
        """The field as exact Bezier cells of VTK, Bezier points as point data ``field``.

        Coordinate k of the field is x, y, z of VTK in this order.  Cells with NaN are left out.
        Needs the extra ``vtk``.

        Raises
        ------
        MissingPackageError
            Where VTK is not installed.
        """
        from ._vtk import bezier_grid

        return bezier_grid(self)

    def to_bspline(
        self,
    ) -> tuple[tuple[Float[Array | np.ndarray, " _knots"], ...], Float[Array, "*twice"]]:
        """The same field as a cubic B-spline with double knots.

        Returns
        -------
        knots : tuple of arrays, each of length 2 n + 4
            In float64, of NumPy, where the spacing and the origin are.
        coefficients : array, shape (2 n_1, ..., 2 n_d)
            `scipy.interpolate.NdBSpline(knots, coefficients, 3)` is the field, inside the grid.

        Notes
        -----
        Of the Bezier net the points on inner cell faces are dropped: C1 makes them averages of
        their neighbours (end of section 4.2 of the paper).
        """
        knots, coefficients = [], self.control_points
        spacing, origin = self.spacing, self.origin
        if isinstance(spacing, jax.Array) or isinstance(origin, jax.Array):
            spacing, origin = finest(spacing, origin)
        for axis, n in enumerate(self.shape):
            vertices = np.repeat(np.arange(n), [4, *[2] * (n - 2), 4]).astype(spacing.dtype)
            knots.append(origin[axis] + spacing[axis] * vertices)
            kept = [k for k in range(3 * n - 2) if k % 3 or k in (0, 3 * n - 3)]
            coefficients = jnp.take(coefficients, jnp.array(kept), axis=axis)
        return tuple(knots), coefficients

    def _derivatives(self, points: checks.Points, outside: str, order: int) -> list[Array]:
        """Partial derivatives of orders 0 to `order` at physical coordinates."""
        checks.check_choice(outside, OUTSIDE, "outside")
        places = checks.check_points(points, self.ndim)
        return partials(self.control_points, self.spacing, self.origin, places, outside, order)
