"""C1 fields without fairing, which compile at once or not at all, for tests of what uses fields."""

import jax.numpy as jnp
import numpy as np

from contourfair_jax import AbstractFairing
from contourfair_jax._field import BezierField


def catmull_rom(samples, spacing=1.0, origin=0.0):
    """The C1 cubic field whose derivatives at samples are central differences, any dimension."""
    net = np.asarray(samples, float)
    for axis in range(net.ndim):
        values = np.moveaxis(net, axis, 0)
        slopes = np.gradient(values, axis=0) / 3
        spread = np.stack([values - slopes, values, values + slopes], axis=1)
        spread = spread.reshape(-1, *values.shape[1:])[1:-1]
        net = np.moveaxis(spread, 0, axis)
    ones = np.ones(net.ndim)
    return BezierField(jnp.asarray(net), jnp.asarray(spacing * ones), jnp.asarray(origin * ones))


class CatmullRom(AbstractFairing):
    """The same in place of fairing, traced: a linear method."""

    def fit(self, values, spacing):
        net = values
        for axis in range(net.ndim):
            along = jnp.moveaxis(net, axis, 0)
            slopes = jnp.gradient(along, axis=0) / 3
            spread = jnp.stack([along - slopes, along, along + slopes], axis=1)
            net = jnp.moveaxis(spread.reshape(-1, *along.shape[1:])[1:-1], 0, axis)
        return net, None
