"""Options that several commands share are declared once."""

from dataclasses import dataclass, fields
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from contourfair_jax.cli import app
from contourfair_jax.cli._options import with_options
from contourfair_jax.cli._recipe import Fairing, JoinedFairing, Recipe
from contourfair_jax.io import InputError


@dataclass(frozen=True)
class Ink:
    colour: Annotated[str, typer.Option("--colour", "-c", help="Of the lines.")] = "black"
    width: Annotated[float | None, typer.Option(help="In points.")] = None


def test_fields_become_options_in_the_place_of_the_parameter():
    received = []

    @with_options
    def draw(name: str, first: int = 1, *, ink: Ink, last: bool = False) -> None:
        """Draw."""
        received.append((name, first, ink, last))

    program = typer.Typer()
    program.command()(draw)
    assert [each.name for each in typer.main.get_command(program).params[:5]] == [
        "name",
        "first",
        "colour",
        "width",
        "last",
    ]
    assert CliRunner().invoke(program, ["a", "-c", "red", "--width", "2", "--last"]).exit_code == 0
    assert CliRunner().invoke(program, ["b"]).exit_code == 0
    assert received == [("a", 1, Ink("red", 2.0), True), ("b", 1, Ink(), False)]


FAIRING = ("upsample", "resample", "contours", "compare", "isosurface", "adaptive", "metrics")


@pytest.mark.parametrize("name", FAIRING)
def test_every_command_that_fairs_has_every_option(name):
    names = [each.name for each in typer.main.get_command(app).commands[name].params]
    options = [each.name for each in fields(Fairing)]
    first = names.index("method")
    assert names[first : first + len(options)] == options
    assert ("periodic" in names) == (name not in ("compare", "metrics"))


def test_a_recipe_has_what_was_given():
    assert Recipe.parse(Fairing(), single=False) == Recipe()
    given = JoinedFairing("global", iterations=0, sigma="0.5", fill=True, periodic="lon, lat")
    recipe = Recipe.parse(given, single=True)
    assert recipe.settings == {"iterations": 0, "sigma": 0.5}
    assert recipe.periodic == ("lon", "lat")
    assert (recipe.fill, recipe.single, recipe.noisy) == (True, True, False)
    assert Recipe.parse(JoinedFairing(), single=False).periodic == ()
    automatic = Recipe.parse(Fairing("tune", sigma=" Auto "), single=False)
    assert automatic.noisy
    assert "sigma" not in automatic.settings


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (Fairing("spline"), "method must be one of local, global, tune, got 'spline'"),
        (Fairing(sigma="1"), "--sigma needs --method global or tune"),
        (Fairing("global", sigma="auto"), "--sigma auto needs --method tune"),
        (Fairing("global", sigma="much"), "--sigma must be a number"),
        (Fairing(fill=True), "--fill needs --method global or tune"),
        (Fairing(iterations=-1), "iterations must be an integer"),
        (Fairing("global", thin_plate_weight=0.0), "thin_plate_weight must be a real number above"),
    ],
)
def test_what_no_samples_could_be_faired_with_is_refused(options, message):
    with pytest.raises(InputError, match=message):
        Recipe.parse(options, single=False)
