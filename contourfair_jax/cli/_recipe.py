"""How samples are to be faired: the options that the commands share, read and checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from .._grid.grid import Grid
from .._grid.periodic import check_turn
from .._support.errors import InputError

if TYPE_CHECKING:
    from .._fairing.method import AbstractFairing


@dataclass(frozen=True)
class Settings:
    """The options for methods; None means the method's own default.

    `noisy` asks for the noise `sigma` that suits the samples best.
    """

    iterations: int | None = None
    thin_plate_weight: float | None = None
    sigma: float | None = None
    noisy: bool = False


@dataclass(frozen=True)
class Recipe:
    """A method by its name, its settings, and what is to be done besides.

    Cells with a missing corner have no values, unless `fill` is set.  `periodic` has the names of
    the axes that go all the way round; None for a command that joins none.
    """

    method: str = "local"
    settings: Settings = Settings()
    fill: bool = False
    single: bool = False
    periodic: tuple[str, ...] | None = None

    @staticmethod
    def parse(
        method: str,
        iterations: int | None,
        weight: float | None,
        sigma: str | None,
        fill: bool,
        single: bool,
        periodic: str | None = None,
    ) -> Recipe:
        """From the options of a command; names of axes are separated by commas.

        Raises
        ------
        InputError
            What no samples could be faired with: the method is unknown, a setting is out of its
            range, or the method fills no gaps.
        """
        automatic = sigma is not None and sigma.strip().lower() == "auto"
        noise = None if automatic else _number(sigma)
        settings = Settings(iterations, weight, noise, noisy=automatic)
        names = None if periodic is None else tuple(_split(periodic))
        recipe = Recipe(method, settings, fill, single, names)
        _check(recipe)
        return recipe

    def axes(self, grid: Grid) -> tuple[int, ...]:
        """The numbers of the axes that go all the way round.

        Raises
        ------
        InputError
            The grid has no such axis, or one that is in degrees and covers no full turn.
        """
        names = dict.fromkeys(self.periodic or ())
        return tuple(_axis_all_around(grid, name) for name in names)

    def choose(self, grid: Grid) -> AbstractFairing:
        """The method with the settings that were given.

        Raises
        ------
        InputError
            No settings can be chosen for these samples.
        """
        try:
            return METHODS[self.method](grid, self.settings)
        except ValueError as error:
            raise InputError(str(error)) from error


def _number(sigma: str | None) -> float | None:
    try:
        return None if sigma is None else float(sigma)
    except ValueError:
        raise InputError(
            f"--sigma must be a number, in the units of the samples, or auto, got {sigma!r}"
        ) from None


def _split(names: str) -> list[str]:
    return [name.strip() for name in names.split(",")] if names else []


def _axis_all_around(grid: Grid, name: str) -> int:
    """The number of an axis, which must go all the way round."""
    if name not in grid.axes:
        raise InputError(f"--periodic: there is no axis {name!r}; there are {', '.join(grid.axes)}")
    axis = grid.axes.index(name)
    try:
        check_turn(name, grid.shape[axis], grid.steps[axis], grid.metadata.get(f"{name}:units", ""))
    except ValueError as error:
        raise InputError(f"--periodic: {error}") from error
    return axis


def _check(recipe: Recipe) -> None:
    """Refuse what no samples could be faired with, before any are read."""
    method, settings = recipe.method, recipe.settings
    if method not in METHODS:
        raise InputError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    if recipe.fill and method == "local":
        raise InputError("--fill needs --method global or tune; local fairing leaves gaps")
    if method == "local" and (settings.noisy or settings.sigma is not None):
        raise InputError(
            "--sigma needs --method global or tune; local fairing passes through every sample"
        )
    if settings.noisy and method != "tune":
        raise InputError("--sigma auto needs --method tune; with others give a number")
    if settings == Settings():
        return
    from .._fairing.global_fairing.method import GlobalFairing
    from .._fairing.local_fairing.method import LocalFairing

    try:
        _chosen(LocalFairing() if method == "local" else GlobalFairing(), settings)
    except ValueError as error:
        raise InputError(str(error)) from error


def _chosen(method: AbstractFairing, settings: Settings) -> AbstractFairing:
    """The method with the settings that were given."""
    given = {name: value for name, value in vars(settings).items() if value is not None}
    del given["noisy"]
    return replace(method, **given)


def _local(grid: Grid, settings: Settings) -> AbstractFairing:
    from .._fairing.local_fairing.method import LocalFairing

    return _chosen(LocalFairing(), settings)


def _global(grid: Grid, settings: Settings) -> AbstractFairing:
    from .._fairing.global_fairing.method import GlobalFairing

    return _chosen(GlobalFairing(), settings)


def _tuned(grid: Grid, settings: Settings) -> AbstractFairing:
    import jax.numpy as jnp

    from .._fairing.tuning import tune

    values = jnp.asarray(grid.values, dtype=float)
    return _chosen(tune(values, spacing=grid.spacing, noisy=settings.noisy), settings)


# A method is chosen by its name; it may look at the samples.
METHODS: Mapping[str, Callable[[Grid, Settings], AbstractFairing]] = {
    "local": _local,
    "global": _global,
    "tune": _tuned,
}
