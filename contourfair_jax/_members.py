"""Immutable results that are sequences."""

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from typing import TypeVar, overload

Member = TypeVar("Member", covariant=True)


class Members(Sequence[Member]):
    """A sequence of what one of its fields holds."""

    @property
    @abstractmethod
    def members(self) -> tuple[Member, ...]:
        """What this is a sequence of."""

    @overload
    def __getitem__(self, index: int) -> Member: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[Member, ...]: ...

    def __getitem__(self, index: int | slice) -> Member | tuple[Member, ...]:
        return self.members[index]

    def __len__(self) -> int:
        return len(self.members)

    def __iter__(self) -> Iterator[Member]:
        return iter(self.members)
