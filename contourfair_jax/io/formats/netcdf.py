"""NetCDF with xarray: NetCDF-4 through h5netcdf, the classic formats through SciPy.

SciPy's reader is plain Python, which damaged files do not hang; it knows all but CDF-5.
"""

import os
from pathlib import Path

import xarray as xr

from ..._grid.grid import Grid
from ..._support.errors import InputError
from .datasets import dataset_from_grid, grid_from_dataset

# First bytes of a file, and the engine of xarray for it.
_ENGINES = {
    b"CDF\x01": "scipy",
    b"CDF\x02": "scipy",
    b"CDF\x05": "netcdf4",
    b"\x89HDF": "h5netcdf",
}


def read(path: Path, key: str | None) -> Grid:
    """A variable; packed integers are decoded, times stay numbers."""
    with open(path, "rb") as stream:
        engine = _ENGINES.get(stream.read(4))
    if engine is None:
        raise InputError("is not a NetCDF file (it does not begin like one)")
    with xr.open_dataset(
        os.fspath(path), engine=engine, decode_times=False, decode_coords="all", cache=False
    ) as data:
        return grid_from_dataset(data, key)


def write(path: Path, grid: Grid) -> tuple[str, ...]:
    """Store a compressed NetCDF-4 file of one variable with its coordinates."""
    data = dataset_from_grid(grid)
    small = {"zlib": True, "complevel": 4}
    encoding = {
        name: {**variable.encoding, **small} for name, variable in data.items() if variable.ndim
    }
    data.to_netcdf(os.fspath(path), engine="h5netcdf", encoding=encoding)
    return ()
