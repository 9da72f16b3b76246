"""The least-squares problem of an inverse fit, its scales, and its solution."""

import dataclasses
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Array, Float

from .._fair import fair_field
from .._fairing.method import AbstractFairing
from .._field import BezierField
from ._extent import Extent
from ._misfits import AbstractMisfit
from ._optimisers import AbstractOptimiser, Report, Search, loss_of, search
from ._prior import Coordinates, ThinPlate

# Residual of the solve behind a standard deviation.
TOLERANCE = 1e-4


class Problem(eqx.Module):
    """Data, prior and method: residuals as a function of the unknowns.

    The field and its data are taken relative to `centre`, so that rounding is that of their spread,
    and in units of `unit`, the mean sigma, so that squares of either stay in the range of floats.
    """

    misfits: tuple[AbstractMisfit, ...]
    extent: Extent
    method: AbstractFairing
    regularisation: ThinPlate
    coordinates: Coordinates
    centre: Float[Array, ""]
    unit: Float[Array, ""]

    def relative_field(self, z: Float[Array, "*shape"]) -> BezierField:
        """The field of the unknowns minus the centre, in units, with points from the origin on."""
        samples, spacing = self.coordinates.samples(z), self.extent.spacing
        return fair_field(samples, spacing=spacing, method=self.method)

    def field(self, z: Float[Array, "*shape"]) -> BezierField:
        """The field of the unknowns."""
        field = self.relative_field(z)
        net = field.control_points * self.unit + self.centre
        return dataclasses.replace(field, control_points=net, origin=self.extent.origin)

    def unknowns(self, samples: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        """The unknowns of samples."""
        return self.coordinates.unknowns((samples - self.centre) / self.unit)

    def differences(self, z: Float[Array, "*shape"]) -> list[Array]:
        """Residuals of all observations, field minus data, in units of the data."""
        field = self.relative_field(z)
        return [misfit.differences(field) * self.unit for misfit in self.misfits]

    def residuals(self, z: Float[Array, "*shape"]) -> list[Array]:
        """All that is squared and summed: data in units of sigma, then the prior."""
        field, samples = self.relative_field(z), self.coordinates.samples(z)
        data = [misfit.residuals(field) for misfit in self.misfits]
        prior = self.regularisation.residuals(samples, self.extent.steps)
        stiffness = jnp.sqrt(jnp.asarray(self.regularisation.weight, self.extent.dtype))
        return data + [stiffness * part for part in prior]


def pose(
    misfits: tuple[AbstractMisfit, ...],
    extent: Extent,
    method: AbstractFairing,
    regularisation: ThinPlate,
    cosines: tuple[Float[Array, "_n _n"], ...],
) -> Problem:
    """The problem with its scales: the mean of the data, and the mean sigma of one of them."""
    anchors = [misfit.anchors(extent.steps) for misfit in misfits]
    zero = jnp.zeros((), extent.dtype)
    count, logarithm = zero, zero
    for _, sigma in anchors:
        finite = jnp.isfinite(sigma)
        count = count + jnp.sum(finite, dtype=extent.dtype)
        logarithm = logarithm + jnp.sum(jnp.where(finite, jnp.log(sigma), 0))
    unit = jnp.exp(logarithm / count)
    weight, known, total = zero, zero, zero
    for values, sigma in anchors:
        weights = (unit / sigma) ** 2
        weight = weight + jnp.sum(weights)
        if values.size:
            known, total = known + jnp.sum(weights), total + jnp.sum(weights * values)
    centre = total / jnp.where(known > 0, known, 1)
    spectrum = regularisation.spectrum(extent.shape, extent.steps)
    strength = jnp.asarray(regularisation.weight, extent.dtype)
    energy = weight / math.prod(extent.shape) + strength * spectrum
    coordinates = Coordinates(1 / jnp.sqrt(energy), cosines)
    relative = tuple(misfit.relative(centre, unit) for misfit in misfits)
    return Problem(relative, extent, method, regularisation, coordinates, centre, unit)


@eqx.filter_jit
def pose_and_solve(
    misfits: tuple[AbstractMisfit, ...],
    extent: Extent,
    method: AbstractFairing,
    regularisation: ThinPlate,
    cosines: tuple[Float[Array, "_n _n"], ...],
    optimiser: AbstractOptimiser,
    start: Float[Array, "*shape"] | None,
    report: Report | None,
) -> tuple[Problem, Search, BezierField, list[Array]]:
    """Pose and solve: one compiled program for each shape, method, optimiser and kind of data.

    Returns the problem, the search, the field that it ends at, and the residuals of all
    observations in units of the data.
    """
    problem = pose(misfits, extent, method, regularisation, cosines)
    z = jnp.zeros(extent.shape, extent.dtype)
    size = jnp.sqrt(2 * loss_of(problem.residuals)(z))
    if start is not None:
        z = problem.unknowns(start)
    outcome = search(optimiser, problem.residuals, z, size, report)
    z = outcome.unknowns
    return problem, outcome, problem.field(z), problem.differences(z)


@eqx.filter_jit
def deviation(
    problem: Problem, z: Float[Array, "*shape"], gradient: Float[Array, "*net"], max_steps: int
) -> Float[Array, ""]:
    """`sqrt(q^T inv(J^T J) q)` with the Jacobian J of the residuals and the gradient q.

    The standard deviation of a quantity whose gradient in the control points is given.  NaN where
    the solve did not converge.
    """
    (slope,) = jax.vjp(lambda z: problem.field(z).control_points, z)[1](gradient)
    _, push = jax.linearize(problem.residuals, z)
    pull = jax.linear_transpose(push, z)
    operator = lx.FunctionLinearOperator(
        lambda x: pull(push(x))[0], jax.eval_shape(lambda: z), lx.positive_semidefinite_tag
    )
    largest = jnp.max(jnp.abs(slope))
    slope = slope / jnp.where(largest == 0, 1, largest)
    size = jnp.sqrt(jnp.sum(slope * slope))
    size = jnp.where(size == 0, 1, size)
    solver = lx.CG(0.0, TOLERANCE, norm=optx.two_norm, max_steps=max_steps)
    solution = lx.linear_solve(operator, slope / size, solver, throw=False)
    value = largest * jnp.sqrt(size * jnp.sum(slope * solution.value))
    return jnp.where(solution.result == lx.RESULTS.successful, value, jnp.nan)
