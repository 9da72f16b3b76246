"""Results as JSON beside facts about the machine, and tables of the documents made from them."""

import json
import os
import platform
from collections.abc import Callable, Iterable, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

RESULTS = Path(__file__).parents[1] / "results"
PACKAGES = ("contourfair-jax", "jax", "jaxlib", "numpy", "scipy", "scikit-image", "interpax")

Result: TypeAlias = dict[str, Any]
Item = TypeVar("Item")
Track: TypeAlias = Callable[[Sequence[Any], str], Iterable[Any]]
"""``track(items, description)`` yields the items and shows progress."""


def silent(items: Sequence[Item], description: str) -> Iterable[Item]:
    """Yield the items and show nothing."""
    return items


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def machine_facts() -> Result:
    """Processor, cores and versions; nothing that identifies the machine."""
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "packages": {name: _version(name) for name in PACKAGES},
    }


def save(name: str, result: Result, folder: Path = RESULTS) -> Path:
    """Write one benchmark's result, rounded to six digits, beside the machine's facts."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.json"
    partial = path.with_suffix(".partial")
    partial.write_text(
        json.dumps({"machine": machine_facts(), **_rounded(result)}, indent=1) + "\n"
    )
    partial.replace(path)
    return path


def load(name: str, folder: Path = RESULTS) -> Result | None:
    """Read one benchmark's result, or None where it has not been run."""
    path = folder / f"{name}.json"
    return json.loads(path.read_text()) if path.exists() else None


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(k): _rounded(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(v) for v in value]
    if isinstance(value, float):
        return float(f"{value:.6g}")
    return value


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Markdown table; the first column is text, the others are aligned right."""
    lines = ["| " + " | ".join(header) + " |", "|---|" + "---:|" * (len(header) - 1)]
    lines += ["| " + " | ".join("–" if c is None else str(c) for c in row) + " |" for row in rows]
    return "\n".join(lines)


def size(shape: Iterable[int]) -> str:
    """The shape of a grid, as 64×64."""
    return "×".join(map(str, shape))


def figure(value: float | None, digits: int = 4) -> str | None:
    """Fixed digits without the leading zero, as .0123."""
    if value is None:
        return None
    text = f"{value:.{digits}f}"
    return text.replace("0.", ".", 1) if abs(value) < 1.0 else text


def bold_least(cells: Sequence[str | None], values: Sequence[float | None]) -> list[str | None]:
    """Set the cell of the smallest value in bold."""
    known = [v for v in values if v is not None]
    least = min(known) if known else None
    return [
        f"**{c}**" if c is not None and v == least else c
        for c, v in zip(cells, values, strict=True)
    ]


def replace_tables(text: str, tables: dict[str, str]) -> str:
    """Put each table between ``<!-- table:NAME -->`` and the next ``<!-- end -->``.

    Raises
    ------
    ValueError
        A marker without its end.
    """
    for name, body in tables.items():
        start = f"<!-- table:{name} -->"
        if start not in text:
            continue
        before, rest = text.split(start, 1)
        if "<!-- end -->" not in rest:
            raise ValueError(f"{start} has no <!-- end --> after it; add one")
        after = rest.split("<!-- end -->", 1)[1]
        text = f"{before}{start}\n{body}\n<!-- end -->{after}"
    return text
