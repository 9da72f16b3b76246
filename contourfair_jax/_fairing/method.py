"""What `fair_field(method=...)` takes, and what a fit reports."""

import abc

import equinox as eqx
from jaxtyping import Array, Bool, Float, Int


class FitReport(eqx.Module):
    """What an iterative fit says of itself; kept by the field as `field.report`.

    Parameters
    ----------
    converged : bool array, shape ()
        Whether every linear solve met its tolerance within the step limit, and the iteration its
        own where it has one.
    updates : array, shape (iterations + 1,)
        Largest change of a value, a slope or a mixed derivative per cell in each iteration, in
        units of the samples' spread.  That of the control net is smaller.
    steps : array of int, shape (iterations + 1,)
        Steps of conjugate gradients in each iteration.
    residuals : array, shape (iterations + 1,)
        Residual at the end of each solve, relative to its right-hand side.
    filled : bool array, shape (n_1, ..., n_d)
        Samples that were missing (NaN) and are filled by the field.
    """

    converged: Bool[Array, ""]
    updates: Float[Array, " solves"]
    steps: Int[Array, " solves"]
    residuals: Float[Array, " solves"]
    filled: Bool[Array, "*shape"]


class AbstractFairing(eqx.Module):
    """A way to choose the control net of a fair field from samples.

    Real-valued settings are leaves of the pytree and may be traced; counts are static.
    """

    @abc.abstractmethod
    def fit(
        self, values: Float[Array, "*shape"], spacing: Float[Array, " ndim"]
    ) -> tuple[Float[Array, "*net"], FitReport | None]:
        """Control net with 3 (n - 1) + 1 points per axis, the samples at every third."""

    def prepare(self, values: Float[Array, "*shape"]) -> "AbstractFairing":
        """The method for these samples, which may be traced.

        Raises ValueError for settings whose shape does not fit, and for known samples that the
        method has no answer for.
        """
        return self

    def warn(self, report: FitReport | None) -> None:
        """Warn of a fit that fell short; called where it is known."""


# Gradients below this fraction of the neighbourhood's spread count as flat: N fades to zero.
FLAT = 1e-6
