"""The table of formats: a format is one row here and one module in `formats`."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from .._grid.grid import Grid
from .._support.errors import needed
from ._isolate import read_isolated


@dataclass(frozen=True)
class Outside:
    """Other packages that read and write a format.

    Parameters
    ----------
    extra
        The extra of this package that brings them.
    packages
        The names under which those are imported that no file of the format can do without.
    """

    extra: str
    packages: tuple[str, ...]

    def check(self, doing: str) -> None:
        """Refuse where one of the packages is missing; `doing` starts the message."""
        needed(self.packages, self.extra, doing)


@dataclass(frozen=True)
class Format:
    """A file format; its module is imported when a file of it is met.

    Parameters
    ----------
    name
        For messages.
    suffixes
        Lower case, with the dot; the longest that fits a file's name decides.
    module
        Module of `formats` with the reader and the writer.
    reader, writer
        Names of the functions there; ``""`` where the format is only written or only read.
    outside
        The packages that the module needs; files are then read in a process of their own, because
        such packages cannot be trusted with damaged files.
    folder
        Whether the format is a folder, not a file.
    beside
        Suffix of the file of samples that the writer leaves beside a header; ``""`` for none.
    bands_writer
        Name of the function that writes several grids of one place to one file; ``""`` for none.
    """

    name: str
    suffixes: tuple[str, ...]
    module: str
    reader: str = "read"
    writer: str = "write"
    outside: Outside | None = None
    folder: bool = False
    beside: str = ""
    bands_writer: str = ""

    def read(self, path: Path, key: str | None) -> Grid:
        """Read `path` with this format's reader."""
        if self.outside is not None:
            self.outside.check(f"reading {self.name}")
            return read_isolated(self.module, self.reader, path, key)
        return self._load(self.reader)(path, key)

    def write(self, path: Path, grid: Grid) -> tuple[str, ...]:
        """Write `path` with this format's writer."""
        return self._writer(self.writer)(path, grid)

    def write_bands(self, path: Path, grids: Sequence[Grid]) -> tuple[str, ...]:
        """Write `path` with this format's writer of bands."""
        return self._writer(self.bands_writer)(path, grids)

    def _writer(self, function: str) -> Callable:
        if self.outside is not None:
            self.outside.check(f"writing {self.name}")
        return self._load(function)

    def _load(self, function: str) -> Callable:
        return getattr(import_module(f"{__package__}.formats.{self.module}"), function)


_NETCDF = Outside("netcdf", ("xarray", "h5netcdf", "h5py", "netCDF4", "scipy"))
_ZARR = Outside("zarr", ("zarr", "xarray"))
# Plain images need Pillow only; `tiff` looks for rasterio where a file calls for it.  Reading
# either kind runs libtiff, which is no safer with damaged files than the other libraries.
_TIFF = Outside("geotiff", ())
_RASTERIO = Outside("geotiff", ("rasterio",))
_VTK = Outside("vtk", ("vtkmodules",))

_NIBABEL, _NRRD, _ITK, _PYDICOM = (
    Outside("medical", (package,)) for package in ("nibabel", "nrrd", "SimpleITK", "pydicom")
)

_HEADER, _BANDS = "write_header", "write_bands"

FORMATS = (
    Format("NumPy array", (".npy",), "npy"),
    Format("NumPy archive", (".npz",), "npz"),
    Format("PNG image", (".png",), "image", writer="write_png", bands_writer="write_png_bands"),
    Format("TIFF or GeoTIFF", (".tif", ".tiff"), "tiff", bands_writer=_BANDS, outside=_TIFF),
    Format("Gaussian cube", (".cube", ".cub"), "cube", writer=""),
    Format("CCP4 or MRC map", (".ccp4", ".mrc", ".map"), "ccp4", writer=""),
    Format("USGS DEM", (".dem",), "geotiff", "read_usgs_dem", "", _RASTERIO),
    Format("ASCII grid", (".asc",), "geotiff", "read_ascii_grid", "", _RASTERIO),
    Format("NetCDF", (".nc", ".nc4", ".cdf"), "netcdf", outside=_NETCDF),
    Format("Zarr", (".zarr",), "zarr", outside=_ZARR, folder=True),
    Format("NIfTI", (".nii", ".nii.gz"), "nifti", outside=_NIBABEL),
    Format("NRRD", (".nrrd",), "nrrd", outside=_NRRD),
    Format("NRRD header", (".nhdr",), "nrrd", "read", _HEADER, _NRRD, beside=".raw"),
    Format("MetaImage", (".mha",), "metaimage", outside=_ITK),
    Format("MetaImage header", (".mhd",), "metaimage", "read", _HEADER, _ITK, beside=".raw"),
    Format("DICOM", (".dcm",), "dicom", writer="", outside=_PYDICOM),
    Format("VTK image data", (".vti",), "vtk", outside=_VTK),
    Format("legacy VTK", (".vtk",), "vtk", "read_legacy", "write_legacy", _VTK),
)

# A folder whose name says nothing.
NAMELESS_FOLDER = Format("DICOM series", (), "dicom", "read_series", "", _PYDICOM, folder=True)
