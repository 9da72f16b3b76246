"""Files of samples in and out, with geometry, units and missing samples kept.

Every format is a row in `FORMATS` and a small module behind `read` and `write`.  NumPy and Pillow
suffice for arrays, images, cube files and CCP4 maps; the extras ``geotiff``, ``netcdf``, ``zarr``,
``medical`` and ``vtk`` bring the packages for the others, whose files, and TIFF, are read in a
process of their own.
"""

from .._contour_line import ContourLine as ContourLine
from ._atomic import replacing as replacing
from ._errors import InputError as InputError
from ._errors import MissingPackageError as MissingPackageError
from ._example import example as example
from ._formats import FORMATS as FORMATS
from ._formats import Format as Format
from ._grid import Grid as Grid
from ._grid import exact_float as exact_float
from ._limits import check_memory as check_memory
from ._lines import write_geojson as write_geojson
from ._lines import write_svg as write_svg
from ._registry import check_writable as check_writable
from ._registry import read as read
from ._registry import read_bands as read_bands
from ._registry import write as write
from ._registry import write_bands as write_bands
