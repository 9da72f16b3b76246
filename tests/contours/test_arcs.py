"""Numbers of crossings."""

import itertools

import numpy as np
import pytest

from contourfair_jax.contours._arcs import RANKS, Arcs, Codes, concatenate
from contourfair_jax.contours._pieces import MAX_DEPTH


def test_numbers_are_told_apart_and_read_back():
    codes = Codes(3, 2)
    highest = 2 << MAX_DEPTH
    places = list(
        itertools.product((0, 1, 2), (0, 1), (0, 1, highest - 1, highest), (0, 1), (0, 1))
    )
    numbers = codes.encode(*np.array(places).T)
    assert len(np.unique(numbers)) == len(places)
    assert numbers.min() == 0
    assert numbers.max() + 1 == 3 * 2 * (highest + 1) * 2 * 2
    np.testing.assert_array_equal(np.stack(codes.decode(numbers), 1), np.array(places)[:, 1:])


def test_as_many_levels_as_there_are_numbers():
    per_level = 4 * ((1000 << MAX_DEPTH) + 1) * 1000 * RANKS
    most = ((1 << 63) - 1) // per_level
    Codes(most, 1000)
    with pytest.raises(ValueError, match="are too many for 1000 cells"):
        Codes(most + 1, 1000)


def test_arcs_in_one():
    def part(level):
        one = np.array([level])
        return Arcs(one, one, np.full((level, 2), 0.5), np.zeros((1, 2)), np.zeros((1, 2), int))

    found = [part(1), part(2)]
    both = concatenate(found)
    assert found == []
    assert both.level.tolist() == both.count.tolist() == [1, 2]
    assert both.points.shape == (3, 2)
    nothing = concatenate([])
    assert [len(x) for x in vars(nothing).values()] == [0] * 5
    assert nothing.codes.shape == nothing.points.shape == nothing.stops.shape == (0, 2)
