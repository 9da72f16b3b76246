"""An output in tiles that an earlier run has finished."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ._describe import Output
from ._tile_source import source_at, survey
from ._tile_state import Unfinished
from .io import InputError


def whole_output(
    source: Path, state: Unfinished, shape: tuple[int, ...], dtype: np.dtype
) -> Output | None:
    """What an earlier run has left at the target, or None where there is something to compute.

    Outputs appear whole or not at all, so one that is there, of this shape and type and not older
    than the source, is complete; with which settings it was computed is not known.
    """
    target = state.target
    if state.started or not target.exists() or target.stat().st_mtime < source.stat().st_mtime:
        return None
    try:
        array = source_at(target).open()
    except InputError:
        return None
    if tuple(array.shape) != shape or np.dtype(array.dtype) != dtype:
        return None
    return Output(shape, dtype, survey(array, dtype).missing)
