"""Measures of surfaces as they were called before: with arrays, not an `Isosurface`."""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ParamSpec

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._field import BezierField
from .._support.public import warn_former
from ..isosurface._mesh import triangle_normals

Params = ParamSpec("Params")
Measure = Callable[Params, Float[Array, ""]]
_NAMES = ("field", "vertices", "triangles", "level")


@dataclass(frozen=True)
class _Arrays:
    """A mesh from the arguments of a former call; vertices and level may be traced."""

    vertices: Any
    triangles: Any
    level: Any


def formerly_of_arrays(measure: Measure[Params]) -> Measure[Params]:
    """A decorator: `(field, vertices, triangles, level)` is measured too, with a warning.

    Volumes of such calls are those of the places above the level, whichever way triangles turn.
    """

    @functools.wraps(measure)
    def call(*args: Any, **kwargs: Any) -> Float[Array, ""]:
        if len(args) + len(kwargs) < len(_NAMES):
            return measure(*args, **kwargs)
        name = measure.__name__
        warn_former(f"{name}(field, vertices, triangles, level)", f"{name}(field, surface)")
        given = dict(zip(_NAMES, args, strict=False)) | kwargs
        field, mesh = given["field"], _Arrays(*(given[key] for key in _NAMES[1:]))
        measured = measure(field, mesh)  # pyright: ignore[reportCallIssue]
        return _side(field, mesh) * measured if name == "volume" else measured

    return call


def _side(field: BezierField, mesh: _Arrays) -> Float[Array, ""]:
    """1 where the triangles face smaller values, -1 where they face larger ones."""
    vertices, triangles = jnp.asarray(mesh.vertices), np.asarray(mesh.triangles)
    normals = triangle_normals(vertices, triangles)
    uphill = jnp.mean(field.gradient(vertices, "extend")[triangles], axis=1)
    known = jnp.isfinite(uphill)
    return -jnp.sign(jnp.sum(jnp.where(known, normals * uphill, 0)))
