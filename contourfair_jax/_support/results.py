"""Immutable results that are sequences, and progress of long calls."""

from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from typing import TypeAlias, TypeVar, overload

Member = TypeVar("Member", covariant=True)


class Members(Sequence[Member]):
    """A result that is a sequence of the members in one of its fields."""

    @property
    @abstractmethod
    def members(self) -> tuple[Member, ...]:
        """The members in their order."""

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


# Called as ``progress(done, total)``, first with nothing done: so all long calls tell how far they
# are.
Progress: TypeAlias = Callable[[int, int], None]


def untold(done: int, total: int) -> None:
    """Show nothing of what is done."""
