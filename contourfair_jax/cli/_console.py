"""Messages of the command line: notes, a progress bar, errors of one line."""

from __future__ import annotations

import json
import math
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    SpinnerColumn,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as Bar

from .._support.results import Progress, untold

_PATIENCE = 1.0


class Reporter:
    """Speaks to the user on stderr, so that stdout holds results only.

    Parameters
    ----------
    quiet
        Leave out notes and progress; errors are always shown.
    as_json
        Show results as one line of JSON, the notes among them.
    """

    def __init__(self, quiet: bool = False, as_json: bool = False) -> None:
        self.quiet = quiet
        self.as_json = as_json
        self._notes: list[str] = []
        self._console = Console(stderr=True, soft_wrap=True, highlight=False)

    def note(self, text: str) -> None:
        """One line that the user should know."""
        self._notes.append(text)
        if not self.quiet and not self.as_json:
            self._console.print(_printable(f"note: {text}"), markup=False)

    def error(self, text: str) -> None:
        """One line that says why there is no result; as JSON, results are that line on stdout."""
        if self.as_json:
            print(json.dumps({"error": text}))
        self._console.print(_printable(f"contourfair: {text}"), markup=False)

    def done(self, target: Path, text: str, **facts: Any) -> None:
        """Say on stdout what was written, in words, or with `facts` as JSON."""
        if self.as_json:
            self.result({"output": str(target), **facts})
        elif not self.quiet:
            print(_printable(f"{target}: {text}"))

    def result(self, facts: dict[str, Any]) -> None:
        """Show results, and the notes so far, as one line of JSON; what is not finite is null."""
        print(json.dumps(_plain({**facts, "notes": self._notes}), allow_nan=False))

    @contextmanager
    def working(self, text: str) -> Iterator[Progress]:
        """Show a bar with the time passed, once the work takes more than a second.

        Yields what moves the bar; until it is called, the bar swings.
        """
        if self.quiet:
            yield untold
            return
        bar = Bar(
            SpinnerColumn(),
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            TimeElapsedColumn(),
            console=self._console,
            transient=True,
        )
        task = bar.add_task(text, total=None)
        timer = threading.Timer(_PATIENCE, self._show, (bar, text))
        timer.daemon = True
        timer.start()
        try:
            yield lambda done, total: bar.update(task, completed=done, total=total)
        finally:
            timer.cancel()
            timer.join()
            if bar.live.is_started:
                bar.stop()

    @contextmanager
    def counting(self, text: str, unit: str, size: float) -> Iterator[Progress]:
        """Show a bar with the rate and the time left; yields what moves it.

        Parameters
        ----------
        unit, size
            What the rate is counted in, and how many of them all is.
        """
        columns = (
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            TaskProgressColumn(),
            TextColumn("{task.fields[rate]}"),
            TimeRemainingColumn(compact=True, elapsed_when_finished=True),
        )
        shown = not self.quiet and self._console.is_terminal
        with Bar(*columns, console=self._console, transient=True, disable=not shown) as bar:
            task = bar.add_task(text, total=None, rate="")
            began: list[tuple[float, int]] = []

            def move(done: int, total: int) -> None:
                now = time.monotonic()
                if not began:
                    began.append((now, done))
                seconds, count = now - began[0][0], done - began[0][1]
                rate = count / total * size / seconds if count else 0
                bar.update(task, completed=done, total=total, rate=f"{rate:.3g} {unit}/s")

            yield move

    def _show(self, bar: Bar, text: str) -> None:
        if self._console.is_terminal:
            bar.start()
        else:
            self._console.print(_printable(f"{text} ..."), markup=False)


def _printable(text: str) -> str:
    """`text` as a terminal can show it: names of files may be of bytes that are no characters."""
    encoding = sys.stdout.encoding or "utf-8"
    return text.encode(encoding, "backslashreplace").decode(encoding)


def _plain(value: Any) -> Any:
    """Containers and numbers that JSON has."""
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value
