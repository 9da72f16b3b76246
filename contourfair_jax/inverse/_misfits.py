"""Differences of a field from data: observations as arrays, ready for a compiled fit."""

import abc
import dataclasses

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._field import BezierField


class AbstractMisfit(eqx.Module):
    """Data as arrays, and what a field has in their place."""

    sigma: eqx.AbstractVar[Float[Array, "..."]]

    @abc.abstractmethod
    def differences(self, field: BezierField) -> Float[Array, "..."]:
        """Field minus data, in units of the data; the first axis counts them as `sigma` does."""

    @abc.abstractmethod
    def anchors(self, spacing: Float[Array, " ndim"]) -> tuple[Array, Array]:
        """Data about the values of the field, and sigmas in units of the values.

        The scale of the problem is taken from them; data that are not values have none.
        """

    @abc.abstractmethod
    def relative(self, level: Float[Array, ""], unit: Float[Array, ""]) -> "AbstractMisfit":
        """The data of the field minus a constant, over a unit."""

    def residuals(self, field: BezierField) -> Float[Array, "..."]:
        """Differences in units of sigma; data of infinite sigma have no weight."""
        differences = self.differences(field)
        further = (1,) * (differences.ndim - self.sigma.ndim)
        return differences / self.sigma.reshape(self.sigma.shape + further)


class PointValues(AbstractMisfit):
    """Values at points."""

    points: Float[Array, "n ndim"]
    values: Float[Array, " n"]
    sigma: Float[Array, " n"]

    def differences(self, field):
        return field(self.points, outside="clamp") - self.values

    def relative(self, level, unit):
        values = (self.values - level) / unit
        return dataclasses.replace(self, values=values, sigma=self.sigma / unit)

    def anchors(self, spacing):
        return self.values, self.sigma


class PointSlopes(AbstractMisfit):
    """Gradients at points."""

    points: Float[Array, "n ndim"]
    gradients: Float[Array, "n ndim"]
    sigma: Float[Array, " n"]

    def differences(self, field):
        return field.gradient(self.points, outside="clamp") - self.gradients

    def relative(self, level, unit):
        return dataclasses.replace(self, gradients=self.gradients / unit, sigma=self.sigma / unit)

    def anchors(self, spacing):
        return jnp.zeros((0,), self.sigma.dtype), self.sigma * jnp.min(spacing)


class Margins(AbstractMisfit):
    """By how much the field falls short of a margin; signs are 1 inside and -1 outside."""

    points: Float[Array, "n ndim"]
    signs: Float[Array, " n"]
    level: Float[Array, ""]
    margin: Float[Array, " n"]
    sigma: Float[Array, " n"]

    def differences(self, field):
        above = self.signs * (field(self.points, outside="clamp") - self.level[None])
        return -self.signs * jnp.maximum(self.margin - above, 0)

    def relative(self, level, unit):
        return dataclasses.replace(
            self,
            level=(self.level - level) / unit,
            margin=self.margin / unit,
            sigma=self.sigma / unit,
        )

    def anchors(self, spacing):
        return self.level[None] + self.signs * self.margin, self.sigma


class Averages(AbstractMisfit):
    """Averages over boxes: along each axis a matrix from Bezier points to intervals."""

    values: Float[Array, "*boxes"]
    weights: tuple[Float[Array, "_intervals _points"], ...]
    sigma: Float[Array, "*boxes"]

    def differences(self, field):
        averages = field.control_points
        for matrix in self.weights:
            # The first axis is contracted, its result comes last: after all, axes are in order.
            averages = jnp.tensordot(averages, matrix, axes=((0,), (1,)), precision="highest")
        return averages - self.values

    def relative(self, level, unit):
        values = (self.values - level) / unit
        return dataclasses.replace(self, values=values, sigma=self.sigma / unit)

    def anchors(self, spacing):
        return self.values.ravel(), self.sigma.ravel()
