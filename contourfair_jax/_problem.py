"""The least-squares problem of an inverse fit, its scales, and its solution."""

import dataclasses
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Array, Float

from ._extent import Extent
from ._fair import fair_field
from ._field import BezierField
from ._method import AbstractFairing
from ._misfit import AbstractMisfit
from ._optimise import AbstractOptimiser, Report, Search, loss_of, search
from ._prior import Coordinates, ThinPlate

# Residual of the solve behind a standard deviation.
TOLERANCE = 1e-4


class Problem(eqx.Module):
    """Data, prior and method: residuals as a function of the unknowns.

    The field and its data are taken relative to `centre`, so that rounding is that of their spread.
    """

    misfits: tuple[AbstractMisfit, ...]
    extent: Extent
    method: AbstractFairing
    regularisation: ThinPlate
    strength: Float[Array, ""]
    coordinates: Coordinates
    centre: Float[Array, ""]

    def relative_field(self, z: Float[Array, "*shape"]) -> BezierField:
        """The field of the unknowns minus the centre, with points counted from the origin."""
        samples, spacing = self.coordinates.samples(z), self.extent.spacing
        return fair_field(samples, spacing=spacing, method=self.method)

    def field(self, z: Float[Array, "*shape"]) -> BezierField:
        """The field of the unknowns."""
        field = self.relative_field(z)
        net = field.control_points + self.centre
        return dataclasses.replace(field, control_points=net, origin=self.extent.origin)

    def residuals(self, z: Float[Array, "*shape"]) -> list[Array]:
        """All that is squared and summed: data in units of sigma, then the prior."""
        field, samples = self.relative_field(z), self.coordinates.samples(z)
        data = [misfit.shifted(self.centre).residuals(field) for misfit in self.misfits]
        prior = self.regularisation.residuals(samples, self.extent.steps)
        return data + [jnp.sqrt(self.strength) * part for part in prior]


def pose(
    misfits: tuple[AbstractMisfit, ...],
    extent: Extent,
    method: AbstractFairing,
    regularisation: ThinPlate,
    cosines: tuple[Float[Array, "n n"], ...],
) -> Problem:
    """The problem with its scales: the mean of the data, and the mean weight of one of them."""
    zero = jnp.zeros((), extent.dtype)
    weight, count, logarithm, known, total = zero, zero, zero, zero, zero
    for misfit in misfits:
        values, sigma = misfit.anchors(extent.steps)
        weights = 1 / (sigma * sigma)
        weight, count = weight + jnp.sum(weights), count + jnp.sum(weights > 0, dtype=extent.dtype)
        logarithm = logarithm + jnp.sum(jnp.where(weights > 0, jnp.log(sigma), 0))
        if values.size:
            known, total = known + jnp.sum(weights), total + jnp.sum(weights * values)
    centre = total / jnp.where(known > 0, known, 1)
    strength = jnp.asarray(regularisation.weight, extent.dtype) * jnp.exp(-2 * logarithm / count)
    spectrum = regularisation.spectrum(extent.shape, extent.steps)
    energy = weight / math.prod(extent.shape) + strength * spectrum
    coordinates = Coordinates(1 / jnp.sqrt(energy), cosines)
    return Problem(misfits, extent, method, regularisation, strength, coordinates, centre)


@eqx.filter_jit
def solve(
    misfits: tuple[AbstractMisfit, ...],
    extent: Extent,
    method: AbstractFairing,
    regularisation: ThinPlate,
    cosines: tuple[Float[Array, "n n"], ...],
    optimiser: AbstractOptimiser,
    start: Float[Array, "*shape"] | None,
    report: Report | None,
) -> tuple[Problem, Search, BezierField, list[Array]]:
    """Pose and solve: one compiled program for each shape, method, optimiser and kind of data.

    Also the field that was found, and the differences of all data from it.
    """
    problem = pose(misfits, extent, method, regularisation, cosines)
    z = jnp.zeros(extent.shape, extent.dtype)
    size = jnp.sqrt(2 * loss_of(problem.residuals)(z))
    if start is not None:
        z = problem.coordinates.unknowns(start - problem.centre)
    found = search(optimiser, problem.residuals, z, size, report)
    field = problem.field(found.unknowns)
    relative = problem.relative_field(found.unknowns)
    differences = [each.shifted(problem.centre).differences(relative) for each in misfits]
    return problem, found, field, differences


@eqx.filter_jit
def deviation(
    problem: Problem, z: Float[Array, "*shape"], gradient: Float[Array, "*net"], max_steps: int
) -> Float[Array, ""]:
    """`sqrt(q^T inv(J^T J) q)` with the Jacobian J of the residuals and the gradient q.

    Of a quantity whose gradient in the control points is given.  NaN where the solve did not
    converge.
    """
    (slope,) = jax.vjp(lambda z: problem.field(z).control_points, z)[1](gradient)
    _, push = jax.linearize(problem.residuals, z)
    pull = jax.linear_transpose(push, z)
    operator = lx.FunctionLinearOperator(
        lambda x: pull(push(x))[0], jax.eval_shape(lambda: z), lx.positive_semidefinite_tag
    )
    size = jnp.sqrt(jnp.sum(slope * slope))
    size = jnp.where(size == 0, 1, size)
    solver = lx.CG(0.0, TOLERANCE, norm=optx.two_norm, max_steps=max_steps)
    solution = lx.linear_solve(operator, slope / size, solver, throw=False)
    variance = size * jnp.sum(slope * solution.value)
    return jnp.where(solution.result == lx.RESULTS.successful, jnp.sqrt(variance), jnp.nan)
