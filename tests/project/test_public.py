"""Public packages: what `dir` shows, what a call of one says, and former names."""

import copy
import pickle
import sys
from importlib import import_module
from types import ModuleType

import pytest

import contourfair_jax as cf
from contourfair_jax._support.public import former_keyword

PACKAGES = (*cf._MODULES, "xarray", "cli")


def former_names():
    for name in cf._MODULES:
        for before, place in vars(getattr(cf, name))["_former"].items():
            yield name, before, *((place, place) if isinstance(place, str) else place)


@pytest.mark.parametrize("name", PACKAGES)
def test_a_package_shows_its_public_names_only(name):
    package = import_module(f"contourfair_jax.{name}")
    assert [each for each in dir(package) if not each.startswith("_")] == sorted(package.__all__)
    public = {each for each in vars(package) if not each.startswith("_")}
    submodules = {each for each in public if f"{package.__name__}.{each}" in sys.modules}
    assert public - submodules <= {*package.__all__, "annotations"}


def test_the_whole_shows_its_public_names_only():
    assert {name for name in dir(cf) if not name.startswith("_")} == {*cf.__all__, *cf._MODULES}


@pytest.mark.parametrize("name", cf._MODULES)
def test_a_package_that_is_called_says_what_to_call(name):
    package = getattr(cf, name)
    with pytest.raises(TypeError, match=f"contourfair_jax.{name} is a module; call "):
        package(1, levels=2)
    named = [word for word in vars(package)["_instead"].split() if word.startswith("contourfair")]
    for word in named:
        home, _, function = word.partition("(")[0].rpartition(".")
        assert callable(getattr(import_module(home), function))


def test_a_call_of_contours():
    with pytest.raises(TypeError) as error:
        cf.contours([1.0])
    assert str(error.value) == (
        "contourfair_jax.contours is a module; call field.contours(levels) or "
        "contourfair_jax.contours.contours(field, levels)"
    )


@pytest.mark.parametrize(("package", "before", "place", "now"), list(former_names()))
def test_former_names_are_what_they_were_and_warn(package, before, place, now):
    home, _, attribute = place.rpartition(".")
    with pytest.warns(DeprecationWarning, match=f"{package}.{before} is a former .* use {now}"):
        found = getattr(getattr(cf, package), before)
    assert found is getattr(import_module(home), attribute)
    home, _, attribute = now.rpartition(".")
    assert attribute in import_module(home).__all__
    assert before not in dir(getattr(cf, package))


def test_former_names_are_complete():
    assert {(package, before) for package, before, _, _ in former_names()} >= {
        ("export", "draw_lines"),
        ("export", "draw_bands"),
        ("export", "write_bands"),
        ("geometry", "willmore"),
        ("io", "write_geojson"),
        ("io", "write_svg"),
        ("io", "ContourLine"),
        ("metrics", "surface_coarea"),
        ("plot", "BilinearField"),
    }


@pytest.mark.parametrize("name", cf._MODULES)
def test_packages_are_pickled_and_copied_as_modules(name):
    package = getattr(cf, name)
    assert isinstance(package, ModuleType)
    assert pickle.loads(pickle.dumps(package)) is package
    assert copy.deepcopy(package) is package
    with pytest.raises(AttributeError, match=f"{name}' has no attribute 'nothing'"):
        _ = package.nothing


def test_a_former_keyword_is_taken_and_warns():
    @former_keyword("colour", "color")
    def paint(color: str) -> str:
        """A colour."""
        return color

    assert paint("red") == paint(color="red") == "red"
    with pytest.warns(DeprecationWarning, match=r"colour= of .*paint .* use color="):
        assert paint(colour="red") == "red"
    with (
        pytest.raises(TypeError, match="multiple values"),
        pytest.warns(DeprecationWarning, match="use color="),
    ):
        paint("red", colour="blue")
    assert paint.__doc__ == "A colour."
