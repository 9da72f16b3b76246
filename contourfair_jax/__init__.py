"""Smooth fields with fair contours from sampled scalar fields, differentiable, on JAX."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

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
    from ._cross_validation import cross_validation_error as cross_validation_error
    from ._fair import fair_field as fair_field
    from ._field import BezierField as BezierField
    from ._global import GlobalFairing as GlobalFairing
    from ._layer import FairUpsample as FairUpsample
    from ._local import LocalFairing as LocalFairing
    from ._method import AbstractFairing as AbstractFairing
    from ._solve import LU as LU
    from ._solve import AbstractSolver as AbstractSolver
    from ._solve import Cholesky as Cholesky
    from ._solve import LeastSquares as LeastSquares
    from ._tune import tune as tune

__version__ = "0.1.0"

# The module of every public name.  Modules are imported when they or a name is first used, so that
# the command line answers `--help`, and files are read, without importing JAX.
_MODULE_OF = {
    "AbstractFairing": "_method",
    "AbstractSolver": "_solve",
    "BezierField": "_field",
    "Cholesky": "_solve",
    "FairUpsample": "_layer",
    "GlobalFairing": "_global",
    "LU": "_solve",
    "LeastSquares": "_solve",
    "LocalFairing": "_local",
    "cross_validation_error": "_cross_validation",
    "fair_field": "_fair",
    "tune": "_tune",
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
    return sorted({*globals(), *_MODULE_OF, *_MODULES})
