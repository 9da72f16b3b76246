"""Isosurfaces of a 3-D field."""

from dataclasses import dataclass

import numpy as np

from .._bezier.curvature import full_hessian, host_gaussian_curvature, host_mean_curvature
from .._bezier.host import HostField, known
from .._bezier.nets import PlacedNet
from .._level_sets import check_levels, check_tolerance, rounding_note, values_of
from .._support.checks import Scalar
from .._support.results import Progress, untold
from ._lattice import surface_of
from ._mesh import edges_of, open_edges, triangle_normals
from ._refine import split


@dataclass(frozen=True, eq=False)
class Isosurface:
    """A triangle mesh of one level.

    Parameters
    ----------
    level : float
    vertices : array, shape (n, 3)
        In physical coordinates, coordinate k along array axis k.
    triangles : array of int, shape (m, 3)
        Corners turn left around the gradient: seen from where the field is larger, they run
        counter-clockwise in right-handed coordinates.
    normals : array, shape (n, 3)
        Unit vectors along the gradient, towards larger values.
    mean_curvature : array, shape (n,)
        The mean of the principal curvatures, 1 / length, with the sign of
        `BezierField.mean_curvature`: positive where the surface bends away from the gradient, 1 / r
        for a ball of smaller values.
    gaussian_curvature : array, shape (n,)
        The product of the principal curvatures, 1 / length^2.
    unmet : int
        Edges that may be farther from the surface than the tolerance: where the field is too rough
        for the mesh to follow it.
    unproved : int
        Cells away from the mesh that may hold a part of the surface smaller than 1/32 of a cell, or
        1/8 where there are more than 2048 such cells: the field comes near to the level there, or
        touches it, and no sample that close is beyond it.
    notes : tuple of str
        What is to be known about the mesh.

    Notes
    -----
    Where the gradient vanishes, curvatures are 0, and the normal is that of the triangles.
    """

    level: float
    vertices: np.ndarray
    triangles: np.ndarray
    normals: np.ndarray
    mean_curvature: np.ndarray
    gaussian_curvature: np.ndarray
    unmet: int
    unproved: int
    notes: tuple[str, ...]

    @property
    def area(self) -> float:
        """Area of the triangles, in squared units of the coordinates."""
        return 0.5 * float(
            np.linalg.norm(triangle_normals(self.vertices, self.triangles), axis=1).sum()
        )

    @property
    def watertight(self) -> bool:
        """Whether the surface is closed: without a border, all around what it encloses.

        Its triangles then pass along every edge as often in one direction as in the other.
        """
        return open_edges(self.triangles) == 0

    @property
    def volume(self) -> float:
        """Volume within a watertight surface, negative around larger values; else NaN."""
        if not self.watertight:
            return float("nan")
        corners = (self.vertices - self.vertices[:1])[self.triangles]
        return float(np.linalg.det(corners).sum()) / 6

    @property
    def euler_characteristic(self) -> int:
        """Vertices less edges plus triangles: 2 for each sphere, 0 for a torus."""
        return len(self.vertices) - len(edges_of(self.triangles).ends) + len(self.triangles)

    def __repr__(self) -> str:
        return (
            f"Isosurface(level {self.level:g}, {len(self.vertices)} vertices, "
            f"{len(self.triangles)} triangles)"
        )


def isosurface(
    field: PlacedNet,
    level: Scalar,
    tolerance: Scalar = 0.01,
    *,
    progress: Progress = untold,
) -> Isosurface:
    """The surface of a 3-D field where it has one value.

    Parameters
    ----------
    field : BezierField
    level : float
    tolerance : float
        Triangles stay within about this distance of the true surface, in cells.
    progress : callable
        Called as ``progress(done, all)``: the first half are blocks of cells, the second edges.

    Returns
    -------
    Isosurface
        Every edge has two triangles but those on the border of the grid and of cells that hold NaN,
        where the surface ends.  Without triangles, and with a note, for a level that the field does
        not have.

    Raises
    ------
    ValueError
        For a field that is not 3-D, a level that is not one finite number, a tolerance below 1e-8,
        or more triangles than fit in memory.

    Notes
    -----
    Cells are cut into cubes of half their side.  A cube with corners on both sides of the level has
    triangles as its corners tell: what is smaller in it, and what reaches from it into cubes beside
    it, can be missed.  Parts that stay away from all such cubes are found however small they are,
    with a finer lattice, or counted in `unproved`: where this is 0, there are no others.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> import contourfair_jax as cf
    >>> x = jnp.linspace(-1.0, 1.0, 8)
    >>> radius = jnp.sqrt(x[:, None, None] ** 2 + x[:, None] ** 2 + x**2)
    >>> field = cf.fair_field(radius, spacing=2 / 7, origin=-1.0)
    >>> ball = field.isosurface(0.6)
    >>> ball.watertight, ball.euler_characteristic
    (True, 2)
    """
    if field.ndim != 3:
        raise ValueError(
            f"field must be 3-D to have isosurfaces, got {field.ndim}-D; use its contours"
        )
    if np.ndim(level) != 0:
        raise ValueError(f"level must be one number, got shape {np.shape(level)}; call for each")
    chosen = check_levels(level)
    tolerance = check_tolerance(tolerance)
    field = known(field)
    net = np.asarray(field.control_points)
    values = values_of(net)
    traced = float(values.placed(chosen)[0])
    host = HostField(net.astype(np.float64) - values.middle)
    finite = np.abs(host.net[np.isfinite(host.net)])
    rounding = 32 * float(np.finfo(np.float64).eps) * float(finite.max(initial=0.0))
    surface, unproved = surface_of(
        host, traced, rounding, lambda done, total: progress(done, 2 * total)
    )
    surface, unmet = split(
        host,
        surface,
        traced,
        tolerance,
        rounding,
        lambda done, total: progress(total + done, 2 * total),
    )
    spacing, origin = (np.asarray(x, dtype=np.float64) for x in (field.spacing, field.origin))
    normals, mean, gaussian = _shape(host, surface.vertices, spacing)
    vertices = surface.vertices * spacing + origin
    return Isosurface(
        float(chosen[0]),
        vertices,
        surface.triangles,
        _filled(normals, vertices, surface.triangles),
        mean,
        gaussian,
        unmet,
        unproved,
        (
            *_notes(float(chosen[0]), len(vertices), unmet, unproved),
            *rounding_note(values, "surfaces"),
        ),
    )


def _notes(level: float, vertices: int, unmet: int, unproved: int) -> tuple[str, ...]:
    notes = []
    if not vertices:
        known = "no surface was found" if unproved else "the field has no surface"
        notes.append(f"{known} at level {level:g}")
    if unproved:
        notes.append(f"{unproved} cells may hold small parts that the surface does not show")
    if unmet:
        notes.append(
            f"{unmet} edges may be farther from the surface than the tolerance, where the field is "
            "too rough for it: take a larger tolerance, or finer samples"
        )
    return tuple(notes)


def _shape(
    host: HostField, points: np.ndarray, spacing: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit normals (NaN where the gradient vanishes), mean and Gaussian curvature."""
    _, first, second = host.jet(points, 2)
    rows, columns = np.triu_indices(3)
    first = first / spacing[:, None]
    second = second / (spacing[rows] * spacing[columns])[:, None]
    size, mean = host_mean_curvature(list(first), list(second))
    gaussian = host_gaussian_curvature(first.T, full_hessian(second.T, 3))
    with np.errstate(divide="ignore", invalid="ignore"):
        normals = (first / size).T
    return normals, mean, gaussian


def _filled(normals: np.ndarray, vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Normals, those that are NaN from the triangles around."""
    missing = np.flatnonzero(~np.isfinite(normals).all(1))
    if not len(missing):
        return normals
    sums = np.zeros_like(normals)
    np.add.at(sums, triangles, triangle_normals(vertices, triangles)[:, None])
    size = np.linalg.norm(sums[missing], axis=1, keepdims=True)
    upwards = np.array([0.0, 0.0, 1.0])  # of a vertex whose triangles have no area
    normals[missing] = np.where(size > 0, sums[missing] / np.where(size > 0, size, 1), upwards)
    return normals
