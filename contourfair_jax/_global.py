r"""Global fairing: the contour energy over the whole C1 space, with coherent normals.

The energy of `_energy` over all cells at once, with a tensor M that is constant in every cell, so
that the integrals are exact::

    E(u) = 1/2 sum_cells ( sum_abc M_ab <f_ac, f_bc> + tension sum_a <f_a, f_a> / h^2 ).

Samples fix the values at the vertices; slopes are free.  Each iteration renews M from the field and
solves for the slopes by conjugate gradients.  Every sample pins its vertex, so the number of steps
does not grow with the grid.  A missing sample only frees its value.
"""

import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from . import _check
from ._cg import Solution, conjugate_gradients
from ._form import CellForm, energy_form, structure_form
from ._hermite import cell_mask, cells_to_row, row_to_cells, to_net
from ._merge import set_samples
from ._method import AbstractFairing, FitReport
from ._normals import LARGEST_COHERENCE, coherent_normals


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
        How often the normals are renewed after the first, thin plate fit; 0 is thin plate alone.
    coherence : float
        Width of the Gaussian that averages the normal tensors, in cells, 0 to 2.5.
    sharpness : int
        Power p of the normal tensor, `N = J^p / tr(J^p)`: larger trusts the main direction more.
    tension : float
        Weight of `|g|^2 / h^2` in the energy, with h the smallest spacing.
    tolerance : float
        Residual of each linear solve, relative to its right-hand side.
    max_steps : int
        Limit on the steps of each linear solve.  A solve that needs more sets
        `field.report.converged` to false and, outside `jax.jit`, warns.

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

    thin_plate_weight: float | Float[Array, ""] = 0.05
    iterations: int = eqx.field(static=True, default=3)
    coherence: float | Float[Array, ""] = 1.2
    sharpness: int = eqx.field(static=True, default=1)
    tension: float | Float[Array, ""] = 0.0
    tolerance: float = eqx.field(static=True, default=1e-4)
    max_steps: int = eqx.field(static=True, default=1000)

    def __check_init__(self):
        _check.check_real(self.thin_plate_weight, "thin_plate_weight", most=1.0, open_below=True)
        _check.check_count(self.iterations, 0, "iterations")
        _check.check_real(self.coherence, "coherence", most=LARGEST_COHERENCE)
        _check.check_count(self.sharpness, 1, "sharpness")
        _check.check_real(self.tension, "tension")
        _check.check_real(self.tolerance, "tolerance", open_below=True)
        _check.check_count(self.max_steps, 1, "max_steps")

    def fit(self, values, spacing):
        shape, ndim = values.shape, values.ndim
        spacing = spacing / jnp.min(spacing)
        missing = jnp.isnan(values)
        scaled, centre, spread = _normalise(values, missing)
        start = jnp.zeros((2**ndim, values.size), values.dtype).at[0].set(scaled.ravel())
        free = jnp.ones(start.shape, dtype=bool).at[0].set(missing.ravel())
        forms = energy_form(spacing, shape), structure_form(spacing, shape)

        def improve(dofs: Array, weight: Array) -> tuple[Array, tuple]:
            weights = self._weights(forms[1], dofs, weight)
            solution = self._solve(forms[0], weights, start, free, dofs)
            update = jnp.max(jnp.abs(solution.value - dofs))
            return solution.value, (update, solution.steps, solution.residual)

        weights = jnp.asarray(self.thin_plate_weight, values.dtype)
        weights = jnp.where(jnp.arange(self.iterations + 1) == 0, 1, weights)
        dofs, (updates, steps, residuals) = jax.lax.scan(improve, start, weights)
        net = to_net(dofs, shape) * spread + centre
        fitted = net[(slice(None, None, 3),) * ndim]
        net = set_samples(net, jnp.where(missing, fitted, values))
        converged = jnp.all(residuals <= self.tolerance)
        return net, FitReport(converged, updates, steps, residuals, missing)

    def _weights(self, form: CellForm, dofs: Array, weight: Array) -> Float[Array, "groups v"]:
        """Weights of the energy: M_ab = delta_ab - (1 - w) N_ab of every cell, and tension."""
        densities = form.densities(dofs)
        axes = [(a, b) for a in range(len(form.shape)) for b in range(a, len(form.shape))]
        structure = {
            pair: row_to_cells(row, form.shape) for pair, row in zip(axes, densities, strict=True)
        }
        normals = coherent_normals(structure, self.coherence, self.sharpness)
        tensor = [(1.0 if a == b else 0.0) - (1 - weight) * normals[a, b] for a, b in axes]
        mask = jnp.asarray(cell_mask(form.shape), dofs.dtype)
        return jnp.stack([*map(cells_to_row, tensor), self.tension * mask])

    def _solve(
        self, form: CellForm, weights: Array, start: Array, free: Bool[Array, "..."], guess: Array
    ) -> Solution:
        """Least energy over what is free, the rest as in `start`.

        Differentiated as a linear solve: its derivatives are solves with the same matrix, whatever
        the number of steps.
        """
        frozen, near = jax.lax.stop_gradient((weights, jnp.where(free, guess - start, 0)))
        inverse = jax.lax.stop_gradient(form).inverse_blocks(frozen, free)

        def apply(x: Array) -> Array:
            return jnp.where(free, form.apply(weights, x), 0)

        def solve(_, rhs: Array) -> tuple[Array, tuple[Array, Array]]:
            solution = conjugate_gradients(
                lambda x: jnp.where(free, jax.lax.stop_gradient(form).apply_in_place(frozen, x), 0),
                rhs,
                near,
                lambda x: jnp.sum(inverse * x[None], axis=1),
                self.tolerance,
                self.max_steps,
            )
            return solution.value, (solution.steps, solution.residual)

        value, info = jax.lax.custom_linear_solve(
            apply, -apply(start), solve, symmetric=True, has_aux=True
        )
        return Solution(start + value, *info)

    def check_values(self, values):
        if np.isnan(np.asarray(values)).all():
            raise ValueError(
                "values must hold at least one sample, got only NaN; there is nothing to fill from"
            )

    def warn(self, report):
        if not bool(report.converged):
            warnings.warn(
                f"global fairing stopped at a residual of {float(report.residuals.max()):.1e} "
                f"instead of {self.tolerance:.1e} after {int(report.steps.max())} steps; raise "
                "max_steps or thin_plate_weight, or allow a larger tolerance",
                UserWarning,
                stacklevel=3,
            )


def _normalise(values: Array, missing: Array) -> tuple[Array, Array, Array]:
    """Samples scaled to spread 1 about 0, missing ones as 0; the centre and the spread."""
    known = jax.lax.stop_gradient(values)
    low = jnp.min(jnp.where(missing, jnp.inf, known))
    high = jnp.max(jnp.where(missing, -jnp.inf, known))
    centre = low / 2 + high / 2
    spread = jnp.where(high == low, 1, high - low)
    return jnp.where(missing, 0, (values - centre) / spread), centre, spread
