"""`Grid`: samples together with where they lie and what they mean."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from .._support.errors import InputError
from .affine import (
    crop_affine,
    diagonal_affine,
    origin_of,
    refine_affine,
    refined_shape,
    spacing_of,
)

_NAMES = {1: ("x",), 2: ("y", "x"), 3: ("z", "y", "x")}


def exact_float(dtype: np.dtype) -> np.dtype:
    """The smallest of float32 and float64 that holds every value of `dtype` (64-bit: nearest)."""
    small = 4 if dtype.kind == "f" else 2
    return np.dtype(np.float32 if dtype.itemsize <= small else np.float64)


def no_samples(shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """Zeros that take no memory, in the place of samples that are not there yet."""
    return np.broadcast_to(np.zeros((), dtype), shape)


@dataclass(frozen=True, eq=False)
class Grid:
    """Samples of a scalar field on a regular grid, with their geometry.

    Everything per axis is in array order.  The coordinates of a fair field are
    ``origin + spacing * index``; `world` maps them to the coordinates of the file.

    Parameters
    ----------
    values
        The samples, native byte order.  Missing samples are NaN, so data with missing samples are
        floats.
    spacing
        Distance between samples per axis, positive; by default the steps of `affine`, or 1.
    origin
        Field coordinates of sample 0; by default its world coordinates where the grid is aligned
        with the world and no axis descends, otherwise zeros.
    axes
        Names of the array's axes; by default ``y, x`` or ``z, y, x``.
    units
        What `values` are measured in, ``""`` where unknown.
    crs
        Coordinate reference system of the world: WKT, or a code such as ``EPSG:4326``.
    affine
        Sample index to world, shape ``(d + 1, d + 1)``, both in array order, at sample centres.
        None where the file does not say where the samples lie.
    nodata
        The value that stands for a missing sample in the file.
    missing
        True where a sample is missing; None where none is.
    metadata
        Further text that came with the file and is written back where the format can.
    notes
        What a reader had to decide, one line each, to be told to the user.
    bands
        The keys that choose the bands of the file, or the channels of a colour image, where it has
        several; the samples are those of one of them.
    source_dtype
        Type of the samples in the file; by default that of `values`.
    """

    values: np.ndarray
    spacing: tuple[float, ...] = ()
    origin: tuple[float, ...] = ()
    axes: tuple[str, ...] = ()
    units: str = ""
    crs: str | None = None
    affine: np.ndarray | None = None
    nodata: float | int | None = None
    missing: np.ndarray | None = None
    metadata: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    bands: tuple[str, ...] = ()
    source_dtype: np.dtype = None  # pyright: ignore[reportAssignmentType]

    def __post_init__(self) -> None:
        values = np.asarray(self.values)
        ndim = values.ndim
        spacing, origin = tuple(self.spacing), tuple(self.origin)
        if self.affine is not None:
            if self.affine.shape != (ndim + 1, ndim + 1):
                fit = f"{ndim + 1} x {ndim + 1}"
                raise InputError(f"affine must be {fit}, got shape {self.affine.shape}")
            spacing = spacing or spacing_of(self.affine)
            origin = origin or origin_of(self.affine, spacing)
        defaults = {
            "values": values,
            "spacing": spacing or (1.0,) * ndim,
            "origin": origin or (0.0,) * ndim,
            "axes": tuple(self.axes) or _NAMES.get(ndim, tuple(f"axis{k}" for k in range(ndim))),
            "source_dtype": np.dtype(self.source_dtype or values.dtype),
        }
        for name, value in defaults.items():
            object.__setattr__(self, name, value)
        self._check(ndim)

    def _check(self, ndim: int) -> None:
        for name in ("spacing", "origin", "axes"):
            given = getattr(self, name)
            if len(given) != ndim:
                raise InputError(f"{name} has {len(given)} entries, the grid has {ndim} axes")
        if not all(np.isfinite(step) and step > 0 for step in self.spacing):
            raise InputError(f"spacing must be positive and finite, got {self.spacing}")
        if self.missing is not None and self.missing.shape != self.values.shape:
            raise InputError(f"missing has shape {self.missing.shape}, values {self.values.shape}")

    def __repr__(self) -> str:
        size = " x ".join(str(n) for n in self.shape)
        gaps = f", {self.missing_count} missing" if self.missing_count else ""
        return f"Grid({size} {self.values.dtype}, spacing {self.spacing}{gaps})"

    @property
    def shape(self) -> tuple[int, ...]:
        """Samples per axis."""
        return self.values.shape

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return self.values.ndim

    @property
    def rows_ascend(self) -> bool:
        """Whether the file says that a picture has row 0 at the bottom: maps have north at the top.

        In the coordinates of medicine that grow backwards, the front is at the top.
        """
        if self.affine is None:
            return False
        row = self.ndim - 2
        return bool((self.affine[row, row] > 0) != self.backward)

    @property
    def backward(self) -> bool:
        """Whether the coordinate y of the file grows backwards, as in medicine."""
        return "posterior" in self.metadata.get("space", "") and self.axes[-2:] == ("y", "x")

    @property
    def steps(self) -> tuple[float, ...]:
        """Distances between samples in the coordinates of the file; without any, the spacing."""
        return self.spacing if self.affine is None else spacing_of(self.affine)

    @property
    def missing_count(self) -> int:
        """Number of missing samples."""
        return 0 if self.missing is None else int(self.missing.sum())

    def missing_box(self) -> tuple[tuple[int, int], ...] | None:
        """First and last index of missing samples per axis, or None where none is missing."""
        if self.missing is None or not self.missing.any():
            return None
        indices = np.nonzero(self.missing)
        return tuple((int(index.min()), int(index.max())) for index in indices)

    def from_index(self) -> np.ndarray:
        """The map from sample numbers to world coordinates, or else to those of the field."""
        if self.affine is not None:
            return self.affine
        return diagonal_affine(self.spacing, self.origin)

    def world(self, points: np.ndarray) -> np.ndarray:
        """World coordinates, array order, of field coordinates `points`, shape (..., ndim)."""
        points = np.asarray(points, dtype=np.float64)
        if self.affine is None:
            return points
        index = (points - np.asarray(self.origin)) / np.asarray(self.spacing)
        return index @ self.affine[:-1, :-1].T + self.affine[:-1, -1]

    def refined(
        self, values: np.ndarray, factor: int | Sequence[int], periodic: Sequence[int] = ()
    ) -> Grid:
        """`values` on the grid that is `factor` times finer; its NaN are missing samples.

        Sample ``i`` becomes sample ``factor * i``, so no sample position moves.  `periodic` axes go
        on until just before the next turn.  The factor may be one for each axis.
        """
        factors = (factor,) * self.ndim if isinstance(factor, int) else tuple(factor)
        expected = tuple(
            n + factors[k] - 1 if k in periodic else n
            for k, n in enumerate(refined_shape(self.shape, factors))
        )
        if values.shape != expected:
            raise InputError(f"values refined by {factor} must be {expected}, got {values.shape}")
        return self.on_finer(values, factors).with_values(values)

    def with_values(self, values: np.ndarray) -> Grid:
        """Other values in the place of the samples; their NaN are missing samples."""
        missing = np.isnan(values)
        return replace(self, values=values, missing=missing if missing.any() else None)

    def on_finer(self, values: np.ndarray, factors: Sequence[float]) -> Grid:
        """`values` where the samples of a grid lie that is so many times finer along each axis.

        Of a coarser one, for factors below 1.  They are not looked at; none is marked as missing.
        """
        return replace(
            self,
            values=values,
            spacing=tuple(step / k for step, k in zip(self.spacing, factors, strict=True)),
            affine=None if self.affine is None else refine_affine(self.affine, factors),
            missing=None,
        )

    def crop(self, ranges: Sequence[tuple[int, int]]) -> Grid:
        """The samples ``start <= index < stop`` for one ``(start, stop)`` per axis."""
        for (start, stop), n, name in zip(ranges, self.shape, self.axes, strict=True):
            if not 0 <= start < stop <= n:
                raise InputError(f"{start}:{stop} is not within 0:{n}, the samples of axis {name}")
        part = tuple(slice(start, stop) for start, stop in ranges)
        starts = [start for start, _ in ranges]
        missing = None if self.missing is None else self.missing[part]
        origin = (at + h * k for at, h, k in zip(self.origin, self.spacing, starts, strict=True))
        return replace(
            self,
            values=self.values[part],
            origin=tuple(origin),
            affine=None if self.affine is None else crop_affine(self.affine, starts),
            missing=missing if missing is not None and missing.any() else None,
        )
