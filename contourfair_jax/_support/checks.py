"""Trace-time checks of arguments, in one message style: argument, value received, repair."""

import warnings
from collections.abc import Sequence
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int, Real

# One real number of any make.
Scalar: TypeAlias = float | np.floating | np.integer | Real[Array | np.ndarray, ""]
# Physical coordinates, also as nested lists.
Points: TypeAlias = Real[ArrayLike, "*batch ndim"] | Sequence[Any]
# How many times finer, along all axes or along each.
Factors: TypeAlias = int | Sequence[int] | Int[np.ndarray, " ndim"]
# The dimensions the method is written for.
DIMENSIONS = (2, 3)


def check_samples(values: object, name: str = "values", depth: int = 1) -> Array:
    """Turn `values` into a floating JAX array of rank 2 or 3 with at least 3 samples per axis.

    Integers and booleans become the default float, float16 and bfloat16 become float32, and a
    float64 array that JAX would narrow (x64 is off) warns.  What is masked or infinite is missing:
    NaN.

    Raises
    ------
    ValueError
        For another rank, a short axis, or a dtype that is not real.
    """
    array = values if isinstance(values, jax.Array) else unmasked(values, name)
    if jnp.issubdtype(array.dtype, jax.dtypes.extended):
        raise ValueError(f"{name} must hold real numbers, got dtype {array.dtype}, keys of JAX")
    dtype = np.dtype(array.dtype)
    if dtype.kind not in "fiub" and not jnp.issubdtype(dtype, jnp.floating):
        raise ValueError(
            f"{name} must hold real numbers, got dtype {dtype}; "
            "convert first, e.g. with values.real or values.astype(float)"
        )
    if array.ndim not in DIMENSIONS:
        raise ValueError(
            f"{name} must be a 2-D or 3-D array of samples, got shape {array.shape}; "
            "use jax.vmap for batches and index out singleton axes"
        )
    if min(array.shape) < 3:
        raise ValueError(
            f"{name} must have at least 3 samples along every axis, got shape {array.shape}; "
            "crop the field less or use a field of lower dimension"
        )
    if dtype == np.float64 and not jax.config.jax_enable_x64:  # type: ignore[attr-defined]
        warnings.warn(
            f"{name} is float64 but JAX computes in float32, so about 9 of 16 digits are lost; "
            "call jax.config.update('jax_enable_x64', True) first, or pass float32 to say so",
            UserWarning,
            stacklevel=depth + 2,
        )
    array = jnp.asarray(array, dtype=_float_dtype(dtype))
    if dtype.kind in "iub":
        return array
    return jnp.where(jnp.isinf(array), jnp.nan, array)


def unmasked(values: object, name: str = "values") -> np.ndarray:
    """A plain array with NaN in the place of masked values."""
    if not isinstance(values, np.ma.MaskedArray) or not np.ma.is_masked(values):
        return _as_numpy(values, name)
    floats = values if values.dtype.kind == "f" else values.astype(float)
    return np.ma.filled(floats, np.nan)


def _float_dtype(dtype: np.dtype) -> np.dtype:
    """The dtype to compute in: float32 and float64 are kept (float64 if x64 is on)."""
    if dtype.kind == "f" and dtype.itemsize >= 4:
        return jax.dtypes.canonicalize_dtype(np.dtype(np.float32 if dtype.itemsize == 4 else float))
    if jnp.issubdtype(dtype, jnp.floating):
        return np.dtype(np.float32)
    return jax.dtypes.canonicalize_dtype(np.dtype(float))


def check_per_axis(
    value: object, ndim: int, name: str, *, positive: bool = False
) -> Float[np.ndarray | Array, " ndim"]:
    """Broadcast a scalar or a sequence of `ndim` real numbers to an array, shape (ndim,).

    What is known becomes a NumPy array in float64, also inside `jax.jit` and where JAX computes in
    float32, in which coordinates of maps do not fit.  Of traced numbers only the count is checked.

    Raises
    ------
    ValueError
        For a wrong length, numbers that are not finite, or (`positive`) not above zero.
    """
    if isinstance(value, Sequence) and any(isinstance(item, Tracer) for item in value):
        value = jnp.stack(jnp.broadcast_arrays(*jax.tree.map(_as_float, list(value))))
    array = value if isinstance(value, jax.Array) else _as_numpy(value, name)
    if array.dtype.kind not in "fiu" or array.shape not in ((), (ndim,)):
        raise ValueError(
            f"{name} must be one real number or {ndim} of them, one per axis, got {describe(value)}"
        )
    if isinstance(array, Tracer):
        return jnp.broadcast_to(_as_float(array), (ndim,))
    known = np.broadcast_to(np.asarray(array, dtype=np.float64), (ndim,)).copy()
    with np.errstate(over="ignore", under="ignore"):
        single = known.astype(np.float32)  # as which they may be computed with
    if not np.all(np.isfinite(single)) or (positive and np.any(single <= 0)):
        rule = "finite and above zero, in float32 too," if positive else "finite, in float32 too,"
        repair = "; flip the axis instead of using a negative spacing" if positive else ""
        raise ValueError(f"{name} must be {rule} along every axis, got {describe(value)}{repair}")
    return known


def _as_numpy(value: object, name: str) -> np.ndarray:
    """Convert to an array; ValueError for lists whose rows differ in length."""
    try:
        return np.asarray(value)
    except ValueError:
        raise ValueError(
            f"{name} must be an array of numbers, got {describe(value)}; "
            "make all rows of a list equally long"
        ) from None


def _as_float(number: ArrayLike) -> Array:
    """A floating array in the precision of `number`, or the default one for an integer."""
    dtype = jnp.result_type(number)
    return jnp.asarray(number, dtype if jnp.issubdtype(dtype, jnp.floating) else float)


def check_points(points: object, ndim: int) -> Real[np.ndarray | Array, "*batch ndim"]:
    """Turn `points` into an array of shape (..., ndim), of NumPy unless they are of JAX.

    Raises
    ------
    ValueError
        For a last axis of another length or numbers that are not real.
    """
    array = points if isinstance(points, jax.Array) else _as_numpy(points, "points")
    real = array.dtype.kind in "iu" or jnp.issubdtype(array.dtype, jnp.floating)
    if not real or array.ndim == 0 or array.shape[-1] != ndim:
        raise ValueError(
            f"points must be real with shape (..., {ndim}), coordinates last, got shape "
            f"{array.shape} and dtype {array.dtype}; stack the coordinates along the last axis"
        )
    return array


def check_choice(value: object, choices: Sequence[object], name: str) -> None:
    """Raise ValueError unless `value` is one of `choices`."""
    if value not in choices:
        listed = ", ".join(repr(choice) for choice in choices)
        raise ValueError(f"{name} must be one of {listed}, got {value!r}")


def check_count(value: object, least: int, name: str, *, most: int | None = None) -> None:
    """Raise ValueError unless `value` is an integer from `least` to `most`."""
    if (
        isinstance(value, bool)
        or not isinstance(value, int | np.integer)
        or value < least
        or (most is not None and value > most)
    ):
        limits = f"at least {least}" if most is None else f"from {least} to {most}"
        raise ValueError(f"{name} must be an integer that is {limits}, got {value!r}")


def check_factors(factor: object, ndim: int) -> tuple[int, ...]:
    """The factors of all axes, from one integer for all or one for each.

    Raises
    ------
    ValueError
        For another number of them, or one that is no integer of at least 1.
    """
    factors: tuple[Any, ...] = (factor,) * ndim
    if isinstance(factor, Sequence | np.ndarray):
        factors = tuple(factor)
    if len(factors) != ndim:
        raise ValueError(f"factor must be one integer or {ndim}, one per axis, got {factor!r}")
    for number in factors:
        check_count(number, 1, "factor")
    return tuple(int(number) for number in factors)


def check_real(
    value: object,
    name: str,
    *,
    least: float = 0.0,
    most: float = np.inf,
    open_below: bool = False,
) -> None:
    """Raise ValueError unless `value` is a traced or finite real scalar within its limits."""
    if isinstance(value, Tracer):
        if value.shape != ():
            raise ValueError(f"{name} must be a scalar, got shape {value.shape}")
        return
    if _is_placeholder(value):
        return
    array = _as_numpy(value, name)
    low = "above" if open_below else "at least"
    limits = f"{low} {least:g}" + ("" if most == np.inf else f" and at most {most:g}")
    bad = array.shape != () or array.dtype.kind not in "fiu" or not np.isfinite(array)
    if bad or array < least or array > most or (open_below and array == least):
        raise ValueError(f"{name} must be a real number {limits}, got {describe(value)}")


def check_positive(value: object, name: str) -> None:
    """Raise ValueError unless `value` is None, traced, or real numbers above zero."""
    if value is None or isinstance(value, Tracer) or _is_placeholder(value):
        return
    array = _as_numpy(value, name)
    if array.dtype.kind not in "fiu" or not np.all(np.isfinite(array)) or not np.all(array > 0):
        raise ValueError(f"{name} must hold finite numbers above zero, got {describe(value)}")


def check_shape(value: object, shape: tuple, name: str, *, scalar: bool = False) -> None:
    """Raise ValueError unless `value` is None or has `shape`, or none where `scalar` is allowed."""
    if value is None:
        return
    received = np.shape(value)  # type: ignore[arg-type]
    if received != shape and not (scalar and received == ()):
        wanted = f"a scalar or of shape {shape}" if scalar else f"of shape {shape}"
        raise ValueError(f"{name} must be {wanted} for these values, got shape {received}")


def _is_placeholder(value: object) -> bool:
    """Whether `value` is what tree transformations put in the place of a leaf."""
    return type(value) is object or isinstance(value, jax.ShapeDtypeStruct)


def describe(value: object) -> str:
    """A short text of a value for messages, also of traced ones."""
    if isinstance(value, Tracer):
        return f"an array of shape {value.shape} and dtype {value.dtype}"
    text = repr(value.tolist() if isinstance(value, np.ndarray | jax.Array) else value)
    return text if len(text) <= 80 else text[:77] + "..."
