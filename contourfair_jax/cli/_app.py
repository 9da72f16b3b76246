"""The program: its commands, and errors in one line."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Sequence
from typing import Annotated, Any

import typer

from .._support.errors import InputError
from ._compare import COMMANDS as COMPARING
from ._console import Reporter
from ._contours import COMMANDS as CONTOURS
from ._info import COMMANDS as INFORMING
from ._meshes import COMMANDS as MESHES
from ._metrics import COMMANDS as METRICS
from ._options import SUMMARY, examples
from ._resample import COMMANDS as RESAMPLING
from ._upsample import COMMANDS as UPSAMPLING

app = typer.Typer(
    name="contourfair",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _show_version(wanted: bool) -> bool:
    if wanted:
        from .._version import __version__

        typer.echo(f"contourfair {__version__}")
        raise typer.Exit
    return wanted


@app.callback(
    help=SUMMARY,
    epilog=examples(
        "contourfair upsample dem.tif -o dem_4x.tif --factor 4",
        "contourfair contours dem.tif -o lines.geojson --interval 20",
        "contourfair compare photo.png -o figure.png",
    ),
)
def _options_of_all(
    show_version: Annotated[
        bool,
        typer.Option("--version", help="Show the version.", callback=_show_version, is_eager=True),
    ] = False,
) -> None:
    """Options of the program itself; `SUMMARY` is its help."""


# A command is one module and one row here; in this order they are listed by ``--help``.
_COMMANDS = (UPSAMPLING, RESAMPLING, CONTOURS, COMPARING, MESHES, METRICS, INFORMING)


for _rows in _COMMANDS:
    for _command, _examples in _rows.items():
        app.command(epilog=_examples)(_command)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; errors are one line on stderr, with ``--json`` also one on stdout.

    Returns
    -------
    int
        0, or 2 for input that cannot be used, 1 for a fault of the program, 130 if interrupted.
    """
    command = typer.main.get_command(app)
    words = sys.argv[1:] if arguments is None else [*arguments]
    report = Reporter(as_json="--json" in words)
    try:
        result = command.main(
            args=words,
            prog_name="contourfair",
            standalone_mode=False,
        )
    except InputError as error:
        report.error(str(error))
        return 2
    except _USAGE as error:
        message = error.format_message()
        if message:  # empty where the help was shown for want of arguments
            report.error(f"{message} (contourfair --help shows how it is used)")
        return 2
    except (KeyboardInterrupt, typer.Abort):
        result = _INTERRUPTED
    except Exception as error:
        if isinstance(error, OSError) and error.filename is not None:
            report.error(f"{os.fsdecode(error.filename)}: {error.strerror}")
            return 2
        if os.environ.get("CONTOURFAIR_TRACEBACK"):
            traceback.print_exc()
        first = (str(error).splitlines() or [""])[0]
        report.error(
            f"internal error, {type(error).__name__}: {first} "
            "(set CONTOURFAIR_TRACEBACK=1 for details)"
        )
        return 1
    if result == _INTERRUPTED:  # from Typer too, which says nothing
        report.error("interrupted")
    return result if isinstance(result, int) else 0


_INTERRUPTED = 130
# The base of all errors about how a command is called; Typer exports its subclass only.
_USAGE: Any = typer.BadParameter.__mro__[2]


if __name__ == "__main__":
    sys.exit(main())
