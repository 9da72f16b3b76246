"""The options for fairing that the commands share: declared, read and checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .._grid.grid import Grid
from .._grid.periodic import check_turn
from .._support.errors import InputError

if TYPE_CHECKING:
    from .._fairing.method import AbstractFairing


@dataclass(frozen=True)
class Recipe:
    """A method by its name, its settings, and what is to be done besides.

    Parameters
    ----------
    settings
        The settings that were given; the method has defaults of its own for the others.
    noisy
        Whether to look for the noise `sigma` that suits the samples best.
    fill
        Whether cells with a missing corner have values.
    single
        Whether to compute in float32.
    periodic
        The names of the axes that go all the way round; None for a command that joins none.
    """

    method: str = "local"
    settings: Mapping[str, Any] = field(default_factory=dict)
    noisy: bool = False
    fill: bool = False
    single: bool = False
    periodic: tuple[str, ...] | None = None

    @staticmethod
    def parse(options: Fairing, single: bool) -> Recipe:
        """From the options of a command.

        Raises
        ------
        InputError
            What no samples could be faired with: the method is unknown, a setting is out of its
            range, or the method fills no gaps.
        """
        given = {name: value for name, value in vars(options).items() if value is not None}
        method, fill = given.pop("method"), given.pop("fill")
        periodic = tuple(_split(given.pop("periodic"))) if "periodic" in given else None
        noisy = given.get("sigma", "").strip().lower() == "auto"
        if noisy:
            del given["sigma"]
        elif "sigma" in given:
            given["sigma"] = _number(given["sigma"])
        recipe = Recipe(method, given, noisy, fill, single, periodic)
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
            return METHODS[self.method](grid, self)
        except ValueError as error:
            raise InputError(str(error)) from error


def _number(sigma: str) -> float:
    try:
        return float(sigma)
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
    if method == "local" and (recipe.noisy or "sigma" in settings):
        raise InputError(
            "--sigma needs --method global or tune; local fairing passes through every sample"
        )
    if recipe.noisy and method != "tune":
        raise InputError("--sigma auto needs --method tune; with others give a number")
    if not settings:
        return
    from .._fairing.global_fairing.method import GlobalFairing
    from .._fairing.local_fairing.method import LocalFairing

    try:
        replace(LocalFairing() if method == "local" else GlobalFairing(), **settings)
    except ValueError as error:
        raise InputError(str(error)) from error


def _local(grid: Grid, recipe: Recipe) -> AbstractFairing:
    from .._fairing.local_fairing.method import LocalFairing

    return LocalFairing(**recipe.settings)


def _global(grid: Grid, recipe: Recipe) -> AbstractFairing:
    from .._fairing.global_fairing.method import GlobalFairing

    return GlobalFairing(**recipe.settings)


def _tuned(grid: Grid, recipe: Recipe) -> AbstractFairing:
    import jax.numpy as jnp

    from .._fairing.tuning import tune

    values = jnp.asarray(grid.values, dtype=float)
    return replace(tune(values, spacing=grid.spacing, noisy=recipe.noisy), **recipe.settings)


# A method is chosen by its name; it may look at the samples.
METHODS: Mapping[str, Callable[[Grid, Recipe], AbstractFairing]] = {
    "local": _local,
    "global": _global,
    "tune": _tuned,
}


def _method_names() -> list[str]:
    return list(METHODS)


@dataclass(frozen=True)
class Fairing:
    """The options for fairing of every command that fairs, each declared here only.

    `with_options` puts them into the signatures of the commands.  A setting of the methods is one
    field more, with the name that it has there and None as its default.
    """

    method: Annotated[
        str,
        typer.Option(
            "--method",
            "-m",
            help=f"How to fair: {', '.join(METHODS)}.",
            autocompletion=_method_names,
        ),
    ] = "local"
    iterations: Annotated[
        int | None,
        typer.Option(help="Renewals of the normals; 0: thin plate. [dim]\\[default: 3][/]"),
    ] = None
    thin_plate_weight: Annotated[
        float | None,
        typer.Option(
            "--thin-plate-weight",
            help="Share of thin plate energy. [dim]\\[default: of the method][/]",
        ),
    ] = None
    sigma: Annotated[
        str | None,
        typer.Option(
            "--sigma",
            metavar="NUMBER|auto",
            help="Noise of the samples, in their units: the field passes them within it instead of "
            "through them.  With --method tune, auto finds it.",
            show_default=False,
        ),
    ] = None
    fill: Annotated[
        bool,
        typer.Option(
            "--fill", help="Keep what global fairing puts in the place of missing samples."
        ),
    ] = False


@dataclass(frozen=True)
class JoinedFairing(Fairing):
    """The options for fairing of commands that can join the ends of axes."""

    periodic: Annotated[
        str,
        typer.Option(
            "--periodic",
            help="Axes that go all the way round, such as lon, separated by commas: after the last "
            "sample comes the first.",
            show_default=False,
        ),
    ] = ""
