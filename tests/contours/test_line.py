"""The area within a line."""

import numpy as np
import pytest

from contourfair_jax.contours._line import signed_area


@pytest.mark.parametrize("place", [(0.0, 0.0), (1e8, -3e8)])
def test_area_of_a_polygon(place):
    ring = np.array([[0.0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [0, 3], [0, 0]]) + place
    assert signed_area(ring) == pytest.approx(4 + 2)
    assert signed_area(ring[::-1]) == pytest.approx(-6)
    assert signed_area(ring[:2]) == 0


def test_area_is_the_sum_of_triangles_from_any_vertex(rng):
    ring = rng.normal(size=(9, 2))
    ring[-1] = ring[0]
    corner = ring[3]
    sides = zip(ring[:-1] - corner, ring[1:] - corner, strict=True)
    assert signed_area(ring) == pytest.approx(sum(a[0] * b[1] - a[1] * b[0] for a, b in sides) / 2)
