"""Errors about files and the data in them."""


class InputError(ValueError):
    """A file or its data cannot be used; the message is one line: which file, what, the repair."""


class MissingPackageError(InputError):
    """The format needs a package that is not installed; the message names the extra."""


def one_line(error: BaseException) -> str:
    """The first line of an error's message, or its type where it has none."""
    text = str(error).strip()
    return text.splitlines()[0] if text else type(error).__name__
