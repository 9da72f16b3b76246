"""The engine behind the signature of `benchmarks.common.peers`.

``METHODS`` maps what tables call a method to ``callable(values, spacing, factor) -> refined``;
``OBJECTS`` maps the same names to the settings objects, for benchmarks that need the field.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

import contourfair_jax as cf
from benchmarks.common.peers import Array, Method, Spacing

LOCAL, GLOBAL, TUNED = "local", "global", "tuned"
NOISY = "tuned, noisy"
DEFAULT = "global, defaults"
SMALL_WEIGHT, CLEAN = "global w .003", "global w .001 c 1.5"
WAVES = "global w .001 c 1.5 s .1"
ROBUST = "global, norm 1"
SMOOTH = "global, smooth"


def use_x64(enabled: bool) -> None:
    """Choose the precision of this process, before the first computation."""
    jax.config.update("jax_enable_x64", enabled)


def field(values: Array, spacing: Spacing, name: str) -> "cf.BezierField":
    """Fair ``values`` with the settings that tables call ``name``."""
    samples = jnp.asarray(values)
    if name in (TUNED, NOISY):
        method = cf.tune(samples, spacing=spacing, noisy=name == NOISY)
    else:
        method = OBJECTS[name]()
    return cf.fair_field(samples, spacing=spacing, method=method)


def _method(name: str) -> Method:
    def run(values: Array, spacing: Spacing, factor: int) -> Array:
        return np.asarray(field(values, spacing, name).refine(factor))

    run.__name__ = name
    return run


def _local() -> "cf.LocalFairing":
    return cf.LocalFairing(thin_plate_weight=0.01, iterations=3)


def _global(
    weight: float = 0.01, coherence: float = 1.2, norm: float = 2.0, smoothness: float = 0.0
) -> "cf.GlobalFairing":
    return cf.GlobalFairing(
        thin_plate_weight=weight,
        iterations=3,
        coherence=coherence,
        sharpness=2,
        norm=norm,
        smoothness=smoothness,
    )


OBJECTS: dict[str, Callable[[], cf.AbstractFairing]] = {
    LOCAL: _local,
    DEFAULT: cf.GlobalFairing,
    GLOBAL: _global,
    SMALL_WEIGHT: lambda: _global(0.003),
    CLEAN: lambda: _global(0.001, 1.5),
    WAVES: lambda: _global(0.001, 1.5, smoothness=0.1),
    ROBUST: lambda: _global(norm=1.0),
    SMOOTH: lambda: cf.GlobalFairing(thin_plate_weight=1.0, smoothness=0.015, border_degree=4),
}

METHODS: dict[str, Method] = {name: _method(name) for name in OBJECTS}
METHODS |= {name: _method(name) for name in (TUNED, NOISY)}

MAIN = {name: METHODS[name] for name in (LOCAL, DEFAULT, GLOBAL, ROBUST, TUNED)}
"""The engine's rows in most tables."""

RECONSTRUCT = MAIN | {NOISY: METHODS[NOISY]}
"""Also that which need not pass through the samples."""
