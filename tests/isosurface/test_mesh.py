"""Meshes: what is closed, normals."""

import jax.numpy as jnp
import numpy as np
import pytest

from contourfair_jax.isosurface import Isosurface
from contourfair_jax.isosurface._mesh import edges_of, open_edges, triangle_normals

# Vertices 0 to 3 of one; the other has 0 and 1 in common with it, and lies on the other side.
VERTICES = np.array(
    [[0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], dtype=float
)
ONE = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
OTHER = np.array([[0, 4, 1], [0, 1, 5], [1, 4, 5], [0, 5, 4]])


def mesh(triangles):
    nothing = np.zeros(len(VERTICES))
    return Isosurface(0.0, VERTICES, triangles, VERTICES, nothing, nothing, 0, 0, ())


def test_tetrahedra_that_share_an_edge_are_closed():
    """Their common edge has four triangles, two in each direction: no manifold, but a solid."""
    both = mesh(np.concatenate([ONE, OTHER]))
    assert edges_of(both.triangles).faces.max() == 4
    assert open_edges(both.triangles) == 0
    assert both.watertight
    assert abs(both.volume) == pytest.approx(1 / 3)
    assert both.volume == pytest.approx(mesh(ONE).volume + mesh(OTHER).volume)


def test_what_is_not_closed():
    assert open_edges(ONE[1:]) == 3
    assert not mesh(ONE[1:]).watertight
    assert np.isnan(mesh(ONE[1:]).volume)
    # One triangle that faces the other way: its edges are passed twice in one direction.
    turned = np.concatenate([ONE[:1, ::-1], ONE[1:]])
    assert (edges_of(turned).faces == 2).all()
    assert open_edges(turned) == 3
    # Two triangles at an edge that look the same way on three sheets.
    assert open_edges(np.concatenate([ONE, ONE[:1]])) == 3
    assert open_edges(np.zeros((0, 3), int)) == 0
    assert open_edges(ONE.astype(np.int32)) == 0


def test_triangles_without_extent_close_nothing_and_open_nothing():
    assert open_edges(np.concatenate([ONE, [[0, 0, 1]]])) == 0


def test_normals_of_numpy_and_jax():
    expected = np.cross(VERTICES[2] - VERTICES[0], VERTICES[1] - VERTICES[0])
    found = triangle_normals(VERTICES, ONE)
    np.testing.assert_array_equal(found[0], expected)
    np.testing.assert_array_equal(triangle_normals(jnp.asarray(VERTICES), ONE), found)
