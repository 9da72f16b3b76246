"""The options of the command line, each written once."""

import inspect
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from ..io import FORMATS

# Endings of the files of samples that can be written.
WRITABLE = ", ".join(suffix for each in FORMATS if each.writer for suffix in each.suffixes)


def _readable() -> str:
    """Endings of the files of samples that can be read, by the extra that brings their packages."""
    groups: dict[str, list[str]] = {}
    for row in FORMATS:
        extra = row.outside.extra if row.outside and row.outside.packages else ""
        groups.setdefault(extra, []).extend(row.suffixes)
    lines = [
        ", ".join(suffixes) + (f" (extra [cyan]{extra}[/])" if extra else "")
        for extra, suffixes in groups.items()
    ]
    return f"Files that are read: {'; '.join(lines)}; GeoTIFF with the extra [cyan]geotiff[/]."


SUMMARY = (
    "Smooth fields with fair contours from samples on a grid: they pass through every sample.\n\n"
    f"{_readable()} A folder of DICOM slices is read as a volume."
)

Input = Annotated[Path, typer.Argument(metavar="IN", help="File of samples.", show_default=False)]

Key = Annotated[
    str | None,
    typer.Option(
        "--key",
        "-k",
        help="Which array, and which part of it: NAME, or NAME,time=3,level=0:5 with numbers of "
        "samples, or t=0 alone; component=2 of vectors; the number or name of a GeoTIFF band; "
        "the number of a DICOM series.",
    ),
]

Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No notes, no progress; errors only.")]

Json = Annotated[
    bool,
    typer.Option(
        "--json", help="Results, or why there are none, as one line of JSON, for programs."
    ),
]

Single = Annotated[bool, typer.Option("--float32", help="Compute in float32: half the memory.")]

Bands = Annotated[
    bool,
    typer.Option(
        "--all-bands", help="Every band of a GeoTIFF, or channel of a colour image, by itself."
    ),
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


def with_options(command: Callable[..., None]) -> Callable[..., None]:
    """A command whose parameters that are dataclasses are options, one for each field.

    In the help the options are in the place of the parameter, in the order of the fields.  The
    command receives the dataclass.
    """
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, Any] = {name: hint for name, hint in hints.items() if is_dataclass(hint)}
    parameters = []
    for name, parameter in inspect.signature(command).parameters.items():
        if name not in groups:
            parameters.append(parameter.replace(annotation=hints[name]))
            continue
        kinds = get_type_hints(groups[name], include_extras=True)
        parameters += [
            parameter.replace(name=field.name, annotation=kinds[field.name], default=field.default)
            for field in fields(groups[name])
        ]

    @wraps(command)
    def run(**given: object) -> None:
        for name, group in groups.items():
            options = {field.name: given.pop(field.name) for field in fields(group)}
            given[name] = group(**options)
        command(**given)

    # Typer reads both.
    run.__signature__ = inspect.Signature(parameters)  # pyright: ignore[reportAttributeAccessIssue]
    run.__annotations__ = {field.name: field.annotation for field in parameters}
    return run
