"""``.tif`` files: GeoTIFF where there is something to georeference, plain images otherwise."""

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from PIL import Image

from ..._grid.grid import Grid
from ..._support.errors import needed
from . import image

# ModelPixelScale, ModelTiepoint, ModelTransformation, GeoKeyDirectory, GDAL_METADATA, GDAL_NODATA
_GEO_TAGS = frozenset((33550, 33922, 34264, 34735, 42112, 42113))
# PhotometricInterpretation, ExtraSamples, and their values for grey and for alpha.
_PHOTOMETRIC, _EXTRA, _GREY, _ALPHA = 262, 338, (0, 1), (1, 2)


def read(path: Path, key: str | None) -> Grid:
    """A band of a GeoTIFF, or a plain image or stack."""
    kind = _kind(path)
    if kind == "geo" or (find_spec("rasterio") and (kind == "unknown" or key is not None)):
        return _geotiff("reading").read(path, key)
    return image.read(path, key)


def write(path: Path, grid: Grid) -> tuple[str, ...]:
    """Store a GeoTIFF where the grid has geometry, missing samples or wide types, else an image."""
    plain = (
        grid.affine is None
        and grid.crs is None
        and grid.missing is None
        and grid.values.dtype.name in ("uint8", "uint16", "int32", "float32")
    )
    if grid.ndim == 3:
        return image.write_tiff(path, grid)
    if plain and not find_spec("rasterio"):
        return image.write_tiff(path, grid)
    return _geotiff("writing").write(path, grid)


def write_bands(path: Path, grids: Sequence[Grid]) -> tuple[str, ...]:
    """Store grids of one place as bands."""
    return _geotiff("writing").write_bands(path, grids)


def _geotiff(doing: str):
    needed("rasterio", "geotiff", f"{doing} GeoTIFF")
    from . import geotiff as module

    return module


def _kind(path: Path) -> str:
    """``geo``, also for several bands, ``plain``, or ``unknown`` where Pillow cannot tell."""
    try:
        with Image.open(path, formats=("TIFF",)) as image:
            tags = getattr(image, "tag_v2", {})
    except (Image.UnidentifiedImageError, Image.DecompressionBombError):
        return "unknown"
    beyond_grey = tags.get(_EXTRA, ()) if tags.get(_PHOTOMETRIC) in _GREY else ()
    several = any(channel not in _ALPHA for channel in beyond_grey)
    return "geo" if several or _GEO_TAGS & set(tags) else "plain"
