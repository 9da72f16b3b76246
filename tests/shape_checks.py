"""The check of annotations while the tests run; `conftest.py` puts it on the whole package."""

from collections.abc import Iterator
from contextlib import contextmanager

import jaxtyping
import pytest
from beartype import BeartypeConf, beartype

# An int is a float, as for static checkers (PEP 484).
checked = beartype(conf=BeartypeConf(is_pep484_tower=True))


@contextmanager
def refused(*errors: type[Exception], match: str) -> Iterator[pytest.ExceptionInfo]:
    """As `pytest.raises`, for arguments of wrong types: the package is to refuse them by itself."""
    jaxtyping.config.update("jaxtyping_disable", True)
    try:
        with pytest.raises(errors, match=match) as caught:
            yield caught
    finally:
        jaxtyping.config.update("jaxtyping_disable", False)
