"""The lattice of cells, its cubes, and roots on its edges, against loops."""

import itertools

import numpy as np
import pytest
from splines import catmull_rom

from contourfair_jax._bezier.bernstein import bernstein
from contourfair_jax._bezier.host import HostField
from contourfair_jax.isosurface import _lattice
from contourfair_jax.isosurface._lattice import _BLOCK, FACTOR
from contourfair_jax.isosurface._mesh import open_edges


def field_of(shape, rng):
    return HostField(np.asarray(catmull_rom(rng.normal(size=shape)).control_points))


def test_cubes_with_corners_on_both_sides(rng):
    inside = rng.uniform(size=(4, 5, 3)) < 0.7
    crossed = _lattice._crossed(inside)
    assert crossed.shape == (3, 4, 2)
    for cube in np.ndindex(crossed.shape):
        corners = inside[tuple(slice(k, k + 2) for k in cube)]
        assert crossed[cube] == (corners.any() and not corners.all())


def test_lattice_points_above_a_level(rng):
    """Cells that are not sampled are on one side, and told so to their corners."""
    field = field_of((4, 3, 5), rng)
    low, high = field.bounds
    level = float(np.quantile(field.net, 0.6))
    for active in ((low <= level) & (high > level), np.ones(low.shape, bool)):
        window = (slice(0, 3), slice(0, 2), slice(1, 4))
        inside = _lattice._inside(field, active, window, level)
        assert inside.shape == (7, 5, 7)
        for place in np.ndindex(inside.shape):
            at = np.array([place]) / FACTOR + [0, 0, 1]
            assert inside[place] == (field.jet(at, 0)[0][0, 0] > level)


def test_a_plateau_at_the_level_is_outside():
    field = HostField(np.ones((4, 4, 4)))
    for level, expected in ((1.0, False), (0.5, True)):
        for active in (np.zeros((1, 1, 1), bool), np.ones((1, 1, 1), bool)):
            inside = _lattice._inside(field, active, (slice(0, 1),) * 3, level)
            assert (inside == expected).all()


@pytest.mark.parametrize("factor", [1, 2, 8])
def test_roots_on_edges_of_a_lattice(factor, rng):
    """Of cubics that rise along the edge: the value at the root is the level."""
    points = np.sort(rng.normal(size=(4, 30)), axis=0)
    middle = (rng.integers(0, factor, 30) + 0.5) / factor
    low, high = ((bernstein(3, middle + s / factor) * points.T).sum(1) for s in (-0.5, 0.5))
    level = float(np.median(0.5 * (low + high)))
    root = _lattice._root(points, middle, level, factor)
    value = (bernstein(3, root) * points.T).sum(1)
    crossed = (low < level) & (level < high)
    assert crossed.any()
    np.testing.assert_allclose(value[crossed], level, atol=1e-12)
    assert (np.abs(root - middle) <= 0.5 / factor + 1e-15).all()


def test_polar_forms_are_parts_of_cubics(rng):
    points = rng.normal(size=(4, 3))
    low, high = np.full(3, 0.2), np.full(3, 0.6)
    part = [_lattice._blossom(points, [high if k < n else low for k in range(3)]) for n in range(4)]
    for t in (0.0, 0.4, 1.0):
        np.testing.assert_allclose(
            bernstein(3, np.array(t)) @ part, bernstein(3, np.array(0.2 + 0.4 * t)) @ points
        )


def test_vertices_of_middles_lie_on_the_field(rng):
    """Middles of edges along every axis, also on faces of cells."""
    field = field_of((3, 3, 3), rng)
    twice = np.array([[1, 4, 2], [3, 0, 8], [4, 1, 6], [2, 2, 5], [6, 8, 7]])
    along = (twice % 2).argmax(1)
    ends = []
    for side in (-1, 1):
        moved = twice.astype(float)
        moved[np.arange(5), along] += side
        ends.append(field.jet(moved / 4, 0)[0][0])
    level = 0.5 * (ends[0] + ends[1])
    for k in range(5):
        (point,) = _lattice._on_edges(field, twice[k : k + 1], float(level[k]), 2)
        assert field.jet(point[None], 0)[0][0, 0] == pytest.approx(level[k])
        other = [axis for axis in range(3) if axis != along[k]]
        np.testing.assert_array_equal(point[other], twice[k, other] / 4)


def test_blocks_of_a_lattice_agree_and_are_placed():
    """A cube of one inside point has an octahedron around it, wherever the block is."""
    inside = np.zeros((5, 5, 5), bool)
    inside[2, 1, 3] = True
    start = np.array([4, 0, 8])
    part = _lattice._marched(inside, np.ones((4, 4, 4), bool), start)
    centre = 2 * (start + np.array([2, 1, 3]))
    expected = {tuple(centre + s * e) for e in np.eye(3, dtype=int) for s in (-1, 1)}
    assert set(map(tuple, part.middles.tolist())) == expected
    assert part.triangles.shape == (8, 3)
    assert open_edges(part.triangles) == 0
    # Of the cubes asked for only: one holds one of the eight.
    one = np.zeros((4, 4, 4), bool)
    one[1, 0, 3] = True
    part = _lattice._marched(inside, one, start)
    assert part.triangles.shape == (1, 3)
    assert len(part.middles) == 3
    corner = part.middles[part.triangles[0]]
    normal = np.cross(corner[1] - corner[0], corner[2] - corner[0])
    assert normal @ (corner.mean(0) - centre) != 0


@pytest.mark.parametrize("outside", [False, True])
def test_pieces_in_several_blocks_are_marched(outside):
    """Around one point inside, or outside, where two blocks meet: one octahedron in two parts."""
    side = FACTOR * _BLOCK
    point = np.array([side, 5, 3])
    corners = np.array(list(itertools.product((0, 1), repeat=3)))
    corner = point - corners
    above = np.full((8, 2, 2, 2), outside)
    for k, at in enumerate(corners):
        above[k][tuple(at)] = not outside
    pieces = _lattice.Pieces(8, corner, above, np.full(8, outside))
    parts = _lattice._march_pieces(pieces)
    assert [len(part.triangles) for part in parts] == [4, 4]
    middles = {tuple(m) for part in parts for m in part.middles.tolist()}
    assert middles == {tuple(2 * point + s * e) for e in np.eye(3, dtype=int) for s in (-1, 1)}
