"""The option ``--factor``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ._per_axis import PerAxis
from .io import Grid, InputError


@dataclass(frozen=True)
class Factor:
    """How many times finer."""

    given: PerAxis[int]

    @classmethod
    def parse(cls, text: str) -> Factor:
        """What ``4``, ``1,1,4`` or ``z=4`` ask for.

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


def describe_factors(factors: Sequence[int]) -> str:
    """``4``, or ``1 x 1 x 4`` where they differ."""
    if len(set(factors)) == 1:
        return str(factors[0])
    return " x ".join(map(str, factors))
