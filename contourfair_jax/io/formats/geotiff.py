"""GeoTIFF, and two older kinds of elevation files, with rasterio: nothing about place is lost.

A raster's transform maps pixel *corners*; a `Grid`'s affine map is at sample centres.  The two
differ by half a pixel, so refining keeps every sample where it is and moves the corner instead.
"""

import logging
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import rasterio
from rasterio.crs import CRS
from rasterio.enums import ColorInterp
from rasterio.errors import CRSError, NotGeoreferencedWarning, RasterioIOError
from rasterio.transform import Affine

from ..._grid.affine import SKEWED, is_skewed, spacing_of
from ..._grid.grid import Grid, exact_float
from ..._grid.missing import mark_missing, numeric, restore_nodata
from ..._support.errors import InputError, one_line
from ..._support.memory import check_memory
from .volumes import SLICE

_TILE_FROM = 1024
# So many bands are named in messages.
_LISTED = 12
_COLOUR = "colour"
_COLOURS = (ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha)


def read(path: Path, key: str | None) -> Grid:
    """One band, the first unless `key` is the number, the name or the colour of another."""
    return _read(path, key, "GTiff")


def read_usgs_dem(path: Path, key: str | None) -> Grid:
    """Elevations of a USGS digital elevation model (``.dem``)."""
    return _read(path, key, "USGSDEM")


def read_ascii_grid(path: Path, key: str | None) -> Grid:
    """Elevations of an Arc/Info or ESRI ASCII grid (``.asc``)."""
    return _read(path, key, "AAIGrid")


def _read(path: Path, key: str | None, driver: str) -> Grid:
    with _quiet(), rasterio.open(path, driver=driver) as source:
        names = _names(source)
        band, notes = _band(names, key)
        if source.dtypes[band - 1].startswith("complex"):
            raise InputError("holds complex numbers; save the magnitude or one part")
        itemsize = np.dtype(source.dtypes[band - 1]).itemsize
        check_memory(source.width * source.height * itemsize, f"a raster of {source.shape} samples")
        with _telling_damage():
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
        if source.colorinterp[band - 1] in _COLOURS:
            metadata[_COLOUR] = source.colorinterp[band - 1].name
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
        more += (SKEWED,)
    return Grid(
        values,
        units=units,
        crs=crs,
        affine=affine,
        nodata=nodata,
        missing=missing,
        metadata=metadata,
        notes=notes + more,
        bands=tuple(str(k) for k in range(1, len(names) + 1)) if len(names) > 1 else (),
        source_dtype=source_dtype,
    )


def write(path: Path, grid: Grid) -> tuple[str, ...]:
    """Store one compressed band; missing samples get the nodata value."""
    return write_bands(path, (grid,))


def write_bands(path: Path, grids: Sequence[Grid]) -> tuple[str, ...]:
    """Store grids of one place as compressed bands, all with one type and one nodata value."""
    grid = grids[0]
    if grid.ndim != 2:
        raise InputError(f"a GeoTIFF holds 2-D data, this is {grid.ndim}-D; use .npz")
    stored, nodata = _stored(grids)
    notes: tuple[str, ...] = ()
    if grid.nodata is not None and nodata != grid.nodata and not np.isnan(grid.nodata):
        notes = (
            f"the nodata value is now {nodata}: samples have {grid.nodata:g} or cannot hold it",
        )
    if stored.dtype.name in ("int64", "uint64"):
        stored = stored.astype(np.float64)
    profile = {
        "driver": "GTiff",
        "count": len(stored),
        "height": stored.shape[1],
        "width": stored.shape[2],
        "dtype": stored.dtype.name,
        "nodata": nodata,
        "compress": "deflate",
        "predictor": 3 if stored.dtype.kind == "f" else 2,
        "BIGTIFF": "IF_SAFER",
        "tiled": min(grid.shape) >= _TILE_FROM,
    }
    if grid.affine is not None:
        profile["transform"] = corner_transform(grid.affine)
        if not np.allclose(spacing_of(grid.affine), grid.spacing, rtol=1e-6):
            notes += ("a GeoTIFF keeps the steps of its coordinates, not the metric spacing",)
    if SLICE in grid.metadata:
        notes += ("a GeoTIFF keeps where the slice of a volume lies as text only",)
    if grid.crs is not None:
        profile["crs"] = _crs(grid.crs)
    colours = tuple(each.metadata.get(_COLOUR, "undefined") for each in grids)
    if colours[:3] == ("red", "green", "blue"):
        profile["photometric"] = "RGB"
    with _quiet(), rasterio.open(path, "w", **profile) as target:
        target.write(stored)
        if len(grids) > 1:
            target.colorinterp = [ColorInterp[name] for name in colours]
        for band, each in enumerate(grids, 1):
            if each.metadata.get("description"):
                target.set_band_description(band, each.metadata["description"])
            if each.units:
                target.set_band_unit(band, each.units)
        own = ("description", _COLOUR)
        target.update_tags(**{k: v for k, v in grid.metadata.items() if k not in own})
    return notes


def _stored(grids: Sequence[Grid]) -> tuple[np.ndarray, float | int | None]:
    """Bands of one type, and the nodata value of them all: NaN where one value does not do."""
    dtype = np.result_type(*(grid.values for grid in grids))
    nodata = next((grid.nodata for grid in grids if grid.nodata is not None), None)
    alike = [replace(grid, values=grid.values.astype(dtype), nodata=nodata) for grid in grids]
    pairs = [restore_nodata(grid) for grid in alike]
    if len({repr(value) for _, value in pairs}) > 1:
        pairs = [restore_nodata(replace(grid, nodata=np.nan)) for grid in alike]
    return np.stack([values for values, _ in pairs]), pairs[0][1]


def centre_affine(transform: Affine) -> np.ndarray:
    """Pixel-corner transform ``(column, row) -> (x, y)`` to index-to-world in array order."""
    a, b, c, d, e, f = transform[:6]
    x, y = c + (a + b) / 2, f + (d + e) / 2
    return np.array([[e, d, y], [b, a, x], [0.0, 0.0, 1.0]])


def corner_transform(affine: np.ndarray) -> Affine:
    """The inverse of `centre_affine`."""
    (e, d, y), (b, a, x) = affine[:2].tolist()
    return Affine(a, b, x - (a + b) / 2, d, e, y - (d + e) / 2)


def _names(source: rasterio.DatasetReader) -> tuple[str, ...]:
    """Names of the bands: their descriptions, or their colours, or none."""
    colours = [colour.name if colour in _COLOURS else "" for colour in source.colorinterp]
    return tuple(a or b for a, b in zip(source.descriptions, colours, strict=True))


def _band(names: tuple[str, ...], key: str | None) -> tuple[int, tuple[str, ...]]:
    count = len(names)
    listed = [f"{k} {name}".strip() for k, name in enumerate(names, 1)]
    known = ", ".join(listed[:_LISTED] + [f"... {count}"] * (count > _LISTED))
    if key is None:
        note = f"band 1 of {count} is read, the others are left out; choose with a key of {known}"
        return 1, (note,) if count > 1 else ()
    if key and key in names:
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
def _telling_damage() -> Iterator[None]:
    """The message of the exception that the library refers to as its previous one."""
    try:
        yield
    except RasterioIOError as error:
        first: BaseException = error
        while first.__cause__ is not None:
            first = first.__cause__
        raise InputError(f"is damaged or cut short ({one_line(first)})") from error


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
