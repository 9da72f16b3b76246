"""The option ``--factor``: one for all axes, one for each, or some by the names of the axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from .io import Grid, InputError


@dataclass(frozen=True)
class Factor:
    """How many times finer.

    Parameters
    ----------
    numbers
        One for all axes, or several.
    names
        The axes that they are for; without, the numbers are for all axes in order.
    """

    numbers: tuple[int, ...]
    names: tuple[str, ...] = ()

    @classmethod
    def parse(cls, text: str) -> Factor:
        """What ``4``, ``1,1,4`` or ``z=4`` ask for.

        Raises
        ------
        InputError
            The text is none of these, or a number is below 1.
        """
        parts = [part.strip() for part in text.split(",")]
        names, numbers = zip(*(part.rpartition("=")[::2] for part in parts), strict=True)
        whole = all(number.strip().isdecimal() for number in numbers)
        if not whole or 0 < sum(map(bool, names)) < len(names):
            raise InputError(
                "--factor must be a whole number such as 4, one for each axis such as 1,1,4, or "
                f"given by names such as z=4, got {text}"
            )
        if min(map(int, numbers)) < 1:
            raise InputError(f"--factor must be 1 or more, got {text}")
        return cls(tuple(map(int, numbers)), tuple(name.strip() for name in names if name))

    def of(self, grid: Grid) -> tuple[int, ...]:
        """The factor of every axis of a grid; of one that is not named, 1.

        Raises
        ------
        InputError
            The grid has another number of axes, or none of that name.
        """
        axes = ", ".join(grid.axes)
        if not self.names:
            if len(self.numbers) not in (1, grid.ndim):
                raise InputError(
                    f"--factor must be one number or {grid.ndim}, for the axes {axes}, got "
                    f"{','.join(map(str, self.numbers))}"
                )
            return self.numbers * (grid.ndim if len(self.numbers) == 1 else 1)
        unknown = [name for name in self.names if name not in grid.axes]
        if unknown:
            raise InputError(f"--factor: there is no axis {unknown[0]!r}; there are {axes}")
        given = dict(zip(self.names, self.numbers, strict=True))
        return tuple(given.get(name, 1) for name in grid.axes)


def describe_factors(factors: Sequence[int]) -> str:
    """``4``, or ``1 x 1 x 4`` where they differ."""
    if len(set(factors)) == 1:
        return str(factors[0])
    return " x ".join(map(str, factors))
