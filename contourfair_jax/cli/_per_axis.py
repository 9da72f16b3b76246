"""Options that hold one number for all axes, one for each, or some by the names of the axes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from .._grid.grid import Grid
from .._support.errors import InputError

Number = TypeVar("Number", int, float)


@dataclass(frozen=True)
class PerAxis(Generic[Number]):
    """The numbers of an option.

    Parameters
    ----------
    option
        Its name, for messages.
    numbers
        One for all axes, or several.
    names
        The axes that they are for; without, the numbers are for all axes in order.
    """

    option: str
    numbers: tuple[Number, ...]
    names: tuple[str, ...] = ()

    @classmethod
    def parse(
        cls, option: str, text: str, number: Callable[[str], Number], wanted: str
    ) -> PerAxis[Number]:
        """Read ``4``, ``1,1,4`` or ``z=4``; `number` raises ValueError for what is no number.

        Raises
        ------
        InputError
            The text is none of these; the message says what is `wanted`.
        """
        parts = [part.strip() for part in text.split(",")]
        names, numbers = zip(*(part.rpartition("=")[::2] for part in parts), strict=True)
        mixed = 0 < sum(map(bool, names)) < len(names)
        try:
            parsed = tuple(number(part.strip()) for part in numbers)
        except ValueError:
            mixed, parsed = True, ()
        if mixed:
            raise InputError(f"{option} must be {wanted}, got {text}")
        return cls(option, parsed, tuple(name.strip() for name in names if name))

    def of(self, grid: Grid, others: Sequence[Number]) -> tuple[Number, ...]:
        """The number of every axis of a grid; of one that is not named, that of `others`.

        Raises
        ------
        InputError
            The grid has another number of axes, or none of that name.
        """
        axes = ", ".join(grid.axes)
        if not self.names:
            if len(self.numbers) not in (1, grid.ndim):
                raise InputError(
                    f"{self.option} must be one number or {grid.ndim}, for the axes {axes}, got "
                    f"{','.join(map(str, self.numbers))}"
                )
            return self.numbers * (grid.ndim if len(self.numbers) == 1 else 1)
        unknown = [name for name in self.names if name not in grid.axes]
        if unknown:
            raise InputError(f"{self.option}: there is no axis {unknown[0]!r}; there are {axes}")
        given = dict(zip(self.names, self.numbers, strict=True))
        return tuple(given.get(name, other) for name, other in zip(grid.axes, others, strict=True))


def parse_spacing(text: str) -> PerAxis[float]:
    """Read ``10``, ``2,1,1`` or ``z=1``.

    Raises
    ------
    InputError
        The text is none of these, or a number is not above zero.
    """
    wanted = (
        "a number such as 10, one for each axis such as 2,1,1, or given by names such as z=1, in "
        "the units of the coordinates"
    )
    given = PerAxis.parse("--spacing", text, float, wanted)
    if not all(0 < step < math.inf for step in given.numbers):
        raise InputError(f"--spacing must be above zero, got {text}")
    return given


@dataclass(frozen=True)
class Factor:
    """The option ``--factor``: how many times finer along each axis."""

    given: PerAxis[int]

    @classmethod
    def parse(cls, text: str) -> Factor:
        """Read ``4``, ``1,1,4`` or ``z=4``.

        Raises
        ------
        InputError
            The text is none of these, or a number is below 1.
        """
        wanted = (
            "a whole number such as 4, one for each axis such as 1,1,4, or given by names such as "
            "z=4"
        )
        given = PerAxis.parse("--factor", text, _whole, wanted)
        if min(given.numbers) < 1:
            raise InputError(f"--factor must be 1 or more, got {text}")
        return cls(given)

    def of(self, grid: Grid) -> tuple[int, ...]:
        """The factor of every axis of a grid; of one that is not named, 1.

        Raises
        ------
        InputError
            The grid has another number of axes, or none of that name.
        """
        return self.given.of(grid, (1,) * grid.ndim)


def _whole(text: str) -> int:
    if not text.isdecimal():
        raise ValueError(text)
    return int(text)
