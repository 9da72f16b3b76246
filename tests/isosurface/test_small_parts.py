"""Pieces of cells and their clusters, against loops."""

import itertools

import numpy as np
import pytest
from splines import catmull_rom

from contourfair_jax._bezier.host import HostField, lattice_values
from contourfair_jax.isosurface import _small_parts
from contourfair_jax.isosurface._small_parts import Pieces


def field_of(shape, rng):
    return HostField(np.asarray(catmull_rom(rng.normal(size=shape)).control_points))


def pieces_at(corner, factor=4):
    corner = np.array(corner).reshape(-1, 3)
    count = len(corner)
    return Pieces(factor, corner, np.zeros((count, 2, 2, 2), bool), np.zeros(count, bool))


@pytest.mark.parametrize("count", [0, 1, 30])
def test_clusters_are_pieces_that_touch(count, rng):
    field = field_of((3, 2, 3), rng)
    shape = (8, 4, 8)
    places = np.stack(np.unravel_index(rng.permutation(256)[:count], shape), axis=1)
    cluster = _small_parts._clusters(field, pieces_at(places))
    least = np.arange(count)
    for _ in range(count):
        for a, b in itertools.combinations(range(count), 2):
            if np.abs(places[a] - places[b]).max() <= 1:
                least[[a, b]] = min(least[a], least[b])
    np.testing.assert_array_equal(cluster[:, None] == cluster, least[:, None] == least)


def test_clusters_do_not_reach_around_the_grid(rng):
    field = field_of((2, 2, 2), rng)
    cluster = _small_parts._clusters(field, pieces_at([[0, 0, 3], [0, 1, 0], [3, 3, 3], [0, 0, 0]]))
    assert len(np.unique(cluster)) == 3
    assert cluster[1] == cluster[3]


def test_a_chosen_member_marks_its_cluster():
    cluster = np.array([0, 0, 2, 2, 4])
    chosen = np.array([False, True, False, False, True])
    np.testing.assert_array_equal(
        _small_parts._share(cluster, chosen), [True, True, False, False, True]
    )


def test_pieces_that_touch_a_mixed_cube(rng):
    field = field_of((3, 2, 2), rng)
    mixed = np.zeros((4, 2, 2), bool)
    mixed[1, 0, 1] = True
    every = np.array(list(np.ndindex(16, 8, 8)))
    found = _small_parts._touch(field, pieces_at(every, 8), mixed)
    low, high = np.array([4, 0, 4]) - 1, np.array([7, 3, 7]) + 1
    expected = ((every >= low) & (every <= high)).all(1)
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("batch", [1 << 12, 2])
def test_pieces_are_those_that_may_hold_the_level(batch, rng, monkeypatch):
    """All that pass it between lattice points, with the sides of their corners and cubes."""
    monkeypatch.setattr(_small_parts, "_BATCH", batch)
    field, level, factor, lattice = field_of((3, 2, 3), rng), 0.1, 4, 2
    cells = np.array(list(np.ndindex(field.cells)))
    mixed = rng.uniform(size=tuple(lattice * n for n in field.cells)) < 0.3
    pieces = _small_parts._pieces(field, cells, mixed, level, factor)
    found = {tuple(corner): k for k, corner in enumerate(pieces.corner.tolist())}
    assert len(found) == len(pieces.corner) == len(pieces.above) == len(pieces.outside)
    values = lattice_values(field.gather(cells), factor)
    passed = 0
    for k, cell in enumerate(cells):
        for part in np.ndindex((factor,) * 3):
            corner = tuple((factor * cell + part).tolist())
            here = values[tuple(slice(p, p + 2) for p in part)][..., k] > level
            cube = tuple(np.array(corner) * lattice // factor)
            if mixed[cube]:
                assert corner not in found
            elif here.any() and not here.all():
                passed += 1
                assert corner in found
            if corner in found:
                np.testing.assert_array_equal(pieces.above[found[corner]], here)
                first = tuple(np.array(cube) * (factor // lattice) - factor * cell)
                assert pieces.outside[found[corner]] == (values[first][k] > level)
    assert passed > 10


def test_pieces_are_taken_with_all_they_have(rng):
    pieces = Pieces(
        4,
        rng.integers(0, 9, (5, 3)),
        rng.uniform(size=(5, 2, 2, 2)) < 0.5,
        rng.uniform(size=5) < 0.5,
    )
    mask = np.array([True, False, True, False, False])
    part = pieces.take(mask)
    assert part.factor == 4
    for name in ("corner", "above", "outside"):
        np.testing.assert_array_equal(getattr(part, name), getattr(pieces, name)[mask])


def test_no_cells_have_no_pieces(rng):
    field = field_of((3, 2, 3), rng)
    nothing = np.zeros(field.cells, bool)
    mixed = np.zeros(tuple(2 * n for n in field.cells), bool)
    found, unproved = _small_parts.small_parts(field, nothing, mixed, 0.0)
    assert (found, unproved) == ([], 0)
    pieces = _small_parts._pieces(field, np.zeros((0, 3), int), mixed, 0.0, 8)
    assert [part.shape for part in (pieces.corner, pieces.above, pieces.outside)] == [
        (0, 3),
        (0, 2, 2, 2),
        (0,),
    ]
