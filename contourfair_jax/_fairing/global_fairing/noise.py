"""Samples met within their noise: by springs to them, as stiff as the misfit is that of noise.

The fit is linear in the samples, u = H a, for normals held fixed.  Noise of variance sigma^2 leaves
residuals of which `sum ((u - a) / sigma)^2` is `n - tr H` in the mean: the field follows noise with
`tr H` degrees of freedom (Wahba 1990).  Springs are renewed until that holds.  `n - tr H` is
estimated as `z . (z - H z)` for random signs z (Hutchinson 1990), the same in every call.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..method import FLAT
from .cell_form import Dofs
from .linear_system import LinearSystem, Precision, Solution, solve

# The softest springs, beside an energy of about 1.  Under noise above the spread of the samples
# they would go on softening for ever, and nothing would hold planes.
LEAST = 1e-6
# The first springs beside those that the forces of an exact fit would stretch by the noise.  Under
# much noise the forces give way, so these are too hard; under little, springs that are too soft are
# the sooner corrected.
SOFTER = 0.03
# Powers of what the misfit is too small by that the stiffness is renewed with.
POWERS = (0.7, 3.0)
# Changes of its logarithm that say too little of how it goes with the stiffness.
SLIGHT = 0.1
# Degrees of freedom need not be as exact as the field, but are to be estimated from it at all.
COARSER, COARSEST = 100, 0.1
# The smallest part of all degrees of freedom that is believed to be left.
LEAST_LEFT = 1e-3


class Noise(NamedTuple):
    """How well every sample is known: 1 / sigma^2 in units of the spread, zero for nothing.

    `judged` is the same for the samples whose misfit counts.
    """

    trust: Float[Array, " vertices"]
    judged: Float[Array, " vertices"]


def noise_of(
    sigma: float | Float[Array | np.ndarray, "*#shape"],
    missing: Bool[Array, "*shape"],
    spread: Float[Array, ""],
    layers: int,
) -> Noise:
    """Noise of samples; misfits of those within some layers of the border do not count."""
    relative = jnp.broadcast_to(jnp.asarray(sigma, spread.dtype), missing.shape) / spread
    trust = jnp.where(missing, 0, 1 / relative**2)
    inside = (slice(layers, -layers or None),) * missing.ndim
    judged = jnp.zeros_like(trust).at[inside].set(trust[inside])
    return Noise(trust.ravel(), judged.ravel())


class Springs(NamedTuple):
    """Springs that hold the samples, and what the fit before said of them.

    Infinitely stiff at first, for an exact fit: normals come from fields that follow the samples,
    and its forces tell how stiff springs have to be.
    """

    stiffness: Float[Array, ""]
    before: Float[Array, ""]  # the stiffness of the fit before, infinite where that was exact
    square: Float[Array, ""]  # its mean square of misfit over sigma, over that of noise

    @property
    def exact(self) -> Bool[Array, ""]:
        """Whether samples are met exactly."""
        return jnp.isinf(self.stiffness)

    @property
    def finite(self) -> Float[Array, ""]:
        """The stiffness, 1 where it is infinite."""
        return jnp.where(self.exact, 1, self.stiffness)

    def pins(self, noise: Noise) -> Float[Array, " vertices"]:
        """The stiffness of the spring to every sample, zero for an exact fit."""
        return jnp.where(self.exact, 0, self.finite) * noise.trust

    def renewed(
        self, noise: Noise, system: LinearSystem, field: Dofs, left: Float[Array, ""]
    ) -> "Springs":
        """Springs that bring the misfit of the field that they led to nearer to that of noise.

        `left` is the part of the degrees of freedom that the field does not follow.
        """
        known = noise.judged > 0
        count = jnp.maximum(jnp.sum(known, dtype=field.dtype), 1)
        misfit = field[0] - system.start[0]
        square = jnp.sum(noise.judged * misfit**2) / (count * left)
        square = jnp.maximum(square, FLAT**2)
        # Those that are known well say most of the first stiffness: the others will give way.
        force = jnp.where(known, system.form.forces(system.weights, field)[0], 0)
        held = jnp.sum(force**2) / jnp.maximum(jnp.sum(noise.judged), FLAT**2)
        first = SOFTER * jnp.sqrt(jnp.maximum(held, FLAT**2))
        renewed = self.finite * square ** self._power(square, left)
        least = LEAST / jnp.maximum(jnp.max(noise.judged), 1)
        stiffness = jnp.maximum(jnp.where(self.exact, first, renewed), least)
        return Springs(stiffness, self.stiffness, square)

    def _power(self, square: Float[Array, ""], left: Float[Array, ""]) -> Float[Array, ""]:
        """How the stiffness went with the misfit between the fit before and this one.

        Where nothing is known of that, as it would were H a multiple of the identity.
        """
        known = ~self.exact & ~jnp.isinf(self.before)
        change = jnp.log(square / jnp.where(known, self.square, 1))
        known = known & (jnp.abs(change) > SLIGHT)
        stiffer = jnp.log(self.finite / jnp.where(known, self.before, 1))
        likely = 1 / jnp.maximum(1 - left, 1 / POWERS[1])
        return jnp.clip(jnp.where(known, -stiffer / jnp.where(known, change, 1), likely), *POWERS)


def first_springs(dtype: jnp.dtype) -> Springs:
    """Those of an exact fit."""
    infinite = jnp.full((), jnp.inf, dtype)
    return Springs(infinite, infinite, infinite)


def solve_within_noise(
    system: LinearSystem,
    springs: Springs,
    noise: Noise,
    guess: Dofs,
    size: Float[Array, ""],
    precision: Precision,
) -> tuple[Solution, Springs]:
    """`solve` with springs to the samples, of a system that meets them exactly; the next springs.

    An exact fit where the springs are infinitely stiff.
    """
    system = system._replace(free=system.free | ~springs.exact, pins=springs.pins(noise))
    left, size = _freedom_left(system, noise, size, precision)
    solution = solve(system, guess, size, precision)
    return solution, springs.renewed(noise, system, solution.value, left)


def _freedom_left(
    system: LinearSystem, noise: Noise, size: Float[Array, ""], precision: Precision
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The part of the degrees of freedom that is not followed, and the size of `solve`."""
    known = noise.judged > 0
    signs = jax.random.rademacher(jax.random.key(0), known.shape, system.start.dtype)
    signs = jnp.where(noise.trust > 0, signs, 0)
    start = jnp.zeros_like(system.start).at[0].set(signs)
    tolerance = min(COARSER * precision.tolerance, COARSEST)
    coarser = precision._replace(tolerance=tolerance)
    followed = solve(system._replace(start=start), start, size, coarser)
    rest = jnp.sum(jnp.where(known, signs * (signs - followed.value[0]), 0))
    rest = rest / jnp.maximum(jnp.sum(known, dtype=rest.dtype), 1)
    return jnp.clip(rest, LEAST_LEFT, 1), followed.size
