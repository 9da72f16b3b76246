"""Smooth fields with fair contours from sampled scalar fields, differentiable, on JAX."""

from ._fair import fair_field as fair_field
from ._field import BezierField as BezierField
from ._local import LocalFairing as LocalFairing
from ._method import AbstractFairing as AbstractFairing
from ._solve import LU as LU
from ._solve import AbstractSolver as AbstractSolver
from ._solve import Cholesky as Cholesky
from ._solve import LeastSquares as LeastSquares

__version__ = "0.1.0"
