"""Samples met within their noise: springs to them, stiffened until the misfit is that of noise."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ._energy import FLAT

# Part of the first stiffness that is kept in any case.  Under noise above the spread of the samples
# it would go to zero for ever, and nothing would hold planes.
LEAST = 1e-6


def trust(
    sigma: float | Float[Array, "*shape"] | None,
    missing: Bool[Array, "*shape"],
    spread: Float[Array, ""],
) -> Float[Array, "vertices_or_1"]:
    """1 / sigma^2 of every sample in units of the spread; zero where nothing is known.

    One zero for all without `sigma`: XLA adds up long constants when it compiles, which takes it
    far longer than the program later.
    """
    if sigma is None:
        return jnp.zeros(1, spread.dtype)
    relative = jnp.broadcast_to(jnp.asarray(sigma, spread.dtype), missing.shape) / spread
    return jnp.where(missing, 0, 1 / relative**2).ravel()


def first_stiffness(trust: Float[Array, "vertices_or_1"]) -> Float[Array, ""]:
    """A stiffness with which no spring is harder than the energy."""
    return 1 / jnp.maximum(jnp.max(trust), 1)


def inner(
    trust: Float[Array, "vertices_or_1"], shape: tuple[int, ...], layers: int
) -> Float[Array, "vertices_or_1"]:
    """That of the samples that are `layers` away from the border; the others do not count."""
    if len(trust) == 1 or not layers:
        return trust
    inside = (slice(layers, -layers),) * len(shape)
    trust = trust.reshape(shape)
    return jnp.zeros_like(trust).at[inside].set(trust[inside]).ravel()


def next_stiffness(
    stiffness: Float[Array, ""],
    trust: Float[Array, "vertices_or_1"],
    misfit: Float[Array, " vertices"],
) -> Float[Array, ""]:
    """A stiffness that brings the mean square of misfit over sigma nearer to 1."""
    square = jnp.sum(trust * misfit**2)
    square = square / jnp.maximum(jnp.sum(trust > 0, dtype=trust.dtype), 1)
    # Where samples pull hard the mean square goes with stiffness^-2, else it is slower.
    stiffness = stiffness * jnp.maximum(square, FLAT**2) ** 0.75
    return jnp.maximum(stiffness, LEAST * first_stiffness(trust))
