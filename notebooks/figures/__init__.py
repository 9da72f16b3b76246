"""What the notebooks share: where their data lie, and how their pictures are shown."""

import io
import os
from pathlib import Path

import PIL.Image
from IPython.display import Image, display
from matplotlib.figure import Figure

DATA = Path(__file__).resolve().parent.parent / "data"


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
