"""What the notebooks share: where their data lie, and how their pictures are shown."""

import io
import os
from pathlib import Path

import numpy as np
import PIL.Image
from IPython.display import Image, display
from matplotlib.figure import Figure

DATA = Path(__file__).resolve().parent.parent / "data"


def real_data(name: str) -> dict[str, np.ndarray] | None:
    """Arrays of a file in the folder CONTOURFAIR_DATA; None where there is none."""
    path = Path(os.environ.get("CONTOURFAIR_DATA", "")) / name
    if not path.is_file():
        return None
    with np.load(path, allow_pickle=False) as archive:
        return dict(archive)


def show(figure: Figure, name: str, dpi: int = 80, colors: int = 128, crop: bool = False) -> None:
    """Display a figure with few colours, and store it in the folder CONTOURFAIR_FIGURES, if set.

    `crop` cuts the margins off.
    """
    drawn, small = io.BytesIO(), io.BytesIO()
    figure.savefig(drawn, format="png", dpi=dpi, bbox_inches="tight" if crop else None)
    PIL.Image.open(drawn).convert("RGB").quantize(colors).save(small, format="png", optimize=True)
    folder = os.environ.get("CONTOURFAIR_FIGURES")
    if folder:
        Path(folder).mkdir(parents=True, exist_ok=True)
        (Path(folder) / name).write_bytes(small.getvalue())
    display(Image(small.getvalue()))
