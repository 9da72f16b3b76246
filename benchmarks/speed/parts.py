"""Where the time of fairing goes: every stage by itself on the sizes that the engine works on.

What the stages do not add up to is what lies between them: gathering and merging, the updates of
conjugate gradients, copies.  Within the whole a stage finds its input in the cache, and may take
less time than by itself.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import contourfair_jax as cf
from benchmarks.common import clock, report
from benchmarks.common.inside import (
    LinearSystem,
    LocalEnergy,
    Powers,
    apart,
    batched,
    contour_tensors,
    division,
    eliminate,
    energy_form,
    structure_form,
    substitute,
)
from benchmarks.common.report import Result, Track
from benchmarks.speed.cost import waves

LOCAL = ((512, 512), (24, 24, 24))
GLOBAL = ((1024, 1024), (64, 64, 64))
REPEATS = 10

Parts = dict[str, float]


def run(track: Track = report.silent) -> Result:
    """Microseconds per sample of every stage and of the whole."""
    tasks = [("local", shape) for shape in LOCAL] + [("global", shape) for shape in GLOBAL]
    stages = {"local": _local_parts, "global": _global_parts}
    rows = []
    for kind, shape in track(tasks, "parts"):
        seconds = stages[kind](shape)
        micro = {name: 1e6 * part / np.prod(shape) for name, part in seconds.items()}
        rows.append({"method": kind, "samples": list(shape), "us_per_sample": micro})
    return {"rows": rows}


def tables(result: Result) -> dict[str, str]:
    """Markdown of the whole and of the stages."""
    body = []
    for row in result["rows"]:
        whole, *stages = row["us_per_sample"].items()
        listed = ", ".join(f"{name} {micro:.3g}" for name, micro in stages)
        name = f"{row['method']} {report.size(row['samples'])}"
        body.append([name, f"{whole[1]:.3g}", listed])
    header = ["method, samples", "whole, µs per sample", "stages by themselves"]
    return {"parts": report.table(header, body)}


def _each(function: Callable[..., Any], first: Array, *others: Any) -> float:
    """Seconds of one call, many in one program, each waiting for the one before."""
    both = [_loop(unit, first, others) for unit in (function, lambda first, *_: first.ravel()[:1])]
    return (both[0] - both[1]) / REPEATS


def _loop(function: Callable[..., Any], first: Array, others: tuple) -> float:
    unit = apart(function)  # or XLA would leave out what is not used, and repeat nothing

    def repeat(first: Array, others: tuple) -> Array:
        def call(_: Array, first: Array) -> Array:
            leaves = jax.tree.leaves(unit(first, *others))
            ends = jnp.stack([leaf.ravel()[0] for leaf in leaves if leaf.size])
            return first + 1e-12 * jnp.sum(ends)

        return jax.lax.fori_loop(0, REPEATS, call, first)

    return clock.median(partial(jax.jit(repeat), first, others), 3)


def _whole(shape: tuple[int, ...], method: Any) -> tuple[float, cf.BezierField]:
    values = waves(shape)
    fit = jax.jit(lambda values: cf.fair_field(values, method=method))
    return clock.median(partial(fit, values), 2), fit(values)


def _local_parts(shape: tuple[int, ...]) -> Parts:
    """Stages of local fairing, on a batch for each core, for all vertices and all iterations."""
    method, ndim = cf.LocalFairing(), len(shape)
    energy = LocalEnergy(jnp.ones(ndim, jnp.float32), method.quadrature_order)
    cores, batch = division(energy, jnp.dtype(jnp.float32))
    given, fairing = energy.sample_hessians[0, 0].shape[1], energy.fairing_hessians[0, 0].shape[1]
    every = jax.tree.map(lambda table: jnp.stack([table] * cores), energy)
    random = np.random.default_rng(0)
    coefficients = jnp.asarray(random.normal(size=(cores, given + fairing, batch)), jnp.float32)

    def gradients(x: Array, energy: LocalEnergy) -> list[Array]:
        return batched(energy.gradients)(x)

    def normals(first: Array, others: list[Array], energy: LocalEnergy) -> dict:
        return contour_tensors(energy, [first, *others], method.thin_plate_weight)

    def assembly(first: Array, others: dict, energy: LocalEnergy) -> Array:
        return energy.matrix({(0, 0): first} | others)

    def right_side(samples: Array, tensor: dict, energy: LocalEnergy) -> Array:
        return batched(energy.right_side)(tensor, samples)

    def substitution(right: Array, panels: list) -> Array:
        return substitute(panels, right)

    first, *others = jax.vmap(gradients)(coefficients, every)
    tensor = jax.vmap(normals)(first, others, every)
    rest = {axes: part for axes, part in tensor.items() if axes != (0, 0)}
    matrices = jax.vmap(assembly)(tensor[0, 0], rest, every)
    panels = jax.vmap(eliminate)(matrices)
    calls = np.prod([n - 2 for n in shape]) / (cores * batch) * method.iterations
    seconds = {
        "gradients": _each(jax.vmap(gradients), coefficients, every),
        "normals": _each(jax.vmap(normals), first, others, every),
        "assembly": _each(jax.vmap(assembly), tensor[0, 0], rest, every),
        "right side": _each(jax.vmap(right_side), coefficients[:, :given], tensor, every),
        "elimination": _each(jax.vmap(eliminate), matrices),
        "substitution": _each(jax.vmap(substitution), coefficients[:, given:], panels),
    }
    scaled = {name: one * calls for name, one in seconds.items()}
    return {"whole": _whole(shape, method)[0], **scaled}


def _global_parts(shape: tuple[int, ...]) -> Parts:
    """Stages of global fairing, each as often as the fit takes it."""
    method = cf.GlobalFairing(tolerance=1e-3)
    seconds, field = _whole(shape, method)
    assert field.report is not None
    steps = int(np.sum(field.report.steps))
    fits = method.iterations + 1
    spacing = jnp.ones(len(shape), jnp.float32)
    energy, structure = energy_form(spacing, shape), structure_form(spacing, shape)
    dofs = jnp.zeros((2 ** len(shape), int(np.prod(shape))), jnp.float32)
    dofs = dofs.at[0].set(jnp.asarray(waves(shape)).ravel())
    free = jnp.ones(dofs.shape, bool).at[0].set(False)
    powers = Powers(jnp.float32(method.thin_plate_weight), jnp.float32(method.norm))
    weights = method._weights(structure, energy, dofs, powers)
    system = LinearSystem(energy, weights, dofs, free, jnp.zeros(dofs.shape[1], jnp.float32))
    inverse = energy.inverse_blocks(weights, system.pins, free)
    # A residual is renewed once before the first step.
    return {
        "whole": seconds,
        "products with the matrix": (steps + fits)
        * _each(lambda x, s: s.apply_in_place(x), dofs, system),
        "preconditioner": (steps + 2 * fits)
        * _each(lambda x, inverse: jnp.sum(inverse * x[None], axis=1), dofs, inverse),
        "its inverse blocks": fits
        * _each(lambda w, s: energy.inverse_blocks(w, s.pins, s.free), weights, system),
        "normals": fits * _each(lambda x: method._weights(structure, energy, x, powers), dofs),
    }
