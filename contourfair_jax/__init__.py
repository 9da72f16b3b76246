"""Smooth fields with fair contours from sampled scalar fields, differentiable, on JAX."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ._version import __version__ as __version__

if TYPE_CHECKING:
    from . import adaptive as adaptive
    from . import contours as contours
    from . import export as export
    from . import geometry as geometry
    from . import inverse as inverse
    from . import io as io
    from . import isosurface as isosurface
    from . import metrics as metrics
    from . import plot as plot
    from . import tiles as tiles
    from ._fair import FairUpsample as FairUpsample
    from ._fair import fair_field as fair_field
    from ._fairing.global_fairing.method import GlobalFairing as GlobalFairing
    from ._fairing.local_fairing.method import LocalFairing as LocalFairing
    from ._fairing.local_fairing.solvers import LU as LU
    from ._fairing.local_fairing.solvers import AbstractSolver as AbstractSolver
    from ._fairing.local_fairing.solvers import Cholesky as Cholesky
    from ._fairing.local_fairing.solvers import LeastSquares as LeastSquares
    from ._fairing.method import AbstractFairing as AbstractFairing
    from ._fairing.tuning import cross_validation_error as cross_validation_error
    from ._fairing.tuning import tune as tune
    from ._field import BezierField as BezierField


# The module of every public name.  Modules are imported when they or a name is first used, so that
# the command line answers `--help`, and files are read, without importing JAX.
_MODULE_OF = {
    "AbstractFairing": "_fairing.method",
    "AbstractSolver": "_fairing.local_fairing.solvers",
    "BezierField": "_field",
    "Cholesky": "_fairing.local_fairing.solvers",
    "FairUpsample": "_fair",
    "GlobalFairing": "_fairing.global_fairing.method",
    "LU": "_fairing.local_fairing.solvers",
    "LeastSquares": "_fairing.local_fairing.solvers",
    "LocalFairing": "_fairing.local_fairing.method",
    "cross_validation_error": "_fairing.tuning",
    "fair_field": "_fair",
    "tune": "_fairing.tuning",
}

_MODULES = (
    "adaptive",
    "contours",
    "export",
    "geometry",
    "inverse",
    "io",
    "isosurface",
    "metrics",
    "plot",
    "tiles",
)

__all__ = [
    "LU",
    "AbstractFairing",
    "AbstractSolver",
    "BezierField",
    "Cholesky",
    "FairUpsample",
    "GlobalFairing",
    "LeastSquares",
    "LocalFairing",
    "cross_validation_error",
    "fair_field",
    "tune",
]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(f".{name}", __name__)
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_MODULE_OF[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    own = (name for name in globals() if name.startswith("__"))
    return sorted({*own, *_MODULE_OF, *_MODULES})
