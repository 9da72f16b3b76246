"""Inverse problems: samples whose fair field explains observations of it.

Find samples v that minimise, with the field f of `fair_field(v)`::

    1/2 sum over data ((f - data) / sigma)^2 + regularisation(v)

Data of several kinds combine: values at points, averages over boxes, contour lines, slopes, masks.
The result passes through nothing exactly; it weighs data by their sigma.
"""

from .._support.public import public as _public
from ._fit import InverseFit as InverseFit
from ._fit import fit_samples as fit_samples
from ._observations import AbstractObservation as AbstractObservation
from ._observations import BoxAverages as BoxAverages
from ._observations import ContourLines as ContourLines
from ._observations import Masks as Masks
from ._observations import Slopes as Slopes
from ._observations import Values as Values
from ._optimisers import BFGS as BFGS
from ._optimisers import LBFGS as LBFGS
from ._optimisers import AbstractOptimiser as AbstractOptimiser
from ._optimisers import Dogleg as Dogleg
from ._optimisers import GaussNewton as GaussNewton
from ._optimisers import Search as Search
from ._prior import ThinPlate as ThinPlate

__all__ = [
    "BFGS",
    "LBFGS",
    "AbstractObservation",
    "AbstractOptimiser",
    "BoxAverages",
    "ContourLines",
    "Dogleg",
    "GaussNewton",
    "InverseFit",
    "Masks",
    "Search",
    "Slopes",
    "ThinPlate",
    "Values",
    "fit_samples",
]

_public(
    __name__,
    "contourfair_jax.inverse.fit_samples(observations, shape)",
)
