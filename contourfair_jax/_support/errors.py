"""Errors about files, the data in them, and packages that are not installed."""

from collections.abc import Iterable
from importlib.util import find_spec


class InputError(ValueError):
    """A file or its data cannot be used; the message is one line: which file, what, the repair."""


class MissingPackageError(InputError, ImportError):
    """An optional package is not installed; the message names the extra that brings it."""


def needed(packages: str | Iterable[str], extra: str, doing: str) -> None:
    """Refuse to go on without optional packages; nothing is imported.

    Parameters
    ----------
    packages
        The names under which they are imported.
    extra
        The extra of this package that brings them.
    doing
        What they are needed for: it starts the message.

    Raises
    ------
    MissingPackageError
        Some are not installed: which, and how to install them.
    """
    names = (packages,) if isinstance(packages, str) else packages
    absent = [name for name in names if not find_spec(name)]
    if absent:
        raise MissingPackageError(
            f"{doing} needs {', '.join(absent)}: pip install 'contourfair-jax[{extra}]'"
        )


def one_line(error: BaseException) -> str:
    """The first line of an error's message, or its type where it has none."""
    text = str(error).strip()
    return text.splitlines()[0] if text else type(error).__name__
