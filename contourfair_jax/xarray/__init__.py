"""The accessor ``fair`` of xarray's arrays: `DataArray.fair.upsample`, ``.interp``, ``.contours``.

Importing this module registers it.  Names, coordinates and attributes are kept; axes are those
of the array, in its own coordinates, whether they ascend or descend.
"""

from ._accessor import FairAccessor as FairAccessor

__all__ = [
    "FairAccessor",
]
