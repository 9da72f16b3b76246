"""The method where none is given, alone because `method` must not know any of the methods."""

from .local_fairing.method import LocalFairing
from .method import AbstractFairing


def chosen_method(method: AbstractFairing | None) -> AbstractFairing:
    """The method that is given, or `LocalFairing()` for None.

    Raises
    ------
    ValueError
        It is not an object such as `LocalFairing()`.
    """
    if method is None:
        return LocalFairing()
    if not isinstance(method, AbstractFairing):
        raise ValueError(f"method must be an object such as LocalFairing(), got {method!r}")
    return method
