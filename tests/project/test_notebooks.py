"""Every notebook runs from top to bottom, and shows pictures."""

import base64
import io

import jupytext
import nbclient
import numpy as np
import PIL.Image
import pytest
from helpers import ROOT

NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.py"))


def pictures(notebook) -> list[np.ndarray]:
    """The PNG outputs of all cells, as grey arrays."""
    found = []
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            png = output.get("data", {}).get("image/png")
            if png is not None:
                image = PIL.Image.open(io.BytesIO(base64.b64decode(png)))
                found.append(np.asarray(image.convert("L")))
    return found


def test_there_are_notebooks():
    assert "01_paper_figures.py" in [path.name for path in NOTEBOOKS]


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs(path, monkeypatch):
    monkeypatch.delenv("CONTOURFAIR_FIGURES", raising=False)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    notebook = jupytext.read(path)
    client = nbclient.NotebookClient(
        notebook,
        timeout=240,
        kernel_name="python3",
        resources={"metadata": {"path": str(ROOT / "notebooks")}},
    )
    # A cell that raises, also by a failed assertion, raises here.
    client.execute()
    images = pictures(notebook)
    assert len(images) >= 1
    for image in images:
        assert min(image.shape) > 200
        assert len(np.unique(image)) > 20
