"""Texts in headers that consist of lines, alone because several formats have such headers."""

import re
from collections.abc import Mapping

# What ends a line for one reader or another, and the character that ends a text, with the white
# space around.
_LINE_ENDS = re.compile(r"\s*[\0\n\v\f\r\x1c-\x1e\x85\u2028\u2029]+\s*")


def single_line(text: object, most: int | None = None) -> str:
    """A text with a space in the place of its line ends, cut to at most `most` bytes."""
    line = _LINE_ENDS.sub(" ", str(text)).strip()
    return line.encode("utf-8", "replace")[:most].decode("utf-8", "ignore").strip()


def header_lines(texts: Mapping[str, object], most: int | None = None) -> dict[str, str]:
    """Names and texts such that each pair is one line; what is empty is left out.

    Colons and equals signs, at which readers divide a line, become ``_`` in names, and a name does
    not begin with the sign of a comment.
    """
    pairs = (
        (re.sub("[:=]+", "_", single_line(name)).lstrip("# "), single_line(text, most))
        for name, text in texts.items()
        if text is not None
    )
    return {name: line for name, line in pairs if name and line}
