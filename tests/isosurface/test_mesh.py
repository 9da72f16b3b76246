"""Meshes: edges, parts, what is closed, what is merged, normals; against loops."""

import itertools

import jax.numpy as jnp
import numpy as np
import pytest

from contourfair_jax.isosurface import Isosurface
from contourfair_jax.isosurface._mesh import (
    _rank,
    _without_folds,
    connect,
    edges_of,
    merged,
    open_edges,
    triangle_normals,
)

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
    assert (
        float(
            jnp.abs(
                triangle_normals(jnp.asarray(VERTICES), OTHER) - triangle_normals(VERTICES, OTHER)
            ).max()
        )
        == 0
    )


def test_every_edge_once():
    triangles = np.concatenate([ONE, OTHER])
    edges = edges_of(triangles)
    pairs = [tuple(sorted((t[k], t[(k + 1) % 3]))) for t in triangles.tolist() for k in range(3)]
    assert list(map(tuple, edges.ends.tolist())) == sorted(set(pairs))
    assert list(map(tuple, edges.ends[edges.of_triangle].reshape(-1, 2).tolist())) == pairs
    assert edges.faces.tolist() == [pairs.count(tuple(pair)) for pair in edges.ends.tolist()]


@pytest.mark.parametrize("count", [0, 5, 30, 60])
def test_parts_are_named_after_their_least_member(count, rng):
    pairs = rng.integers(0, 50, (2, count))
    least = np.arange(50)
    for _ in range(50):
        for a, b in pairs.T:
            least[[a, b]] = min(least[a], least[b])
    np.testing.assert_array_equal(connect(50, pairs), least)


def test_parts_along_a_path():
    order = np.random.default_rng(0).permutation(200)
    assert not connect(200, np.stack([order[:-1], order[1:]])).any()


def test_equal_keys_are_counted():
    assert _rank(np.array([7, 3, 7, 7, 3, 1])).tolist() == [0, 0, 1, 2, 1, 0]


def test_opposite_triangles_cancel():
    """Whichever corner they begin with; what is there more often stays as often as it exceeds."""
    for turned in itertools.permutations((4, 9, 2)):
        same = turned in ((4, 9, 2), (9, 2, 4), (2, 4, 9))
        kept = _without_folds(np.array([[4, 9, 2], turned, [1, 2, 3]]))
        assert kept.tolist() == [same, same, True]
    kept = _without_folds(np.array([[1, 2, 3], [3, 1, 2], [2, 1, 3], [2, 3, 1]]))
    assert kept.tolist() == [True, True, False, False]


def test_edges_without_length_are_contracted():
    """An edge of a tetrahedron is cut by a vertex, and the vertex moved onto its end."""
    vertices = np.append(VERTICES[:4], [[0, 0, 1e-9]], axis=0) + np.array([0, 0, 1.0])
    cut = np.array([[0, 2, 4], [4, 2, 1], [0, 4, 3], [4, 1, 3], [1, 2, 3], [0, 3, 2]])
    assert open_edges(cut) == 0
    kept, triangles = merged(vertices, cut)
    assert kept.tolist() == [0, 1, 2, 3]
    assert sorted(map(tuple, np.sort(triangles, axis=1).tolist())) == sorted(
        map(tuple, np.sort(ONE, axis=1).tolist())
    )
    assert open_edges(triangles) == 0
    kept, same = merged(vertices[:4], ONE)
    assert kept.tolist() == [0, 1, 2, 3]
    assert same is ONE


def test_what_folds_together_goes_and_vertices_are_numbered_anew():
    """A flat tetrahedron of which one edge has no length beside one that stays."""
    vertices = np.concatenate([[[9.0, 9, 9], [9, 9, 9 + 1e-9], [9, 8, 9], [8, 9, 9]], VERTICES[:4]])
    kept, triangles = merged(vertices, np.concatenate([ONE, ONE + 4]))
    assert kept.tolist() == [4, 5, 6, 7]
    np.testing.assert_array_equal(triangles, ONE)
