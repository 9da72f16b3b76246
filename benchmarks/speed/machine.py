"""What the machine can do: float32 matrix products and copies, the roofline of the other times."""

from collections.abc import Callable, Sequence
from functools import partial

import jax
import jax.numpy as jnp

from benchmarks.common import clock, report
from benchmarks.common.report import Result, Track

X64 = False
SIZES = (512, 1024, 2048)
COPY_BYTES = 512 * 2**20


def matrix_product(size: int) -> tuple[Callable[[], jax.Array], float]:
    """A square float32 product, and its floating-point operations."""
    left = jax.random.normal(jax.random.key(0), (size, size), jnp.float32)
    product = jax.jit(lambda a: jnp.dot(a, a, precision=jax.lax.Precision.HIGHEST))
    return partial(product, left), 2.0 * size**3


def rate(size: int) -> float:
    """Floating-point operations per second of a product."""
    product, operations = matrix_product(size)
    return operations / clock.median(product)


def copy_bandwidth() -> float:
    """Bytes per second, read and written, of a large float32 addition in place."""
    copy = jax.jit(lambda v: v + 1.0, donate_argnums=0)
    values = [jnp.zeros(COPY_BYTES // 4, jnp.float32)]

    def once() -> jax.Array:
        # The output takes the place of the input: no fresh pages inside the measurement.
        values[0] = copy(values[0])
        return values[0]

    return 2.0 * COPY_BYTES / clock.median(once)


def run(track: Track = report.silent, sizes: Sequence[int] = SIZES) -> Result:
    """Best matrix-product rate over sizes, and copy bandwidth."""
    rates = {str(size): rate(size) / 1e9 for size in track(sizes, "matrix products")}
    bandwidth = copy_bandwidth() / 1e9
    peak = max(rates.values())
    return {
        "gflops": rates,
        "peak_gflops": peak,
        "copy_gb_per_s": bandwidth,
        "flops_per_byte": peak / bandwidth,
        "device": jax.devices()[0].device_kind,
    }


def tables(result: Result) -> dict[str, str]:
    """One line."""
    row = [
        result["machine"]["processor"],
        result["machine"]["cores"],
        f"{result['peak_gflops']:.0f}",
        f"{result['copy_gb_per_s']:.1f}",
        f"{result['flops_per_byte']:.1f}",
    ]
    header = ["processor", "cores", "GFLOP/s, float32 product", "GB/s, copy", "FLOP per byte"]
    return {"machine": report.table(header, [row])}
