"""Errors: optional packages that are not installed."""

import pickle
import sys

import pytest

from contourfair_jax._support.errors import InputError, MissingPackageError, needed, one_line


def test_nothing_is_refused_where_all_is_installed():
    needed(("numpy", "jax"), "tables", "reading tables")
    needed((), "tables", "reading tables")


def test_what_is_missing_is_named_with_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "numpy", None)
    message = r"^reading tables needs numpy, nosuch: pip install 'contourfair-jax\[tables\]'$"
    with pytest.raises(MissingPackageError, match=message):
        needed(("numpy", "jax", "nosuch"), "tables", "reading tables")
    with pytest.raises(MissingPackageError, match=r"^this needs numpy: pip"):
        needed("numpy", "tables", "this")


def test_a_missing_package_is_bad_input_and_an_import_error():
    error = MissingPackageError("tables need nosuch")
    assert isinstance(error, InputError)
    assert isinstance(error, ImportError)
    assert str(error) == one_line(error) == str(pickle.loads(pickle.dumps(error)))
