"""Files of samples in and out, with geometry, units and missing samples kept.

Every format is a row in `FORMATS` and a small module behind `read` and `write`.  NumPy and Pillow
suffice for arrays, images, cube files and CCP4 maps; the extras ``geotiff``, ``netcdf``, ``zarr``,
``medical`` and ``vtk`` bring the packages for the others, whose files, and TIFF, are read in a
process of their own.
"""

from .._grid.grid import Grid as Grid
from .._grid.grid import exact_float as exact_float
from .._support.errors import InputError as InputError
from .._support.errors import MissingPackageError as MissingPackageError
from .._support.memory import check_memory as check_memory
from .._support.public import public as _public
from ._outputs import replacing as replacing
from ._registry import check_writable as check_writable
from ._registry import example as example
from ._registry import read as read
from ._registry import read_bands as read_bands
from ._registry import write as write
from ._registry import write_bands as write_bands
from ._table import FORMATS as FORMATS
from ._table import Format as Format

__all__ = [
    "FORMATS",
    "Format",
    "Grid",
    "InputError",
    "MissingPackageError",
    "check_memory",
    "check_writable",
    "exact_float",
    "example",
    "read",
    "read_bands",
    "replacing",
    "write",
    "write_bands",
]

_public(
    __name__,
    "contourfair_jax.io.read(path) or write(path, grid)",
    {
        "write_geojson": "contourfair_jax.export.write_geojson",
        "write_svg": "contourfair_jax.export.write_svg",
        "ContourLine": "contourfair_jax.contours.ContourLine",
    },
)
