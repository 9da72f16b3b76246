"""The accessor ``fair`` of xarray's arrays: `DataArray.fair.upsample`, ``.interp``, ``.contours``.

Importing this module registers it.  Names, coordinates and attributes are kept; axes are those
of the array, in its own coordinates, whether they ascend or descend.
"""

from .._support.errors import needed as _needed

_needed("xarray", "xarray", "contourfair_jax.xarray")

from ._accessor import FairAccessor as FairAccessor  # noqa: E402

__all__ = [
    "FairAccessor",
]
