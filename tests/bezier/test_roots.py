"""Roots of cubics and along lines, against NumPy's and closed forms."""

import numpy as np
import pytest
from splines import catmull_rom

from contourfair_jax._bezier import roots
from contourfair_jax._bezier.bernstein import bernstein
from contourfair_jax._bezier.host import HostField


def values_at(points, t):
    return (bernstein(3, t) * points.T).sum(-1)


def test_roots_of_random_cubics(rng):
    """In blocks: more cubics than are solved at once."""
    points = rng.normal(size=(4, 40_000))
    points[0], points[3] = -np.abs(points[0]) - 1e-3, np.abs(points[3]) + 1e-3
    points[:, ::2] *= -1
    level = rng.normal(size=40_000)
    found = roots.cubic_root(points + level, level)
    assert ((found >= 0) & (found <= 1)).all()
    np.testing.assert_allclose(values_at(points, found), 0, atol=1e-12)


def test_cubics_that_need_bisection():
    """Flat at their root, or steep at one end only."""
    points = np.array([[-1.0, 0, 0, 1e-6], [-1, 0, 0, 1], [-1e-9, 0, 0, 1], [-1, 50, -50, 1]]).T
    found = roots.cubic_root(points, np.zeros(4))
    np.testing.assert_allclose(values_at(points, found), 0, atol=1e-12)
    assert found[1] == pytest.approx(0.5)


def test_the_nearer_end_where_both_are_on_one_side():
    points = np.array([[1.0, 2, 2, 3], [3, 2, 2, 1], [-1, -2, -2, -3], [-3, -2, -2, -1]]).T
    np.testing.assert_array_equal(roots.cubic_root(points, np.zeros(4)), [0, 1, 0, 1])
    ends = np.array([[0.0, 1, 2, 3], [3, 2, 1, 0], [0, -1, 2, 0]]).T
    np.testing.assert_array_equal(roots.cubic_root(ends, np.zeros(3)), [0, 1, 1])
    assert roots.cubic_root(np.zeros((4, 0)), np.zeros(0)).shape == (0,)


def plane():
    """2 y - x on 5 x 6 samples, as a field on the host."""
    samples = 2 * np.arange(5.0)[:, None] - np.arange(6.0)
    return HostField(np.asarray(catmull_rom(samples).control_points))


def test_roots_along_lines_of_a_plane():
    points = np.array([[1.5, 2.5], [2.5, 2.5], [1.25, 2.5], [0.1, 2.5], [2.0, 2.5]])
    up = np.array([[1.0, 0]] * 4 + [[-1.0, 0]])
    reach = np.array([3.0, 3, 3, 0.1, 3])
    # The last is told that the field rises where it falls: it is sought on the wrong side.
    found = roots.toward(plane(), points, up, reach, 0.0, 1e-14)
    np.testing.assert_allclose(found[:3], [[1.25, 2.5]] * 3, atol=1e-12)
    assert np.isnan(found[3:]).all()


def test_roots_within_rounding_stay_where_they_are():
    points, up = np.array([[1.25 + 1e-7, 2.5], [1.25 + 1e-5, 2.5]]), np.array([[1.0, 0]] * 2)
    found = roots.toward(plane(), points, up, np.ones(2), 0.0, 1e-6)
    assert found[0, 0] == points[0, 0]
    assert abs(found[1, 0] - 1.25) <= 1e-6


def test_reach_is_cut_at_the_border():
    """The level lies outside; at the border the field has not reached it."""
    points, up = np.array([[3.5, 1.0], [3.5, 1.0]]), np.array([[1.0, 0], [0.6, -0.8]])
    assert np.isnan(roots.toward(plane(), points, up, np.full(2, 9.0), 9.0, 1e-14)).all()
    found = roots.toward(plane(), points[:1], up[:1], np.full(1, 9.0), 7.0, 1e-14)
    np.testing.assert_allclose(found, [[4.0, 1.0]], atol=1e-12)


def test_roots_along_lines_of_a_curved_field(rng):
    x = np.linspace(-1, 1, 9)
    field = HostField(np.asarray(catmull_rom(np.exp(x[:, None] + 0.5 * x)).control_points))
    points = rng.uniform(2, 6, (50, 2))
    _, gradient = field.jet(points, 1)
    up = (gradient / np.linalg.norm(gradient, axis=0)).T
    found = roots.toward(field, points, up, np.full(50, 1.5), 1.0, 1e-13)
    there = np.isfinite(found[:, 0])
    assert 10 < there.sum() < 50
    np.testing.assert_allclose(field.jet(found[there], 0)[0], 1.0, atol=1e-12)
    off = (found - points)[there]
    assert (np.linalg.norm(off, axis=1) <= 1.5).all()
    np.testing.assert_allclose(off[:, 0] * up[there, 1] - off[:, 1] * up[there, 0], 0, atol=1e-12)
    # What is not found: both ends of the reach are on one side.
    side = field.jet(points[~there], 0)[0][0] < 1
    ends = points[~there] + np.where(side, 1.5, -1.5)[:, None] * up[~there]
    inside = ((ends >= 0) & (ends <= 8)).all(1)
    after = field.jet(ends[inside], 0)[0][0] < 1
    np.testing.assert_array_equal(after, side[inside])
