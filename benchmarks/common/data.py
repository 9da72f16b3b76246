"""Real fields from the folder ``CONTOURFAIR_DATA``, or the one beside the checkout.

A field with missing samples is cut to its largest fully valid rectangle.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from contourfair_jax.io import read

BESIDE = Path(__file__).resolve().parents[3] / "shared" / "data"
FOLDER = Path(os.environ.get("CONTOURFAIR_DATA", BESIDE))
Array = NDArray[np.float64]


@dataclass(frozen=True)
class RealField:
    """Samples of a real field.

    Parameters
    ----------
    name : str
    values : array
        Float64, no missing samples.
    spacing : tuple of float
        Relative to the first axis.
    """

    name: str
    values: Array
    spacing: tuple[float, ...]


def _pick(index: int | tuple[slice, ...] | None = None, key: str = "data") -> Callable:
    def read(path: Path) -> tuple[Array, Array | None, Array | None]:
        with np.load(path, allow_pickle=False) as archive:
            values = archive[key]
            valid = archive["valid"] if "valid" in archive.files else None
            spacing = archive["spacing"] if "spacing" in archive.files else None
        if index is not None:
            values, spacing = values[index], None
        return values, valid, spacing

    return read


def _image(path: Path) -> tuple[Array, None, None]:
    with Image.open(path) as picture:
        return np.asarray(picture), None, None


def _raw(shape: tuple[int, ...], spacing: tuple[float, ...]) -> Callable:
    def read(path: Path) -> tuple[NDArray, None, Array]:
        values = np.fromfile(path, np.uint8).reshape(shape, order="F")
        return values, None, np.asarray(spacing)

    return read


def _file(middle: int | None = None) -> Callable:
    """Read as the package does; of a large volume a cube of `middle` samples around its middle."""

    def read_file(path: Path) -> tuple[NDArray, NDArray | None, Array]:
        grid = read(path)
        values, missing = grid.values, grid.missing
        half = max(values.shape) if middle is None else middle // 2
        part = tuple(slice(max(n // 2 - half, 0), n // 2 + half) for n in values.shape)
        return values[part], None if missing is None else ~missing[part], np.array(grid.spacing)

    return read_file


PLANE: dict[str, tuple[str, Callable]] = {
    "Jacksboro terrain": ("jacksboro_fault_dem.npz", _pick()),
    "Maunga Whau terrain": ("volcano.npz", _pick()),
    "Vancouver topography": ("topobathy.npz", _pick()),
    "Luxembourg terrain": ("elev_luxembourg.npz", _pick()),
    "Mt St Helens terrain": ("sainte_helens.npz", _pick()),
    "Olinda terrain": ("olinda.npz", _pick()),
    "geopotential 500 hPa": ("eraint_z500_jan.npz", _pick()),
    "sea-level pressure": ("mslp_rotated_pole.npz", _pick()),
    "air temperature": ("a1b_temperature.npz", _pick(0)),
    "potential temperature": ("hybrid_height_theta.npz", _pick(0)),
    "annual rain": ("annual_precip.npz", _pick()),
    "sea-surface temperature": ("oisst_sst.npz", _pick()),
    "ocean temperature": ("orca2_temp.npz", _pick()),
    "cameraman": ("camera.png", _image),
    "coins": ("coins.png", _image),
    "phase microscopy": ("cell.png", _image),
    "retina": ("microaneurysms.png", _image),
    "MR slice": ("mri_s1045.npz", _pick()),
    "CT slice": ("ct_small.npz", _pick()),
    "disparity": ("motorcycle_disp_skimage.npz", _pick(key="arr_0")),
}
VOLUME: dict[str, tuple[str, Callable]] = {
    "nucleon": ("nucleon.npz", _pick()),
    "neghip": ("neghip.npz", _pick()),
    "hydrogen orbital": ("hydrogen_orbital.npz", _pick()),
    "benzene orbital": ("benzene_homo.npz", _pick()),
    "carotid flow speed": ("carotid_speed.npz", _pick()),
    "brain activation": ("motor_zmap.npz", _pick()),
    "MR head": ("mr_seg3d.npz", _pick()),
    "MR head, coarse": ("HeadMRVolume.raw", _raw((48, 62, 42), (4.0, 4.0, 4.0))),
    "electron density": ("ccp4_3pqr.npz", _pick()),
}


# Those that only surfaces are made of: labels, a ball of two values, and more heads.
SURFACE = VOLUME | {
    "iron protein": ("ironProt.vtk", _file()),
    "CT head": ("headsq_quarter.nrrd", _file()),
    "facies, part": ("channels.vti", _file(40)),
    "binary ball": ("BallBinary30x30x30_gz.nrrd", _file()),
    "T1 brain, part": ("avg152T1_RL_nifti.nii.gz", _file(48)),
    "T1 anatomy": ("anatomical.nii", _file()),
}


def largest_rectangle(valid: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Largest all-true rectangle of a 2-D mask, one scan over histograms of column heights."""
    heights = np.zeros(valid.shape[1] + 1, dtype=int)
    best, area = (slice(0, 0), slice(0, 0)), 0
    for row in range(valid.shape[0]):
        heights[:-1] = np.where(valid[row], heights[:-1] + 1, 0)
        stack: list[int] = []
        for column, height in enumerate(heights):
            while stack and heights[stack[-1]] >= height:
                top = int(heights[stack.pop()])
                left = stack[-1] + 1 if stack else 0
                if top * (column - left) > area:
                    area = top * (column - left)
                    best = (slice(row + 1 - top, row + 1), slice(left, column))
            stack.append(column)
    return best


def load(names: dict[str, tuple[str, Callable]], name: str) -> RealField | None:
    """Read one field of `PLANE`, `VOLUME` or `SURFACE`; None where its file is missing."""
    file, read = names[name]
    path = FOLDER / file
    if not path.exists():
        return None
    raw, valid, spacing = read(path)
    values = np.asarray(raw, np.float64)
    mask = np.isfinite(values) if valid is None else np.isfinite(values) & valid
    if not mask.all() and values.ndim == 2:
        values = values[largest_rectangle(mask)]
    steps = np.ones(values.ndim) if spacing is None else np.asarray(spacing, float)
    return RealField(name, values, tuple((steps / steps[0]).tolist()))
