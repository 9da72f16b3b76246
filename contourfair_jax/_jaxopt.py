"""The one module that imports jaxopt, whose import warns that it is no longer maintained."""

import warnings
from collections.abc import Callable

with warnings.catch_warnings():
    warnings.filterwarnings("ignore", category=DeprecationWarning)
    import jaxopt


def lbfgs(loss: Callable, history: int) -> "jaxopt.LBFGS":
    """Limited-memory BFGS that is stepped from outside."""
    return jaxopt.LBFGS(loss, history_size=history, tol=0.0, implicit_diff=False)
