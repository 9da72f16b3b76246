"""What the command line says while it works: notes, a progress bar, errors of one line."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

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

    def _show(self, progress: Progress, text: str) -> None:
        if self._console.is_terminal:
            progress.start()
        else:
            self._console.print(f"{text} ...", markup=False)
