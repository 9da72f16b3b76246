"""Local fairing as one would write it down: every vertex by itself under `vmap`, no tricks.

Dense tables of the functions at the quadrature points, the energy's matrix from einsum, batched
`jax.numpy.linalg.solve`.  It is what the engine is measured against.
"""

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from benchmarks.common.inside import (
    TO_BEZIER,
    bernstein_derivative,
    kronecker,
    neighbourhoods,
    quadrature,
    scatter_patches,
    set_samples,
)

BATCH = {2: 256, 3: 8}


@cache
def _tables(ndim: int, order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """First and second derivatives of all functions at all points, weights, Bezier points."""
    points, weights = quadrature(order)
    axis = [
        np.concatenate(
            [
                bernstein_derivative(k, points) @ TO_BEZIER[:4],
                bernstein_derivative(k, points) @ TO_BEZIER[3:],
            ]
        )
        for k in range(3)
    ]

    def product(orders: tuple[int, ...]) -> np.ndarray:
        table = np.ones((1, 1))
        for k in orders:
            table = np.kron(table, axis[k])
        return table

    unit = np.eye(ndim, dtype=int)
    first = np.stack([product(tuple(unit[a])) for a in range(ndim)])
    second = np.stack(
        [[product(tuple(unit[a] + unit[b])) for b in range(ndim)] for a in range(ndim)]
    )
    all_weights = np.ones(1)
    for _ in range(ndim):
        all_weights = np.kron(all_weights, np.tile(weights, 2))
    return first, second, all_weights, kronecker(TO_BEZIER, ndim)


def _split(ndim: int) -> tuple[np.ndarray, np.ndarray]:
    """Which of the 5^d functions carry samples and which are free."""
    digits = np.stack(np.meshgrid(*[np.arange(5)] * ndim, indexing="ij"), -1).reshape(-1, ndim)
    carries = (digits % 2 == 0).all(axis=1)
    return np.flatnonzero(carries), np.flatnonzero(~carries)


@partial(jax.jit, static_argnames=("iterations", "order"))
def fair_naively(
    values: Float[Array, "*shape"], weight: float = 0.02, iterations: int = 3, order: int = 4
) -> Float[Array, "*net"]:
    """Control net of local fairing with unit spacing."""
    ndim, dtype = values.ndim, values.dtype
    given, free = _split(ndim)
    first, second, weights, to_bezier = (jnp.asarray(t, dtype) for t in _tables(ndim, order))
    unit, flat = jnp.eye(ndim, dtype=dtype), 1e-6

    def one(samples: Array) -> Array:
        coefficients = jnp.zeros(5**ndim, dtype).at[given].set(samples)
        spread = jnp.max(samples) - jnp.min(samples)

        def improve(coefficients: Array, share: Array) -> tuple[Array, None]:
            gradient = jnp.einsum("apn,n->pa", first, coefficients)
            squared = jnp.sum(gradient**2, axis=1) + (flat * spread) ** 2 + 1e-30
            normal = gradient[:, :, None] * gradient[:, None] / squared[:, None, None]
            tensor = weights[:, None, None] * (unit[None] - share * normal)
            stress = jnp.einsum("pab,bcpn->acpn", tensor, second)
            matrix = jnp.einsum("acpn,acpm->nm", second[..., free], stress)
            rhs = -matrix[:, given] @ samples
            solution = jnp.linalg.solve(matrix[:, free], rhs)
            return coefficients.at[free].set(solution), None

        shares = jnp.full(iterations + 1, 1 - weight, dtype).at[0].set(0)
        coefficients, _ = jax.lax.scan(improve, coefficients, shares)
        return to_bezier @ coefficients

    samples = neighbourhoods(values)
    patches = jax.lax.map(one, samples.T, batch_size=BATCH[ndim]).T
    return set_samples(scatter_patches(patches, values.shape), values)
