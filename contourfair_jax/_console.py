"""What the command line says while it works: notes, a progress bar, errors of one line."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    SpinnerColumn,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

_PATIENCE = 1.0


class Reporter:
    """Speaks to the user on stderr, so that stdout holds results only.

    Parameters
    ----------
    quiet
        Leave out notes and progress; errors are always shown.
    """

    def __init__(self, quiet: bool = False) -> None:
        self.quiet = quiet
        self._console = Console(stderr=True, soft_wrap=True, highlight=False)

    def note(self, text: str) -> None:
        """One line that the user should know."""
        if not self.quiet:
            self._console.print(f"note: {text}", markup=False)

    def error(self, text: str) -> None:
        """One line that says why there is no result."""
        self._console.print(f"contourfair: {text}", markup=False)

    @contextmanager
    def working(self, text: str) -> Iterator[None]:
        """Show a bar with the time passed, once the work takes more than a second."""
        if self.quiet:
            yield
            return
        progress = Progress(
            SpinnerColumn(),
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            TimeElapsedColumn(),
            console=self._console,
            transient=True,
        )
        progress.add_task(text, total=None)
        timer = threading.Timer(_PATIENCE, self._show, (progress, text))
        timer.daemon = True
        timer.start()
        try:
            yield
        finally:
            timer.cancel()
            timer.join()
            if progress.live.is_started:
                progress.stop()

    @contextmanager
    def counting(self, text: str, unit: str, size: float) -> Iterator[Callable[[int, int], None]]:
        """A function ``(done, all)`` that moves a bar, with the rate and the time left.

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
        with Progress(*columns, console=self._console, transient=True, disable=not shown) as bar:
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

    def _show(self, progress: Progress, text: str) -> None:
        if self._console.is_terminal:
            progress.start()
        else:
            self._console.print(f"{text} ...", markup=False)
