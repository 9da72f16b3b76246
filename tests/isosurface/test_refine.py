"""Triangles that are halved: they cover what they covered, and face the way they faced."""

import itertools

import numpy as np
import pytest
from splines import catmull_rom

from contourfair_jax._bezier.host import HostField
from contourfair_jax.isosurface import _refine
from contourfair_jax.isosurface._lattice import Surface
from contourfair_jax.isosurface._mesh import edges_of, open_edges, triangle_normals


def test_pairs_among_others():
    pairs, others = np.array([[1, 2], [2, 3], [1, 3]]), np.array([[0, 1], [2, 3], [1, 2]])
    np.testing.assert_array_equal(_refine._among(pairs, others), [True, True, False])
    assert not _refine._among(pairs, others[:0]).any()


@pytest.mark.parametrize("marks", list(itertools.product((False, True), repeat=3)))
@pytest.mark.parametrize("lean", [0.1, 0.9])
def test_a_triangle_is_cut_at_any_of_its_edges(marks, lean, rng):
    """The parts add up, turn as it did, and have every middle; a square is cut the shorter way."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [lean, 1, 0]])
    points = np.concatenate([corners, 0.5 * (corners + np.roll(corners, -1, axis=0))])
    triangles = np.array([[0, 1, 2], [1, 2, 0]])
    middles = np.where(marks, [3, 4, 5], -1)
    middles = np.stack([middles, np.roll(middles, -1)])
    children, parents = _refine._halved(points, triangles, middles)
    normals = triangle_normals(points, children)
    assert (normals[:, 2] > 0).all()
    for parent in (0, 1):
        mine = children[parents == parent]
        assert len(mine) == 1 + sum(marks)
        assert normals[parents == parent, 2].sum() == pytest.approx(1.0)
        assert set(mine.ravel()) == {0, 1, 2, *(3 + np.flatnonzero(marks))}
    if sum(marks) == 2:
        a = int(np.flatnonzero(np.logical_not(marks))[0])  # the edge from a to b is not cut
        b, one, other = (a + 1) % 3, 3 + (a + 1) % 3, 3 + (a + 2) % 3
        cuts = [(a, one), (b, other)]
        lengths = [np.linalg.norm(points[i] - points[j]) for i, j in cuts]
        ends = {tuple(pair) for pair in edges_of(children[parents == 0]).ends.tolist()}
        assert tuple(sorted(cuts[int(np.argmin(lengths))])) in ends


def test_halving_that_would_turn_triangles_over_is_left_out():
    """A vertex far off on the other side; the triangle beside it is halved where it may be."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0.5, 0.5, 0], [0.2, 2.5, 0]])
    triangles = np.array([[0, 1, 2], [2, 1, 3]])
    edges = edges_of(triangles)
    names = list(map(tuple, edges.ends.tolist()))
    up = np.tile([0.0, 0.0, 2.0], (6, 1))
    place = np.full(5, -1)
    place[names.index((1, 2))] = 4
    np.testing.assert_array_equal(_refine._upright(points, up, triangles, edges, place), place)
    wrong = place.copy()
    wrong[names.index((0, 1))] = 5
    found = _refine._upright(points, up, triangles, edges, wrong)
    # Every cut of the triangle that would turn goes, also the one that it shares.
    np.testing.assert_array_equal(found, np.full(5, -1))
    upright = _refine._upright_triangles(points, up, np.array([[0, 1, 2], [0, 2, 1], [0, 1, 1]]))
    np.testing.assert_array_equal(upright, [True, False, False])


def bowl():
    """|x - 2|^2 on 5^3 samples, where it is met exactly away from the border."""
    x = np.arange(9.0) - 4
    samples = x[:, None, None] ** 2 + x[:, None] ** 2 + x**2
    return HostField(np.asarray(catmull_rom(samples).control_points))


def octahedron(radius):
    corners = radius * np.concatenate([np.eye(3), -np.eye(3)]) + 4
    sides = [
        [i, j, k] if np.linalg.det(corners[[i, j, k]] - 4) > 0 else [i, k, j]
        for i, j, k in itertools.product((0, 3), (1, 4), (2, 5))
    ]
    return Surface(corners, np.array(sides))


@pytest.mark.parametrize("tolerance", [0.3, 0.05, 0.01])
def test_an_octahedron_becomes_a_ball(tolerance):
    radius, calls = 2.0, []
    surface, unmet = _refine.split(
        bowl(), octahedron(radius), radius**2, tolerance, 1e-13, lambda *call: calls.append(call)
    )
    assert unmet == 0
    assert open_edges(surface.triangles) == 0
    from_centre = surface.vertices - 4
    np.testing.assert_allclose(np.linalg.norm(from_centre, axis=1), radius, atol=1e-9)
    assert (
        triangle_normals(from_centre, surface.triangles) * from_centre[surface.triangles[:, 0]]
    ).sum(1).min() > 0
    middles = from_centre[surface.triangles].mean(1)
    off = radius - np.linalg.norm(middles, axis=1)
    assert 0.05 * tolerance < off.max() <= tolerance
    # A sphere of triangles of a chord's length h is h^2 / 8 R away: no more of them than that asks.
    assert len(surface.triangles) < 40 * (radius / tolerance)
    done, total = zip(*calls, strict=True)
    assert done[0] == 0
    assert list(done) == sorted(done)
    assert all(a <= b for a, b in calls)
    assert total[0] == 12


def test_edges_that_cannot_be_halved_are_counted(monkeypatch):
    """No root within reach: a level that the field has nowhere near."""
    surface, unmet = _refine.split(bowl(), octahedron(0.5), 30.0, 0.01, 1e-13, lambda *_: None)
    assert unmet == 12
    np.testing.assert_array_equal(surface.triangles, octahedron(0.5).triangles)
    monkeypatch.setattr(_refine, "_ROUNDS", 1)
    surface, _ = _refine.split(bowl(), octahedron(2.0), 4.0, 0.01, 1e-13, lambda *_: None)
    assert len(surface.triangles) == 32


@pytest.mark.parametrize("share", [0.3, 0.8, 1.2])
def test_roots_are_sought_beside_middles_that_may_be_far(share):
    """Of a plane, where first order is exact: below half the tolerance nothing is sought."""
    x = np.arange(4.0)
    samples = np.broadcast_to(x[:, None, None], (4, 4, 4))
    field = HostField(np.asarray(catmull_rom(samples).control_points))
    tolerance, edges = 0.1, edges_of(np.array([[0, 1, 2]]))
    points = np.array([[1.5, 1.25, 1.25], [1.5, 1.75, 1.25], [1.5, 1.25, 1.75]])
    level = 1.5 + 0.5 * share * tolerance
    found, far = _refine._middles(field, points, edges, np.arange(3), level, tolerance, 1e-14)
    assert not far.any()
    assert np.isnan(found).all() == (share < 1)
    if share > 1:
        np.testing.assert_allclose(found[:, 0], level, atol=1e-12)
    _, far = _refine._middles(field, points, edges, np.arange(3), 1.5 + 2 * tolerance, tolerance, 0)
    assert far.all()
    # What is within rounding is near, however small the tolerance.
    found, far = _refine._middles(field, points, edges, np.arange(3), level, 1e-8, 0.1)
    assert np.isnan(found).all()
    assert not far.any()
