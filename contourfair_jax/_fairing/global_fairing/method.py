"""Global fairing: the contour energy over the whole C1 space, with coherent normals.

The energy of `_energy` over all cells at once, with a tensor M that is constant in every cell, so
that the integrals are exact::

    E(u) = sum_cells e^(p/2),    e = sum_ab M_ab ( sum_c <f_ac, f_bc> + tension <f_a, f_b> / h^2
                                                   + smoothness h^2 sum_ce <f_ace, f_bce> ).

Samples fix the values at the vertices; slopes are free.  Each iteration renews M from the field and
solves for the slopes by conjugate gradients.  Every sample pins its vertex, so the number of steps
does not grow with the grid.  A missing sample only frees its value.
"""

import dataclasses
import warnings
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._bezier.nets import set_samples
from ..._support import checks
from ..._support.arrays import is_traced
from ..method import AbstractFairing, FitReport
from .border import LARGEST_DEGREE, LAYERS, continue_samples
from .cell_form import CellForm, energy_form, structure_form
from .cell_weights import LARGEST_COHERENCE, Powers, normal_weights, power_weights, weighs_cells
from .coarse_grids import has_wide_holes
from .hermite import cells_to_rows, to_net
from .linear_system import LinearSystem, Precision, save_solutions, solve
from .noise import first_springs, noise_of, solve_within_noise
from .overshoot import limit_slopes
from .renewals import Info, State, converge, renew

# Of a thin plate to noisy samples, whose springs are renewed although its normals are not.
SPRING_ITERATIONS = 3


class GlobalFairing(AbstractFairing):
    """Global fairing: the most accurate reconstruction, and the one for holes.

    Minimises `integral tr(H M H)` with `M = I - (1 - w) N` over all C1 piecewise bicubic
    (tricubic) fields through the samples.  `N` is the normal tensor of each cell, averaged over a
    neighbourhood; it is renewed in every iteration.  Unlike the pointwise normals of
    `LocalFairing` this iteration converges.

    Missing samples (NaN) are filled by the same energy.

    Parameters
    ----------
    thin_plate_weight : float
        The weight w of the thin plate energy, in (0, 1].  Smaller is fairer, and slower.
    iterations : int
        How often the normals are renewed after the first, thin plate fit; 0 is thin plate alone,
        which with `sigma` takes as many fits as 3, since its springs to the samples are renewed.
    coherence : float
        Width of the Gaussian that averages the normal tensors, in cells, 0 to 2.5.
    sharpness : int
        Power p of the normal tensor, `N = J^p / tr(J^p)`: larger trusts the main direction more.
    tension : float
        Weight of `g^T M g / h^2` in the energy, with h the smallest spacing.  Holds slopes back,
        for a thin plate (w = 1) in all directions, otherwise along the contours: more for rough
        and for jagged samples.
    hessian_weight : float
        Weight of `h^2 H H^T` beside `g g^T` in the tensor J that normals come from, with h the
        smallest spacing.  The gradient alone misses how the field bends along ridges, valleys and
        on slopes; with both (Koethe's boundary tensor) small `thin_plate_weight` suits terrain
        too.  0.5 to 8.
    smoothness : float
        Weight of `h^2 tr(D^3 M D^3)`, the third derivatives, in the energy.  0.01 to 0.04 makes up
        for what cubic cells lack on smooth data.
    norm : float or None
        Power p of the energy, `sum over cells of (integral tr(H M H))^(p/2)`, in [1, 2].  2, or
        None, is least squares.  Smaller lets the field bend where it must, at edges and ridges, and
        swings less beside them.
    sigma : float or array, shape (n_1, ..., n_d), or None
        Standard deviation of the noise of the samples, in their units.  The field then passes
        near the samples instead of through them: `sum(((f - a) / sigma)^2)` tends to the number
        of samples less the degrees of freedom with which the field follows their noise.  These are
        estimated with random signs: flipped or transposed samples give a slightly other field, by
        0.15 sigma at 7 x 8 samples, less than 0.01 sigma from 24 x 24 on.  For data rounded to
        multiples of s sigma is `s / sqrt(12)`; `tune(values, noisy=True)` finds it.
    cell_weights : array, shape (n_1 - 1, ..., n_d - 1), or None
        Weight of the energy in every cell, above zero.
    border_degree : int
        Continue the samples by polynomials of this degree, 1 to 5, a little beyond the border of
        the grid, from the nearest samples of each line.  0 leaves the energy free there, which is
        best for rough and for noisy samples.  4 is for smooth ones, whose error is else by far the
        largest at the border, with `thin_plate_weight` 1 and `smoothness` 0.015.
    limit : bool
        Remove overshoot: every cell stays between the smallest and the largest of its own
        samples.  Samples and C1 are kept, fairness is not.
    converge : float or None
        Renew the normals until no value, slope or mixed derivative per cell changes by more than
        this, in units of the samples' spread, at most `iterations` times; give it some 50 then.
        The limit is differentiated by the implicit function theorem, with memory that does not
        depend on the iterations.  Derivatives are as accurate as `tolerance`, which is to be well
        below `converge`.  None renews them `iterations` times, and derivatives are those of the
        last iterate.
    coarse_grids : bool or None
        Precondition with coarse grids, which wide holes need and which take longer to compile.
        None decides by the samples; inside `jax.jit` and `jax.vmap`, where they are unknown, it
        means False.
    tolerance : float
        Residual of each linear solve, relative to its right-hand side.
    max_steps : int
        Limit on the steps of each linear solve.  A solve that needs more sets
        `field.report.converged` to false and, outside `jax.jit` and `jax.vmap`, warns.

    Raises
    ------
    ValueError
        For a setting outside its limits, and, outside `jax.jit`, if every sample is missing.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> import contourfair_jax as cf
    >>> x = jnp.linspace(-1.0, 1.0, 10)
    >>> ridge = jnp.exp(-((4.5 * (x[:, None] - 0.8 * x[None, :])) ** 2))
    >>> field = cf.fair_field(ridge, method=cf.GlobalFairing(thin_plate_weight=0.01, sharpness=2))
    >>> bool(field.report.converged)
    True
    """

    thin_plate_weight: float | Float[Array | np.ndarray, ""] = 0.05
    iterations: int = eqx.field(static=True, default=3)
    coherence: float | Float[Array | np.ndarray, ""] = 1.2
    sharpness: int = eqx.field(static=True, default=1)
    tension: float | Float[Array | np.ndarray, ""] = 0.0
    hessian_weight: float | Float[Array | np.ndarray, ""] = 0.0
    smoothness: float | Float[Array | np.ndarray, ""] = 0.0
    norm: float | Float[Array | np.ndarray, ""] | None = 2.0
    sigma: float | Float[Array | np.ndarray, "*shape"] | None = None
    cell_weights: Float[Array | np.ndarray, "*cells"] | None = None
    border_degree: int = eqx.field(static=True, default=0)
    limit: bool = eqx.field(static=True, default=False)
    converge: float | None = eqx.field(static=True, default=None)
    coarse_grids: bool | None = eqx.field(static=True, default=None)
    tolerance: float = eqx.field(static=True, default=1e-4)
    max_steps: int = eqx.field(static=True, default=1000)

    def __check_init__(self):
        checks.check_real(self.thin_plate_weight, "thin_plate_weight", most=1.0, open_below=True)
        checks.check_count(self.iterations, 0, "iterations")
        if self.converge is not None:
            checks.check_real(self.converge, "converge", open_below=True)
            checks.check_count(self.iterations, 1, "iterations")
        checks.check_real(self.coherence, "coherence", most=LARGEST_COHERENCE)
        checks.check_count(self.sharpness, 1, "sharpness")
        checks.check_count(self.border_degree, 0, "border_degree", most=LARGEST_DEGREE)
        checks.check_real(self.hessian_weight, "hessian_weight")
        checks.check_real(self.tension, "tension")
        checks.check_real(self.smoothness, "smoothness")
        if self.norm is not None:
            checks.check_real(self.norm, "norm", least=1.0, most=2.0)
        checks.check_choice(self.limit, (False, True), "limit")
        checks.check_choice(self.coarse_grids, (None, False, True), "coarse_grids")
        checks.check_positive(self.sigma, "sigma")
        checks.check_positive(self.cell_weights, "cell_weights")
        checks.check_real(self.tolerance, "tolerance", open_below=True)
        checks.check_count(self.max_steps, 1, "max_steps")

    def fit(self, values, spacing):
        if self.border_degree == 0:
            return self._fit(values, spacing)
        sigma = jnp.asarray(0 if self.sigma is None else self.sigma, values.dtype)
        wide = continue_samples(values, jnp.broadcast_to(sigma, values.shape), self.border_degree)
        weights = self.cell_weights
        method = dataclasses.replace(
            self,
            border_degree=0,
            sigma=None if self.sigma is None else wide.sigma,
            cell_weights=None if weights is None else jnp.pad(weights, LAYERS, mode="edge"),
        )
        net, report = method._fit(wide.values, spacing, LAYERS)
        inside = (slice(3 * LAYERS, -3 * LAYERS),) * values.ndim
        return net[inside], dataclasses.replace(report, filled=jnp.isnan(values))

    def _fit(self, values: Array, spacing: Array, layers: int = 0) -> tuple[Array, FitReport]:
        """`fit` with the energy free at the border; some layers of samples are continued ones."""
        if self.sigma is not None and self.iterations == 0:
            plate = {"thin_plate_weight": 1.0, "norm": None, "iterations": SPRING_ITERATIONS}
            return dataclasses.replace(self, **plate)._fit(values, spacing, layers)
        shape, ndim = values.shape, values.ndim
        spacing = spacing / jnp.min(spacing)
        missing = jnp.isnan(values)
        scaled, centre, spread = _normalise(values, missing)
        start = jnp.zeros((2**ndim, values.size), values.dtype).at[0].set(scaled.ravel())
        exact = ~missing if self.sigma is None else jnp.zeros_like(missing)
        free = jnp.ones(start.shape, dtype=bool).at[0].set(missing.ravel())
        energy = energy_form(spacing, shape, self.tension, self.smoothness)
        structure = structure_form(spacing, shape, self.hessian_weight)
        unpinned = jnp.zeros(missing.size, values.dtype)
        noise, springs = None, None
        if self.sigma is not None:
            noise = noise_of(self.sigma, missing, spread, layers)
            springs = first_springs(values.dtype)

        @partial(jax.checkpoint, prevent_cse=False, policy=save_solutions)
        def renewal(state: State, powers: Powers) -> tuple[State, Info]:
            weights = self._weights(structure, energy, state.dofs, powers)
            system = LinearSystem(energy, weights, start, free, unpinned)
            given = state.dofs, state.size, self._precision()
            if state.springs is None or noise is None:
                solution, springs = solve(system, *given), None
            else:
                solution, springs = solve_within_noise(system, state.springs, noise, *given)
            update = jnp.max(jnp.abs(solution.value - state.dofs))
            info = Info(update, solution.steps, solution.residual)
            return State(solution.value, springs, solution.size), info

        powers = Powers(
            jnp.asarray(self.thin_plate_weight, values.dtype),
            jnp.asarray(2 if self.norm is None else self.norm, values.dtype),
        )
        state = State(start, springs, jnp.zeros((), values.dtype))
        if self.converge is None:
            dofs, info = renew(renewal, state, powers, self.iterations)
        else:
            change, tolerance = self.converge, self.tolerance
            dofs, info = converge(renewal, state, powers, self.iterations, change, tolerance)
        if self.limit:
            dofs = limit_slopes(dofs, shape)
        net = to_net(dofs, shape) * spread + centre
        fitted = net[(slice(None, None, 3),) * ndim]
        net = set_samples(net, jnp.where(exact, values, fitted))
        converged = jnp.all(info.residual <= self.tolerance)
        if self.converge is not None:
            converged = converged & (info.update[-1] <= self.converge)  # 0 where it was not needed
        return net, FitReport(converged, info.update, info.steps, info.residual, missing)

    def _precision(self) -> Precision:
        return Precision(self.tolerance, self.max_steps, bool(self.coarse_grids))

    def _weights(
        self, structure: CellForm, energy: CellForm, dofs: Array, powers: Powers
    ) -> Float[Array, "groups v"]:
        """Weights of the energy: M_ab = delta_ab - (1 - w) N_ab, times e^(p/2 - 1), per cell."""
        plain = powers.thin_plate_weight
        weights = normal_weights(structure, dofs, plain, self.coherence, self.sharpness)
        if weighs_cells(self.norm):
            weights = weights * power_weights(energy, weights, dofs, powers.norm)
        if self.cell_weights is None:
            return weights
        return weights * cells_to_rows(jnp.asarray(self.cell_weights, dofs.dtype)[None])

    def prepare(self, values):
        checks.check_shape(self.sigma, values.shape, "sigma", scalar=True)
        cells = tuple(n - 1 for n in values.shape)
        checks.check_shape(self.cell_weights, cells, "cell_weights")
        # Differentiated samples are known as well, or the derivative were of another problem.
        values = jax.lax.stop_gradient(values)
        # A power that is known to be 2 costs nothing, a traced one an energy in every iteration.
        method = self if weighs_cells(self.norm) else dataclasses.replace(self, norm=None)
        if is_traced(values):
            return method
        missing = np.isnan(np.asarray(values))
        if missing.all():
            raise ValueError(
                "values must hold at least one sample, got only NaN; there is nothing to fill from"
            )
        if self.coarse_grids is not None:
            return method
        return dataclasses.replace(method, coarse_grids=has_wide_holes(missing))

    def warn(self, report):
        if bool(report.converged):  # pyright: ignore
            return
        residual = float(report.residuals.max())  # pyright: ignore
        if residual <= self.tolerance:
            message = (
                f"global fairing still changed by {float(report.updates[-1]):.1e} of the spread "  # pyright: ignore
                f"after {self.iterations} iterations, instead of {self.converge:.1e}; raise "
                "iterations, or allow a larger converge"
            )
        else:
            message = (
                f"global fairing stopped at a residual of {residual:.1e} "
                f"instead of {self.tolerance:.1e} after {int(report.steps.max())} steps; raise "  # pyright: ignore
                "max_steps or thin_plate_weight, or allow a larger tolerance"
            )
        warnings.warn(message, UserWarning, stacklevel=3)


def _normalise(values: Array, missing: Array) -> tuple[Array, Array, Array]:
    """Samples scaled to spread 1 about 0, missing ones as 0; the centre and the spread."""
    known = jax.lax.stop_gradient(values)
    low = jnp.min(jnp.where(missing, jnp.inf, known))
    high = jnp.max(jnp.where(missing, -jnp.inf, known))
    centre = low / 2 + high / 2
    spread = jnp.where(high == low, 1, high - low)
    return jnp.where(missing, 0, (values - centre) / spread), centre, spread
