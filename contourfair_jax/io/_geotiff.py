"""GeoTIFF, and two older kinds of elevation files, with rasterio: nothing about place is lost.

A raster's transform maps pixel *corners*; a `Grid`'s affine map is at sample centres.  The two
differ by half a pixel, so refining keeps every sample where it is and moves the corner instead.
"""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rasterio
from rasterio.crs import CRS
from rasterio.errors import CRSError, NotGeoreferencedWarning
from rasterio.transform import Affine

from ._errors import InputError
from ._geometry import is_skewed, spacing_of
from ._grid import Grid, exact_float
from ._limits import check_memory
from ._missing import mark_missing, numeric, restore_nodata

_TILE_FROM = 1024
# So many bands are named in messages.
_LISTED = 12


def read(path: Path, key: str | None) -> Grid:
    """One band, the first unless `key` is the number or the name of another."""
    return _read(path, key, "GTiff")


def read_usgs_dem(path: Path, key: str | None) -> Grid:
    """Elevations of a USGS digital elevation model (``.dem``)."""
    return _read(path, key, "USGSDEM")


def read_ascii_grid(path: Path, key: str | None) -> Grid:
    """Elevations of an Arc/Info or ESRI ASCII grid (``.asc``)."""
    return _read(path, key, "AAIGrid")


def _read(path: Path, key: str | None, driver: str) -> Grid:
    with _quiet(), rasterio.open(path, driver=driver) as source:
        band, notes = _band(source.count, source.descriptions, key)
        if source.dtypes[band - 1].startswith("complex"):
            raise InputError("holds complex numbers; save the magnitude or one part")
        itemsize = np.dtype(source.dtypes[band - 1]).itemsize
        check_memory(source.width * source.height * itemsize, f"a raster of {source.shape} samples")
        samples = numeric(source.read(band))
        mask = source.read_masks(band) == 0
        scale, offset = source.scales[band - 1], source.offsets[band - 1]
        units, nodata = source.units[band - 1] or "", source.nodatavals[band - 1]
        metadata = {
            str(name): str(text)
            for name, text in source.tags().items()
            if not name.startswith("STATISTICS_")
        }
        if source.descriptions[band - 1]:
            metadata["description"] = source.descriptions[band - 1]
        crs = source.crs.to_wkt() if source.crs else None
        affine = None if source.transform.is_identity else centre_affine(source.transform)
        if affine is None and source.gcps[0]:
            notes += ("ground control points are not used: warp the raster first to keep them",)
    source_dtype = samples.dtype
    if (scale, offset) != (1.0, 0.0):
        samples = samples.astype(exact_float(samples.dtype)) * scale + offset
        notes += (f"packed values are decoded: {scale:g} * stored + {offset:g}",)
        nodata = None
    values, missing, more = mark_missing(samples, None, mask)
    if affine is not None and is_skewed(affine):
        more += ("the axes are not perpendicular; fairing treats them as if they were",)
    return Grid(
        values,
        units=units,
        crs=crs,
        affine=affine,
        nodata=nodata,
        missing=missing,
        metadata=metadata,
        notes=notes + more,
        source_dtype=source_dtype,
    )


def write(path: Path, grid: Grid) -> tuple[str, ...]:
    """Store one compressed band; missing samples get the nodata value."""
    if grid.ndim != 2:
        raise InputError(f"a GeoTIFF holds 2-D data, this is {grid.ndim}-D; use .npz")
    stored, nodata = restore_nodata(grid)
    notes: tuple[str, ...] = ()
    if grid.nodata is not None and nodata != grid.nodata and not np.isnan(grid.nodata):
        notes = (
            f"the nodata value is now {nodata}: samples have {grid.nodata:g} or cannot hold it",
        )
    if stored.dtype.name in ("int64", "uint64"):
        stored = stored.astype(np.float64)
    profile = {
        "driver": "GTiff",
        "height": stored.shape[0],
        "width": stored.shape[1],
        "count": 1,
        "dtype": stored.dtype.name,
        "nodata": nodata,
        "compress": "deflate",
        "predictor": 3 if stored.dtype.kind == "f" else 2,
        "BIGTIFF": "IF_SAFER",
        "tiled": min(stored.shape) >= _TILE_FROM,
    }
    if grid.affine is not None:
        profile["transform"] = corner_transform(grid.affine)
        if not np.allclose(spacing_of(grid.affine), grid.spacing, rtol=1e-6):
            notes += ("a GeoTIFF keeps the steps of its coordinates, not the metric spacing",)
    if grid.crs is not None:
        profile["crs"] = _crs(grid.crs)
    tags = dict(grid.metadata)
    with _quiet(), rasterio.open(path, "w", **profile) as target:
        target.write(stored, 1)
        description = tags.pop("description", None)
        if description:
            target.set_band_description(1, description)
        if grid.units:
            target.set_band_unit(1, grid.units)
        target.update_tags(**tags)
    return notes


def centre_affine(transform: Affine) -> np.ndarray:
    """Pixel-corner transform ``(column, row) -> (x, y)`` to index-to-world in array order."""
    a, b, c, d, e, f = transform[:6]
    x, y = c + (a + b) / 2, f + (d + e) / 2
    return np.array([[e, d, y], [b, a, x], [0.0, 0.0, 1.0]])


def corner_transform(affine: np.ndarray) -> Affine:
    """The inverse of `centre_affine`."""
    (e, d, y), (b, a, x) = affine[:2].tolist()
    return Affine(a, b, x - (a + b) / 2, d, e, y - (d + e) / 2)


def _band(
    count: int, names: tuple[str | None, ...], key: str | None
) -> tuple[int, tuple[str, ...]]:
    listed = [f"{k} {name or ''}".strip() for k, name in enumerate(names, 1)]
    known = ", ".join(listed[:_LISTED] + [f"... {count}"] * (count > _LISTED))
    if key is None:
        note = f"band 1 of {count} is read, the others are left out; choose with a key of {known}"
        return 1, (note,) if count > 1 else ()
    if key in names:
        return names.index(key) + 1, ()
    if not key.isdecimal() or not 1 <= int(key) <= count:
        raise InputError(f"has no band {key!r}; it has {known}")
    return int(key), ()


def _crs(text: str) -> CRS:
    try:
        return CRS.from_user_input(text)
    except (CRSError, ValueError) as error:
        raise InputError(f"coordinate reference system not understood: {text[:60]!r}") from error


@contextmanager
def _quiet() -> Iterator[None]:
    """Errors come as exceptions; GDAL's own log lines and the note on plain TIFFs are not shown."""
    log = logging.getLogger("rasterio")
    handler, propagate = logging.NullHandler(), log.propagate
    log.addHandler(handler)
    log.propagate = False
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            yield
    finally:
        log.propagate = propagate
        log.removeHandler(handler)
