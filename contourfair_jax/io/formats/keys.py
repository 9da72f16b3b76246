"""Keys that choose an array and a part of it: ``name``, ``name,time=3,level=0``, ``time=3``.

Numbers count samples from 0, negative ones from the end; ``time=10:20`` keeps a range as an axis.
"""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from ..._support.errors import InputError

Part = int | slice
_NUMBER = re.compile(r"-?\d{1,12}$")
_RANGE = re.compile(r"(-?\d{1,12})?:(-?\d{1,12})?$")


def parse_key(key: str | None) -> tuple[str | None, dict[str, Part]]:
    """The name (None where there is none) and the part along each axis that is named."""
    if key is None:
        return None, {}
    first, *rest = key.split(",")
    if "=" in first:
        first, rest = "", [first, *rest]
    parts: dict[str, Part] = {}
    for text in rest:
        axis, _, place = text.partition("=")
        parts[axis.strip()] = _part(place.strip(), key)
    return first.strip() or None, parts


def take(
    values: np.ndarray, axes: Sequence[str], parts: Mapping[str, Part]
) -> tuple[np.ndarray, tuple[str, ...]]:
    """The part of `values`, and the axes that are left."""
    index = index_of(parts, axes, values.shape)
    left = tuple(name for name, part in zip(axes, index, strict=True) if isinstance(part, slice))
    return values[index], left


def index_of(
    parts: Mapping[str, Part], axes: Sequence[str], shape: Sequence[int]
) -> tuple[Part, ...]:
    """An index per axis; refuses axes that are not there, and empty or outside parts."""
    sizes = dict(zip(axes, shape, strict=True))
    for axis, part in parts.items():
        if axis not in sizes:
            raise InputError(f"has no axis {axis!r}; it has {describe_axes(axes, shape)}")
        n = sizes[axis]
        if isinstance(part, int) and not -n <= part < n:
            raise InputError(f"{axis}={part} is outside 0..{n - 1}")
        if isinstance(part, slice) and not len(range(n)[part]):
            raise InputError(f"{axis}={part.start or 0}:{part.stop} holds nothing of 0..{n - 1}")
    return tuple(parts.get(axis, slice(None)) for axis in axes)


def describe_axes(axes: Sequence[str], shape: Sequence[int]) -> str:
    """The axes and their sizes, such as ``time 240, lat 37, lon 49``."""
    return ", ".join(f"{name} {n}" for name, n in zip(axes, shape, strict=True))


def _part(text: str, key: str) -> Part:
    if _NUMBER.match(text):
        return int(text)
    if limits := _RANGE.match(text):
        start, stop = (None if end is None else int(end) for end in limits.groups())
        return slice(start, stop)
    raise InputError(f"key must look like name,axis=3 or name,axis=0:5, got {key!r}")
