"""Local fairing, the paper's method: every inner vertex fairs its own 3^d neighbourhood.

For one vertex: gather the samples -> thin plate -> sample the normals -> assemble the contour
energy -> solve -> repeat with the new normals -> Bezier points.  Then the patches merge.
"""

import math
from collections.abc import Callable
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._bezier.nets import net_shape, set_samples
from ..._support import checks
from ..._support.xla import kept, materialise, matmul, save_kept, working_set
from ..method import AbstractFairing
from ..small_systems import batched, solve_small
from .energy import LocalEnergy, Tensors, contour_tensor, plain_tensor
from .solvers import AbstractSolver, Cholesky
from .splines import index_set, parity_to_bezier, samples_to_parity
from .windows import (
    cut_windows,
    neighbourhoods,
    place_window,
    scatter_patches,
    window_shape,
    window_starts,
)

# Least number of vertices that are worked on together: what is done for them is vector operations
# as long as their number, too slow when they are short.
LEAST_BATCH = 128
# Points per cell and axis, at most: more are no more accurate, and their tables grow large.
MOST_POINTS = 32
# Batches are multiples of this many vertices, so that every row begins with a line of the cache.
ALIGNED = 16


class LocalFairing(AbstractFairing):
    """The paper's local fairing: fair contours from the samples one step around each vertex.

    Minimises `integral tr(H M H)` with `M = I - (1 - w) n n^T` over the C2 splines on every 3^d
    neighbourhood, normals from the previous iterate, and blends the results (sections 3 and 4 of
    the paper).  A cell depends on the samples one step around it only, for any number of
    iterations; one missing sample (NaN) leaves NaN in at most four cells per axis.

    Parameters
    ----------
    thin_plate_weight : float
        The weight w of the thin plate energy, in (0, 1].  Our choice of 0.02 stands for the
        paper's, whose value is lost; 0.01 to 0.05 is the useful band.
    iterations : int
        How often the normals are renewed after the first, thin plate fit; 0 is thin plate alone.
    quadrature_order : int
        Gauss-Legendre points per cell and axis, 2 to 32; 3 or 4 is accurate.
    solver : AbstractSolver
        `Cholesky()`, `LU()` or `LeastSquares()`: the same minimum to rounding.

    Raises
    ------
    ValueError
        For a setting outside its limits.

    References
    ----------
    M. Bertram, "Fairing Scalar Fields by Variational Modeling of Contours", equations 11 to 19.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> import contourfair_jax as cf
    >>> x = jnp.linspace(-1.0, 1.0, 8)
    >>> field = cf.fair_field(jnp.hypot(x[:, None], x[None, :]), method=cf.LocalFairing())
    >>> field.shape
    (8, 8)
    """

    thin_plate_weight: float | Float[Array | np.ndarray, ""] = 0.02
    iterations: int = eqx.field(static=True, default=3)
    quadrature_order: int = eqx.field(static=True, default=4)
    solver: AbstractSolver = eqx.field(default_factory=Cholesky)

    def __check_init__(self):
        checks.check_real(self.thin_plate_weight, "thin_plate_weight", most=1.0, open_below=True)
        checks.check_count(self.iterations, 0, "iterations")
        checks.check_count(self.quadrature_order, 2, "quadrature_order", most=MOST_POINTS)
        if not isinstance(self.solver, AbstractSolver):
            raise ValueError(
                f"solver must be a solver object such as Cholesky() or LU(), got {self.solver!r}"
            )

    def fit(self, values, spacing):
        shape = values.shape
        energy = LocalEnergy(spacing / jnp.min(spacing), self.quadrature_order)
        thin_plate = _thin_plate_operator(energy)
        window = window_shape(shape, working_set().window_vertices)

        def fair(samples: Float[Array, "*window_2"]) -> Float[Array, "*window_net"]:
            patches = self._patches(energy, thin_plate, neighbourhoods(samples))
            return scatter_patches(patches, samples.shape)

        def place(net: Array, item: tuple[Array, Array]) -> tuple[Array, None]:
            start, samples = item
            return place_window(net, fair(samples), start, shape), None

        starts = jnp.asarray(window_starts(shape, window))
        net = jnp.zeros(net_shape(shape), values.dtype)
        net, _ = jax.lax.scan(place, net, (starts, cut_windows(values, window)))
        return set_samples(net, values), None

    def _patches(
        self,
        energy: LocalEnergy,
        thin_plate: Float[Array, "fairing samples"],
        samples: Float[Array, "samples vertices"],
    ) -> Float[Array, "points vertices"]:
        """Bezier points of the patches around every vertex, a batch for each core at a time."""
        count = samples.shape[1]
        cores, most = division(energy, samples.dtype)
        rounds = -(-count // (cores * most))
        batches = rounds * cores
        size = -(-count // (batches * ALIGNED)) * ALIGNED
        padded = jnp.pad(samples, ((0, 0), (0, batches * size - count)), mode="edge")
        split = jnp.moveaxis(padded.reshape(-1, rounds, cores, size), 0, 2)
        fair = self._round(energy, thin_plate, cores)
        points = jax.lax.map(jax.checkpoint(fair, prevent_cse=False), split)
        return jnp.moveaxis(points, 2, 0).reshape(-1, batches * size)[:, :count]

    def _round(
        self, energy: LocalEnergy, thin_plate: Float[Array, "fairing samples"], cores: int
    ) -> Callable[[Float[Array, "cores samples batch"]], Float[Array, "cores points batch"]]:
        """`_batch` for as many batches as there are cores.

        XLA gives every core an equal share of the first axis.  Where that counts batches, all that
        is done to one is done where it lies in the cache.
        """
        if cores == 1:
            return lambda batches: self._batch(energy, thin_plate, batches[0])[None]
        # Tables for each batch: in products with common ones that axis would not stay the first.
        energies, operators = materialise(
            jax.tree.map(lambda t: jnp.broadcast_to(t, (cores, *t.shape)), (energy, thin_plate))
        )
        each = jax.vmap(self._batch)
        return lambda batches: each(energies, operators, batches)

    def _batch(
        self,
        energy: LocalEnergy,
        thin_plate: Float[Array, "fairing samples"],
        samples: Float[Array, "samples batch"],
    ) -> Float[Array, "points batch"]:
        """Fair a batch of neighbourhoods, scaled to spread 1 about their centre."""
        ndim = energy.ndim
        # A NaN in the systems would spoil derivatives of results that do not depend on it.
        missing = jnp.any(jnp.isnan(samples), axis=0, keepdims=True)
        samples = jnp.where(missing, 0, samples)
        centre = jax.lax.stop_gradient(samples[samples.shape[0] // 2])
        spread = jax.lax.stop_gradient(jnp.max(samples, axis=0) - jnp.min(samples, axis=0))
        spread = jnp.where(spread == 0, 1, spread)
        scaled = (samples - centre[None]) / spread[None]
        given = matmul(jnp.asarray(samples_to_parity(ndim), samples.dtype), scaled)

        def improve(fairing: Array, _: None) -> tuple[Array, None]:
            coefficients = jnp.concatenate([given, fairing])
            gradients = batched(energy.gradients)(coefficients)
            tensor = contour_tensors(energy, gradients, self.thin_plate_weight)
            return kept(self.solver(energy, tensor, given)), None

        # In reverse mode: to compute the rest again takes less time than to write and read it.
        improve = jax.checkpoint(improve, prevent_cse=False, policy=save_kept)
        fairing, _ = jax.lax.scan(improve, matmul(thin_plate, given), length=self.iterations)
        to_bezier = jnp.asarray(parity_to_bezier(ndim), samples.dtype)
        points = matmul(to_bezier, jnp.concatenate([given, fairing]))
        return jnp.where(missing, jnp.nan, points * spread[None] + centre[None])


def contour_tensors(
    energy: LocalEnergy,
    gradients: list[Float[Array, "points batch"]],
    thin_plate_weight: float | Float[Array | np.ndarray, ""],
) -> Tensors:
    """`contour_tensor` of many vertices."""
    # Weights for every vertex: `vmap` would move the batch first to meet those of one.
    weights = jnp.broadcast_to(energy.weights[:, None], gradients[0].shape)
    contour = partial(contour_tensor, thin_plate_weight=thin_plate_weight)
    return batched(contour)(weights, gradients)


def _thin_plate_operator(energy: LocalEnergy) -> Float[Array, "fairing samples"]:
    """Matrix from the sample to the fairing coefficients of least thin plate energy."""
    unit = jnp.eye(len(index_set(energy.ndim, "samples")), dtype=energy.weights.dtype)
    tensor = plain_tensor(energy)
    matrix = energy.matrix({axes: values[:, None] for axes, values in tensor.items()})
    rhs = batched(partial(energy.right_side, tensor))(unit)
    return solve_small(matrix[:, :, 0], rhs)


def division(energy: LocalEnergy, dtype: jnp.dtype) -> tuple[int, int]:
    """How many batches are worked on at once, and the most vertices in each.

    One for every core where what a core needs stays in its cache, or else a large one for all.
    """
    entries = sum(math.prod(table.shape[:-1]) for table in energy.matrix_tables)
    points = 2**energy.ndim * energy.matrix_tables[0].shape[1]
    each, limits = (2 * entries + 3 * points) * dtype.itemsize, working_set()
    if LEAST_BATCH * each <= limits.core_bytes:
        return limits.cores, limits.core_bytes // (each * ALIGNED) * ALIGNED
    return 1, max(LEAST_BATCH, limits.batch_bytes // (each * ALIGNED) * ALIGNED)
