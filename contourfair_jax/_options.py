"""The options of the command line, each written once."""

from pathlib import Path
from typing import Annotated

import typer

from ._run import METHODS
from .io import FORMATS

# Endings of the files of samples that can be written.
WRITABLE = ", ".join(suffix for each in FORMATS if each.writer for suffix in each.suffixes)

Input = Annotated[Path, typer.Argument(metavar="IN", help="File of samples.", show_default=False)]
Key = Annotated[
    str | None,
    typer.Option("--key", "-k", help="Which array: a name in a .npz, a band of a GeoTIFF."),
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No notes, no progress; errors only.")]
Json = Annotated[bool, typer.Option("--json", help="Results as one line of JSON, for programs.")]
Single = Annotated[bool, typer.Option("--float32", help="Compute in float32: half the memory.")]
Iterations = Annotated[
    int | None,
    typer.Option(help="Renewals of the normals; 0: thin plate. [dim]\\[default: 3][/]"),
]
Weight = Annotated[
    float | None,
    typer.Option(
        "--thin-plate-weight", help="Share of thin plate energy. [dim]\\[default: of the method][/]"
    ),
]
Fill = Annotated[
    bool,
    typer.Option("--fill", help="Keep what global fairing puts in the place of missing samples."),
]
Method = Annotated[
    str,
    typer.Option("--method", "-m", help=f"How to fair: {', '.join(METHODS)}."),
]
Workers = Annotated[
    int, typer.Option(help="Processes that work on a .zarr or .npy output at the same time.")
]
Resume = Annotated[
    bool, typer.Option("--resume", help="Continue a .zarr or .npy output that was stopped.")
]
Memory = Annotated[
    float | None,
    typer.Option(help="GiB that these processes may take together: fewer work if need be."),
]
Levels = Annotated[str | None, typer.Option(help="Levels, separated by commas: 100,150,200.")]
Interval = Annotated[float | None, typer.Option(help="Levels at the multiples of this number.")]
Count = Annotated[int | None, typer.Option(help="Number of levels, evenly spaced in the range.")]
Crop = Annotated[
    str | None,
    typer.Option(help="Rows and columns r0:r1,c0:c1 to show, or 'all'; by default a busy part."),
]


def output(what: str):
    """The option for the file that is written; the help says which kinds there are."""
    return typer.Option("--output", "-o", metavar="OUT", help=what, show_default=False)


def examples(*lines: str) -> str:
    """Examples below the help of a command; blank lines keep them on lines of their own."""
    return "[bold]Examples[/]\n\n" + "\n\n".join(f"  {line}" for line in lines)
