"""Public packages: what `dir` shows of them, what to call instead of them, and former names."""

import functools
import sys
import warnings
from collections.abc import Callable, Mapping
from importlib import import_module
from types import ModuleType
from typing import Any, NoReturn, ParamSpec, TypeAlias, TypeVar

Params = ParamSpec("Params")
Result = TypeVar("Result")
Former: TypeAlias = Mapping[str, str | tuple[str, str]]


class PublicModule(ModuleType):
    """A module whose `dir` is its `__all__`, and that says what to call where it is called."""

    _instead: str
    _former: Former

    def __dir__(self) -> list[str]:
        own = vars(self)
        return sorted({*own["__all__"], *(name for name in own if name.startswith("__"))})

    def __call__(self, *args: Any, **kwargs: Any) -> NoReturn:
        raise TypeError(f"{self.__name__} is a module; call {self._instead}")

    def __getattr__(self, name: str) -> Any:
        if name not in self._former:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        place = self._former[name]
        place, now = (place, place) if isinstance(place, str) else place
        warn_former(f"{self.__name__}.{name}", now)
        home, _, attribute = place.rpartition(".")
        return getattr(import_module(home), attribute)

    def __reduce__(self) -> tuple[Callable[[str], ModuleType], tuple[str]]:
        return import_module, (self.__name__,)


def public(
    name: str, instead: str, former: Mapping[str, str | tuple[str, str]] | None = None
) -> None:
    """Make the module of this name a `PublicModule`; the last thing that its file does.

    Parameters
    ----------
    name : str
        Its `__name__`.
    instead : str
        What to call instead of the module.
    former : mapping
        Names that it had, given for one version more, with a warning: to the full new name, or to
        where the former thing is and the full name of what to use instead of it.
    """
    module = sys.modules[name]
    module.__class__ = PublicModule
    vars(module).update(_instead=instead, _former=former or {})


def warn_former(before: str, now: str, stacklevel: int = 2) -> None:
    """A DeprecationWarning about a public name or call; as `warnings.warn` for its caller."""
    warnings.warn(
        f"{before} is a former name and goes with the next version; use {now}",
        DeprecationWarning,
        stacklevel + 1,
    )


def former_keyword(
    before: str, now: str
) -> Callable[[Callable[Params, Result]], Callable[Params, Result]]:
    """A decorator: the function also takes an argument by the name that it had before."""

    def decorate(function: Callable[Params, Result]) -> Callable[Params, Result]:
        @functools.wraps(function)
        def call(*args: Params.args, **kwargs: Params.kwargs) -> Result:
            if before in kwargs:
                warn_former(f"{before}= of {function.__qualname__}", f"{now}=", stacklevel=2)
                kwargs[now] = kwargs.pop(before)
            return function(*args, **kwargs)

        return call

    return decorate
