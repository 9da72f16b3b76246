"""What `fair_field(method=...)` takes."""

import abc

import equinox as eqx
from jaxtyping import Array, Float


class AbstractFairing(eqx.Module):
    """A way to choose the control net of a fair field from samples.

    Real-valued settings are leaves of the pytree and may be traced; counts are static.
    """

    @abc.abstractmethod
    def control_points(
        self, values: Float[Array, "*shape"], spacing: Float[Array, " ndim"]
    ) -> Float[Array, "*net"]:
        """Control net with 3 (n - 1) + 1 points per axis, the samples at every third."""
