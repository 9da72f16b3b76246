"""Samples fitted to observations of their fair field."""

import dataclasses
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int
from rich.console import Console
from rich.status import Status

from .._fairing.default import chosen_method
from .._fairing.method import AbstractFairing
from .._field import BezierField
from .._support import checks
from .._support.arrays import is_traced
from .._support.results import Progress
from ._extent import Extent, check_finite
from ._observations import AbstractObservation
from ._optimisers import AbstractOptimiser, GaussNewton, Search
from ._prior import ThinPlate, cosines
from ._problem import Problem, deviation, pose_and_solve

# The displays in use, innermost last: compiled programs call `tell`, and know of no display.
_ACTIVE: list[Callable[[int, float, float], object]] = []


def tell(step: Any, loss: Any, gradient: Any) -> None:
    """Show how far the search is; called by the compiled program."""
    if _ACTIVE:
        _ACTIVE[-1](int(step), float(loss), float(gradient))


@contextmanager
def shown(progress: bool | Progress, max_steps: int) -> Iterator[None]:
    """Tell `progress` of the steps while the block runs, or show a line on stderr if it is True."""
    if not progress:
        yield
        return
    with ExitStack() as stack:
        if callable(progress):
            told = progress

            def show(step: int, loss: float, gradient: float) -> None:
                told(step, max_steps)
        else:
            status = stack.enter_context(Status("compiling", console=Console(stderr=True)))

            def show(step: int, loss: float, gradient: float) -> None:
                status.update(f"step {step}: loss {loss:.4g}, gradient {gradient:.1e}")

        _ACTIVE.append(show)
        try:
            yield
            jax.effects_barrier()
        finally:
            _ACTIVE.remove(show)


class InverseFit(eqx.Module):
    """Result of `fit_samples`.

    Parameters
    ----------
    field : BezierField
        The fair field of the samples that were found.
    residuals : tuple of arrays
        For every observation, in their order: field minus data, in units of the data.  Of contour
        lines at the points where they were compared, see `points`; of masks by how much the field
        is short of its margin.
    points : tuple of arrays or None
        Where the residuals were taken; None for box averages.
    search : Search
        `converged`, `steps`, and the histories `losses` and `gradients` (norms, relative to the
        size of the data), before the first and after each step; NaN after the last.
    problem : Problem
        The least-squares problem that was solved.
    """

    field: BezierField
    residuals: tuple[Float[Array, "..."], ...]
    points: tuple[Float[Array | np.ndarray, "_n ndim"] | None, ...]
    search: Search
    problem: Problem = eqx.field(repr=False)

    @property
    def samples(self) -> Float[Array, "*shape"]:
        """The samples that were found."""
        return self.field.samples

    @property
    def converged(self) -> Bool[Array, ""]:
        """Whether the gradient of the loss went below the tolerance of the optimiser."""
        return self.search.converged

    @property
    def steps(self) -> Int[Array, ""]:
        """Steps of the optimiser."""
        return self.search.steps

    @property
    def losses(self) -> Float[Array, " visited"]:
        """Loss before the first and after each step; NaN after the last."""
        return self.search.losses

    def standard_deviation(
        self, quantity: Callable[[BezierField], Array], max_steps: int = 500
    ) -> Float[Array, ""]:
        """Standard deviation of a scalar function of the field, to first order.

        The noise of the data has their sigma, and the samples are believed to be as smooth as the
        regularisation says; then the samples have the covariance `inv(J^T J)` near the solution,
        with the Jacobian J of all residuals, and `quantity` the standard deviation
        `sqrt(q^T inv(J^T J) q)` with its gradient q.  One linear solve; nothing is sampled.

        Parameters
        ----------
        quantity : callable
            From a field to a scalar, differentiable; for example `lambda f: f(point)`.
        max_steps : int
            Limit on the steps of conjugate gradients.

        Raises
        ------
        ValueError
            For a quantity that is not a scalar.
        """
        shape = jax.eval_shape(quantity, self.field).shape
        if shape != ():
            raise ValueError(
                f"quantity must return a scalar, got shape {shape}; index or sum it, or use "
                "jax.vmap over what it depends on"
            )

        def of_net(net: Array) -> Array:
            return quantity(dataclasses.replace(self.field, control_points=net))

        # Not in the compiled program, where the spacing and the origin are less exact.
        gradient = jax.grad(of_net)(self.field.control_points)
        return deviation(self.problem, self.search.unknowns, gradient, max_steps)


def fit_samples(
    observations: AbstractObservation | Sequence[AbstractObservation],
    shape: Sequence[int],
    *,
    spacing: ArrayLike | Sequence[float] = 1.0,
    origin: ArrayLike | Sequence[float] = 0.0,
    method: AbstractFairing | None = None,
    optimiser: AbstractOptimiser | None = None,
    start: ArrayLike | None = None,
    regularisation: ThinPlate | None = None,
    dtype: str | np.dtype | None = None,
    progress: bool | Progress = False,
) -> InverseFit:
    """Find samples whose fair field explains observations.

    Parameters
    ----------
    observations : observation, or sequence of them
        `Values`, `BoxAverages`, `ContourLines`, `Slopes`, `Masks`.
    shape : tuple of int
        Samples along each axis, at least 3.
    spacing, origin
        As for `fair_field`.
    method : AbstractFairing
        How the samples become a field; `LocalFairing()` by default.  With `iterations=0` the
        problem is linear, and faster.
    optimiser : AbstractOptimiser
        `GaussNewton()` by default; also `Dogleg()`, `BFGS()`, `LBFGS()`.
    start : array, shape `shape`, or None
        Samples to start from; by default all at the mean of the data.
    regularisation : ThinPlate
        What is assumed of samples that the data do not determine; `ThinPlate()` by default.
    dtype : dtype or None
        float32 or float64; the default float of JAX by default.
    progress : bool or callable
        True shows a line with step, loss and gradient.  A callable is called as
        ``progress(done, total)`` with the steps that are done and `max_steps` of the optimiser,
        before which the search may end.

    Returns
    -------
    InverseFit

    Raises
    ------
    ValueError
        For no observations, points outside the grid, and what `fair_field` refuses.

    Warns
    -----
    UserWarning
        Outside `jax.jit`, where the search did not converge.

    Notes
    -----
    Data that contradict each other, such as contour lines of two levels at the same place, are no
    error: the field goes between them, and `residuals` tells.

    The search is a loop until convergence: the result has derivatives in the data in forward mode
    (`jax.jvp`, `jax.jacfwd`), but not in reverse mode.

    Examples
    --------
    >>> import numpy as np
    >>> import contourfair_jax as cf
    >>> from contourfair_jax.inverse import LBFGS, Values, fit_samples
    >>> points = np.random.default_rng(0).uniform(0, 7, (60, 2)).astype("float32")
    >>> fit = fit_samples(Values(points, points.sum(axis=1), sigma=0.01), (8, 8))
    >>> bool(fit.converged)
    True
    >>> float(abs(fit.residuals[0]).max()) < 0.01
    True
    """
    observed = _as_tuple(observations)
    extent = _extent(shape, spacing, origin, dtype)
    prepared = [observation.prepare(extent) for observation in observed]
    fairing = chosen_method(method)
    chosen = _checked(optimiser, GaussNewton, AbstractOptimiser, "optimiser")
    prior = _checked(regularisation, ThinPlate, ThinPlate, "regularisation")
    first = None
    if start is not None:
        checks.check_shape(start, extent.shape, "start")
        check_finite(start, "start")
        first = jnp.asarray(start, extent.dtype)
    bases = tuple(jnp.asarray(cosines(n), extent.dtype) for n in extent.shape)
    misfits = tuple(misfit for misfit, _ in prepared)
    with shown(progress, chosen.max_steps):
        report = tell if progress else None
        problem, outcome, field, differences = pose_and_solve(
            misfits, extent, fairing, prior, bases, chosen, first, report
        )
    if not is_traced(outcome.converged):
        _warn(outcome)
    counts = [count for _, count in prepared]
    sites = [getattr(misfit, "points", None) for misfit in misfits]
    pairs = zip(sites, counts, strict=True)
    return InverseFit(
        # Outside of the compiled program they are as exact as they were given.
        dataclasses.replace(field, spacing=extent.spacing, origin=extent.origin),
        tuple(residuals[:count] for residuals, count in zip(differences, counts, strict=True)),
        tuple(None if at is None else extent.absolute(at[:count]) for at, count in pairs),
        outcome,
        problem,
    )


def _warn(outcome: Search) -> None:
    if not bool(outcome.converged):
        step = int(outcome.steps)
        gradient = float(outcome.gradients[step])
        warnings.warn(
            f"fit_samples did not converge: after {step} steps the gradient is "
            f"{gradient:.1e} of the data; raise max_steps of the optimiser or "
            "the weight of the regularisation, or allow a larger tolerance",
            UserWarning,
            stacklevel=3,
        )


def _as_tuple(
    observations: AbstractObservation | Sequence[AbstractObservation],
) -> tuple[AbstractObservation, ...]:
    single = isinstance(observations, AbstractObservation)
    observed = (observations,) if single else tuple(observations)  # type: ignore[arg-type]
    if not observed:
        raise ValueError("observations must hold at least one observation, got none")
    for observation in observed:
        if not isinstance(observation, AbstractObservation):
            raise ValueError(
                f"observations must be objects such as Values(points, values), got {observation!r}"
            )
    return observed


def _extent(shape: Sequence[int], spacing: object, origin: object, dtype: object) -> Extent:
    sizes = tuple(shape) if isinstance(shape, Sequence) else (shape,)
    if len(sizes) not in checks.DIMENSIONS:
        raise ValueError(f"shape must have 2 or 3 axes, got {shape!r}")
    for size in sizes:
        checks.check_count(size, 3, "shape along every axis")
    kind = np.dtype(float if dtype is None else dtype)  # type: ignore[arg-type]
    if kind not in (np.float32, np.float64):
        raise ValueError(f"dtype must be float32 or float64, got {kind}")
    if dtype is None:
        kind = jax.dtypes.canonicalize_dtype(kind)
    elif kind == np.float64 and not jax.config.jax_enable_x64:  # type: ignore[attr-defined]
        raise ValueError(
            "dtype must be float32 while JAX computes in float32, got float64; "
            "call jax.config.update('jax_enable_x64', True) first"
        )
    steps = checks.check_per_axis(spacing, len(sizes), "spacing", positive=True)
    corner = checks.check_per_axis(origin, len(sizes), "origin")
    return Extent(sizes, steps, corner, kind)


def _checked(value: Any, default: type, kind: type, name: str) -> Any:
    if value is None:
        return default()
    if not isinstance(value, kind):
        raise ValueError(f"{name} must be an object such as {default.__name__}(), got {value!r}")
    return value
