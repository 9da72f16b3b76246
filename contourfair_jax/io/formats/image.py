"""PNG images and plain TIFF (one page, or a stack of equal pages as a volume), with Pillow."""

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image, ImageSequence

from ..._grid.grid import Grid
from ..._grid.missing import mark_missing, numeric
from ..._support.errors import InputError, one_line
from ..._support.memory import check_memory

_CHANNELS = ("red", "green", "blue", "alpha")
_TIFF_TYPES = ("uint8", "uint16", "int32", "float32")


def read(path: Path, key: str | None) -> Grid:
    """Grey values; colour becomes luminance unless `key` names a channel.

    Fully transparent pixels are missing.
    """
    with _opened(path) as image:
        pages = getattr(image, "n_frames", 1) if image.format == "TIFF" else 1
        check_memory(image.width * image.height * pages * 8, f"an image of {image.size} pixels")
        channels = _channels(image) if pages == 1 else ()
        if key is not None and key not in channels:
            known = f"the channels {', '.join(channels)}" if channels else "grey values only"
            raise InputError(f"is a plain image, so there is no {key!r} to choose: it has {known}")
        if pages == 1:
            colour = {} if key is None else {"colour": key}
            return replace(_grid(*_samples(image, key)), bands=channels, metadata=colour)
        read_pages = [_samples(page) for page in ImageSequence.Iterator(image)]
    if len({(samples.shape, samples.dtype) for samples, _, _ in read_pages}) != 1:
        raise InputError(f"has {pages} pages of different size or type; save them one by one")
    masks = [np.zeros(s.shape, bool) if mask is None else mask for s, mask, _ in read_pages]
    notes = (*read_pages[0][2], f"{pages} pages are read as a volume")
    return _grid(np.stack([samples for samples, _, _ in read_pages]), np.stack(masks), notes)


def write_png(path: Path, grid: Grid) -> tuple[str, ...]:
    """Store 8- or 16-bit grey values, as deep as the source was; missing ones are transparent."""
    if grid.ndim != 2:
        raise InputError(f"a PNG holds 2-D data, this is {grid.ndim}-D; use .npz or .tif")
    stored, notes = _quantised(grid)
    if grid.missing is None:
        image = Image.fromarray(stored)
    elif stored.dtype == np.uint8:
        alpha = np.where(grid.missing, 0, 255).astype(np.uint8)
        image = Image.fromarray(np.stack([stored, alpha], axis=-1), mode="LA")
    else:
        raise InputError("a 16-bit PNG cannot mark missing samples; use .tif or .npz")
    image.save(path, format="PNG")
    return notes + _lost_geometry(grid, "a PNG", ".tif and .npz")


def write_png_bands(path: Path, grids: Sequence[Grid]) -> tuple[str, ...]:
    """Store red, green, blue and perhaps alpha, 8 bits each; missing pixels are transparent."""
    if len(grids) not in (3, 4) or any(grid.source_dtype != np.uint8 for grid in grids):
        types = ", ".join(str(grid.source_dtype) for grid in grids)
        raise InputError(
            f"a PNG holds 3 or 4 channels of 8 bits, the source has {len(grids)} ({types}); "
            "use .tif"
        )
    quantised = [_quantised(grid) for grid in grids]
    channels = [samples for samples, _ in quantised]
    missing = np.any([grid.missing for grid in grids if grid.missing is not None], axis=0)
    if missing.any():
        opaque = channels[3] if len(grids) == 4 else np.full(grids[0].shape, 255, np.uint8)
        channels[3:] = [np.where(missing, np.uint8(0), opaque)]
    Image.fromarray(np.stack(channels, axis=-1)).save(path, format="PNG")
    notes = dict.fromkeys(note for _, texts in quantised for note in texts)
    return (*notes, *_lost_geometry(grids[0], "a PNG", ".tif and .npz"))


def write_tiff(path: Path, grid: Grid) -> tuple[str, ...]:
    """Store a plain TIFF; a volume becomes a stack of pages; missing samples are NaN."""
    if grid.ndim not in (2, 3):
        raise InputError(f"a TIFF holds 2-D or 3-D data, this is {grid.ndim}-D; use .npz")
    if grid.values.dtype.name not in _TIFF_TYPES:
        known = ", ".join(_TIFF_TYPES)
        raise InputError(f"a plain TIFF holds {known}, not {grid.values.dtype}; use .npz")
    values = grid.values
    if grid.missing is not None:
        if values.dtype.kind != "f":
            raise InputError("a plain TIFF cannot mark missing integer samples; use .npz")
        values = np.where(grid.missing, np.float32("nan"), values)
    pages = [Image.fromarray(page) for page in values.reshape(-1, *grid.shape[-2:])]
    pages[0].save(
        path,
        format="TIFF",
        compression="tiff_adobe_deflate",
        save_all=True,
        append_images=pages[1:],
    )
    return _lost_geometry(grid, "a TIFF of several pages", ".nc and .npz")


def _lost_geometry(grid: Grid, what: str, better: str) -> tuple[str, ...]:
    """A note where the grid has coordinates that the format cannot keep."""
    if grid.affine is None and grid.crs is None:
        return ()
    return (f"{what} keeps no coordinates: they are left out ({better} keep them)",)


@contextmanager
def _opened(path: Path) -> Iterator[Image.Image]:
    with warnings.catch_warnings():
        # Memory is checked against the machine; the pixel count at which Pillow warns is no limit.
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        try:
            image = Image.open(path, formats=("PNG", "TIFF"))
        except Image.UnidentifiedImageError as error:
            raise InputError("is not a PNG or TIFF image that can be read") from error
        except Image.DecompressionBombError as error:
            raise InputError(
                f"has more than {2 * (Image.MAX_IMAGE_PIXELS or 0)} pixels; convert it to .npy"
            ) from error
        with image:
            try:
                yield image
            except OSError as error:
                raise InputError(f"is damaged or cut short ({one_line(error)})") from error


def _channels(image: Image.Image) -> tuple[str, ...]:
    """The channels of a colour image; alpha is one where it is more than a mask."""
    if image.mode not in ("RGB", "RGBA", "P", "PA", "CMYK", "YCbCr", "LAB", "HSV"):
        return ()
    alpha = np.asarray(image.convert("RGBA"))[..., 3]
    return _CHANNELS if ((alpha > 0) & (alpha < 255)).any() else _CHANNELS[:3]


def _samples(
    image: Image.Image, channel: str | None = None
) -> tuple[np.ndarray, np.ndarray | None, tuple[str, ...]]:
    """Grey values or those of one channel, mask of transparent pixels, notes."""
    deep = image.mode in ("I", "F") or image.mode.startswith("I;16")
    if deep or (image.mode in ("L", "1") and "transparency" not in image.info):
        # Black and white are 0 and 255, so that they stay that in pictures that are written.
        samples = numeric(np.asarray(image.convert("L") if image.mode == "1" else image))
        return samples.astype(np.int16) if _is_int16(image) else samples, None, ()
    colour = np.asarray(image.convert("RGBA"))
    transparent = colour[..., 3] == 0
    if channel is not None:
        chosen = np.ascontiguousarray(colour[..., _CHANNELS.index(channel)])
        return chosen, None if channel == "alpha" else transparent, ()
    red, green, blue = colour[..., 0], colour[..., 1], colour[..., 2]
    if (red == green).all() and (red == blue).all():
        return np.ascontiguousarray(red), transparent, ()
    note = "a colour image: its luminance is used (ITU-R 601)"
    return np.asarray(image.convert("RGB").convert("L")), transparent, (note,)


def _is_int16(image: Image.Image) -> bool:
    """Whether a TIFF holds signed 16-bit values, which Pillow widens to 32."""
    tags = getattr(image, "tag_v2", {})
    return image.mode == "I" and tags.get(258) == (16,) and tags.get(339) == (2,)


def _grid(samples: np.ndarray, mask: np.ndarray | None, notes: tuple[str, ...]) -> Grid:
    values, missing, more = mark_missing(samples, None, mask)
    return Grid(values, missing=missing, notes=notes + more, source_dtype=samples.dtype)


def _quantised(grid: Grid) -> tuple[np.ndarray, tuple[str, ...]]:
    """Whole grey values; refused where that would lose more than the rounding of an image."""
    present = grid.values if grid.missing is None else grid.values[~grid.missing]
    wanted = grid.source_dtype.newbyteorder("=")
    if wanted not in (np.uint8, np.uint16):
        whole = bool((present == np.round(present)).all())
        if not whole or present.min(initial=0) < 0 or present.max(initial=0) > 65535:
            raise InputError(
                f"a PNG holds whole grey values 0..65535, the source held {wanted}; "
                "use .tif, .npy or .npz"
            )
        wanted = np.dtype(np.uint8 if present.max(initial=0) <= 255 else np.uint16)
    top = np.iinfo(wanted).max
    notes: tuple[str, ...] = ()
    clipped = int(((present < -0.5) | (present >= top + 0.5)).sum())
    if grid.values.dtype != wanted and (present != np.round(present)).any():
        notes += (f"values are rounded to {8 * wanted.itemsize}-bit grey",)
    if clipped:
        notes += (f"{clipped} values outside 0..{top} are clipped",)
    filled = grid.values if grid.missing is None else np.where(grid.missing, 0, grid.values)
    return np.clip(np.round(filled), 0, top).astype(wanted), notes
