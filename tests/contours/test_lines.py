"""Contour lines and bands: on the field, complete, within tolerance, never crossing."""

from itertools import pairwise

import cases
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import samples_of
from scipy.spatial import cKDTree
from shape_checks import refused
from skimage.measure import find_contours
from splines import catmull_rom

import contourfair_jax as cf
from contourfair_jax import metrics
from contourfair_jax._bezier.roots import cubic_root
from contourfair_jax._field import BezierField
from contourfair_jax.contours import ContourLine, Contours, contours, filled

GRID = cases.GRIDS[2][1]


def field_of(name, grid=GRID):
    return cf.fair_field(samples_of(name, grid), spacing=grid.spacing, origin=(-1.0, 2.0))


def analytic(name):
    case = cases.ANALYTIC[name]
    return catmull_rom(case.samples(), case.spacing[0], -1.0)


def inner_levels(samples, count=5):
    """Equally spaced within the range, and the median sample: a level that samples have."""
    present = np.asarray(samples)[np.isfinite(samples)]
    even = np.linspace(present.min(), present.max(), count + 2)[1:-1]
    middle = np.quantile(present, 0.5, method="lower")
    return np.append(even[np.abs(even - middle) > 1e-6 * np.ptp(present)], middle)


_jet = jax.jit(lambda field, points: field.jet(points, outside="clamp"))


def jet_at(field, points):
    """Value, gradient and Hessian; padded, so that few numbers of points are compiled."""
    padded = np.zeros((-len(points) % 4096 + len(points), 2))
    padded[: len(points)] = points
    return [np.asarray(x)[: len(points)] for x in _jet(field, jnp.asarray(padded))]


def chords(lines):
    """Start and end of every chord."""
    starts = np.concatenate([line.points[:-1] for line in lines])
    return starts, np.concatenate([line.points[1:] for line in lines])


def chord_levels(lines):
    """The level of every chord."""
    return np.repeat([line.level for line in lines], [len(line.points) - 1 for line in lines])


def onto_contour(field, points, level):
    """Newton along the gradient; the level is one per point."""
    for _ in range(8):
        value, gradient, _ = jet_at(field, points)
        squared = np.maximum((gradient**2).sum(-1), 1e-300)
        points = points - ((value - level) / squared)[:, None] * gradient
    return points


@pytest.mark.parametrize("name", cases.field_cases(2))
def test_lines_lie_on_the_field_with_larger_values_left_and_do_not_cross(name):
    field = field_of(name)
    samples = np.asarray(field.samples)
    lines = field.contours(inner_levels(samples))
    assert metrics.crossings(lines) == 0
    assert lines.unproved == 0
    if not lines:
        return
    starts, ends = chords(lines)
    value, gradient, _ = jet_at(field, starts)
    assert np.abs(value - chord_levels(lines)).max() <= 1e-9 * np.ptp(samples)
    left = (ends - starts) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    _, gradient, _ = jet_at(field, 0.5 * (starts + ends))
    longer = np.linalg.norm(left, axis=1) > 1e-6
    assert ((gradient * left).sum(1)[longer] > 0).all()


@pytest.mark.parametrize("name", cases.field_cases(2))
def test_lines_are_closed_or_end_on_the_border(name):
    field = field_of(name)
    low = np.asarray(field.origin)
    high = low + np.asarray(field.spacing) * (np.array(field.shape) - 1)
    for line in field.contours(inner_levels(field.samples)):
        ends = line.points[[0, -1]]
        assert line.closed == (ends[0] == ends[1]).all()
        assert line.closed or ((ends == low) | (ends == high)).any(1).all()


@pytest.mark.parametrize("name", ["noise", "smooth_random", "saddle", "marschner_lobb", "spike"])
def test_nothing_is_missed(name, rng):
    """Wherever the field passes a level between fine samples there is a line, and nowhere else."""
    factor, samples = 16, cases.FIELDS[name].samples((15, 14), rng)
    field = catmull_rom(samples)
    fine = np.asarray(field.refine(factor))
    for level in inner_levels(samples, 3)[:-1]:
        lines = field.contours(level, 1e-3)
        starts, ends = chords(lines)
        along = np.linspace(0, 1, 9)[:, None, None]
        tree = cKDTree((starts + along * (ends - starts)).reshape(-1, 2))
        for axis in (0, 1):
            above = np.moveaxis(fine > level, axis, 0)
            k, j = np.nonzero(above[1:] != above[:-1])
            passed = np.stack([k + 0.5, j] if axis == 0 else [j, k + 0.5], axis=1) / factor
            assert tree.query(passed)[0].max() <= 0.75 / factor
        assert len(lines) >= len(find_contours(fine, level))


@pytest.mark.parametrize("tolerance", [0.1, 1e-2, 1e-4])
@pytest.mark.parametrize("name", ["disk", "noise", "marschner_lobb"])
def test_chords_keep_to_the_tolerance(name, tolerance, rng):
    samples = cases.FIELDS[name].samples((15, 14), rng)
    field = catmull_rom(samples)
    lines = field.contours(inner_levels(samples, 3)[:-1], tolerance)
    starts, ends = chords(lines)
    levels, worst = chord_levels(lines), 0.0
    for part in np.linspace(0, 1, 7)[1:-1]:
        points = starts + part * (ends - starts)
        true = onto_contour(field, points, levels)
        worst = max(worst, np.linalg.norm(true - points, axis=1).max())
    assert 0.05 * tolerance < worst <= tolerance


def test_finer_tolerance_takes_few_more_vertices():
    counts = [
        sum(len(line.points) for line in analytic("disk").contours(0.5, t)) for t in (1e-2, 1e-4)
    ]
    assert counts[1] < 15 * counts[0]


def test_circle_has_its_length_and_area():
    case = cases.Analytic(lambda x, y: x**2 + y**2, 2, 10)
    field = catmull_rom(case.samples(), case.spacing[0], -1.0)
    (line,) = field.contours(0.36, 1e-4)
    assert line.closed
    assert np.linalg.norm(np.diff(line.points, axis=0), axis=1).sum() == pytest.approx(
        2 * np.pi * 0.6, rel=3e-3
    )
    area = metrics.signed_area(line.points)
    assert area == pytest.approx(-np.pi * 0.36, rel=3e-3)  # smaller inside: clockwise


def test_a_loop_much_smaller_than_a_cell_is_found():
    """The top of a paraboloid between samples, 1e-6 of a cell below its summit."""
    x = np.linspace(0, 1, 4)
    bump = -((x[:, None] - 0.37) ** 2) - 2 * (x[None, :] - 0.61) ** 2
    fours = _bezier_of(bump)
    field = BezierField(jnp.asarray(fours), jnp.ones(2), jnp.zeros(2))
    (loop,) = field.contours(-1e-6, 1e-6)
    assert loop.closed
    reach = np.ptp(loop.points, axis=0) / 2
    np.testing.assert_allclose(reach, [1e-3, 1e-3 / np.sqrt(2)], rtol=0.02)
    np.testing.assert_allclose(loop.points.mean(0), [0.37, 0.61], atol=1e-4)


def _bezier_of(values):
    """Bezier points of the bicubic through 4 x 4 values."""
    t = np.linspace(0, 1, 4)
    basis = np.stack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3], axis=1)
    return np.linalg.solve(basis, np.linalg.solve(basis, values).T).T


def test_a_level_at_saddles_separates_lines_that_would_touch():
    samples = np.indices((6, 5)).sum(0) % 2.0
    field = cf.fair_field(samples)
    lines = field.contours([0.5, 0.5 + 1e-7])
    assert metrics.crossings(lines) == 0
    assert lines.unproved == 0


@pytest.mark.parametrize("offset", [0.0, 1e6])
@pytest.mark.parametrize("name", ["noise", "franke", "spike"])
def test_levels_too_close_to_tell_apart_count_once(name, offset):
    field = cf.fair_field(samples_of(name, GRID) + offset)
    samples = np.asarray(field.samples)
    low, high = samples.min(), samples.max()
    level = low + 0.3 * (high - low)
    whole = np.prod(np.array(field.shape) - 1.0)
    for part in (1e-16, 1e-14, 2e-10):
        near = level + np.array([0, part, 2 * part]) * (high - low)
        asked = np.unique(near)
        lines, bands = field.contours(near), field.filled([-np.inf, *near, np.inf])
        assert lines.levels == (level,)
        assert bands.levels == (-np.inf, level, np.inf)
        assert metrics.crossings(lines) == 0
        assert sum(band.area for band in bands) == pytest.approx(whole, rel=1e-9)
        for notes in (lines.notes, bands.notes):
            assert any("too close" in note for note in notes) == (len(asked) > 1)
    with pytest.raises(ValueError, match="levels must be at least two"):
        field.filled([level, np.nextafter(level, np.inf)])
    lines = field.contours(level + np.array([0, 1.1e-9, 2.2e-9]) * (high - low))
    assert len(lines.levels) == 3
    assert metrics.crossings(lines) == 0


def test_a_plateau_at_the_level_is_below_it():
    """No specks where the field is flat but for rounding: only the borders of what is higher."""
    rng = np.random.default_rng(0)
    samples = np.full((15, 14), 7.1)
    samples[:5] = rng.normal(20.0, 1.0, (5, 14))
    field = cf.fair_field(samples)
    lines = field.contours(7.1)
    assert 0 < len(lines) < 15
    assert all((line.points[:, 0] < 7.0).all() for line in lines)
    assert metrics.crossings(lines) == 0


@pytest.mark.slow
@pytest.mark.parametrize("offset", [1e6, -1e6])
def test_lines_stay_on_the_level_far_from_zero(offset, rng):
    """The same lines as near zero: samples round, and nothing else."""
    samples = rng.integers(0, 4096, (20, 19)) / 4096
    samples[10:14, 5:9] = samples[10, 5]
    levels = [0.2, 0.4, samples[10, 5], 0.8]
    near = cf.fair_field(samples).contours(levels)
    field = cf.fair_field(samples + offset)
    far = field.contours(np.add(levels, offset))
    assert metrics.crossings(far) == 0
    assert (far.unproved, len(far), far.notes[1:]) == (0, len(near), ())
    assert "levels are on many samples" in far.notes[0]
    starts, _ = chords(far)
    assert np.abs(jet_at(field, starts)[0] - chord_levels(far)).max() <= 1e-9 * np.ptp(samples)


def test_levels_of_many_samples_give_a_note(rng):
    samples = rng.integers(0, 40, (15, 14)).astype(float)
    samples[3:9, 2:8] = 7.0
    samples[0, :2] = [8.0, 40.0]
    field = cf.fair_field(samples)
    levels = [6.75, 7.0, 39.5]
    (note,) = field.contours(levels).notes
    assert note.startswith("1 of 3 levels are on many samples")
    assert "7; levels between samples, such as 7.5," in note
    assert field.filled(levels).notes == (note,)
    assert field.contours([6.75, 7.5]).notes == ()
    assert "such as 3.5" in cf.fair_field(np.minimum(samples, 4)).contours(4.0).notes[-1]


@pytest.mark.slow
def test_rounding_of_many_digits_gives_a_note(rng):
    samples = rng.normal(size=(15, 14))
    levels = [0.25, 0.5]
    for offset, dtype, noted in ((1e6, float, False), (1e8, float, True), (10, "f4", False)):
        lines = cf.fair_field((samples + offset).astype(dtype)).contours(np.add(levels, offset))
        assert any("above their levels" in note for note in lines.notes) == noted


def test_rounding_of_float32_makes_no_specks():
    samples = np.full((15, 14), 1000.7, np.float32)
    samples[:5] += np.linspace(90, 10, 5, dtype=np.float32)[:, None]
    lines = cf.fair_field(samples).contours(np.float32(1000.7))
    assert all((line.points[:, 0] < 7.0).all() for line in lines)
    assert len(lines) <= 2


@pytest.mark.slow
def test_what_cannot_be_proved_is_counted():
    """A straight valley with its bottom at the level, oblique to the grid: two lines, or none."""
    x = np.linspace(0, 1, 4)
    fours = _bezier_of((x[:, None] - 0.7 * x - 0.1) ** 2)
    field = BezierField(jnp.asarray(fours), jnp.ones(2), jnp.zeros(2))
    lines = field.contours(0.0)
    assert lines.unproved > 0
    assert any("may hold details" in note for note in lines.notes)
    assert metrics.crossings(lines) == 0
    bands = field.filled([-np.inf, 0.0, np.inf])
    assert bands.unproved == lines.unproved
    assert any("the bands do not show" in note for note in bands.notes)


def test_a_valley_along_the_grid_at_the_level_is_proved():
    samples = np.abs(np.arange(15.0) - 3)[:, None] ** 2 * np.ones(14)
    lines = cf.fair_field(samples).contours(0.0)
    assert lines.unproved == 0
    assert 2 <= len(lines) <= 8
    assert metrics.crossings(lines) == 0


def test_lines_end_at_missing_samples():
    samples = cases.FIELDS["smooth_random"].samples((15, 14), np.random.default_rng(0))
    samples[6:8, 5] = np.nan
    field = cf.fair_field(samples)
    valid = np.isfinite(np.asarray(field.bounds()[0]))
    lines = field.contours(inner_levels(samples))
    inner_ends = 0
    for line in lines:
        assert np.isfinite(line.points).all()
        for end in line.points[[0, -1]] if not line.closed else []:
            at = np.floor(end).astype(int)
            around = valid[max(at[0] - 1, 0) : at[0] + 1, max(at[1] - 1, 0) : at[1] + 1]
            on_border = (end == 0).any() or (end == np.array(samples.shape) - 1).any()
            assert on_border or not around.all()
            inner_ends += not on_border
    assert inner_ends > 0
    assert metrics.crossings(lines) == 0


def test_nothing_but_missing_samples():
    field = cf.fair_field(np.full((6, 5), np.nan))
    assert len(field.contours(0.0)) == 0
    assert [len(band.polygons) for band in field.filled([-np.inf, 0.0, np.inf])] == [0, 0]


@pytest.mark.parametrize("levels", [[5.0, -3.0], [1.5], []])
def test_levels_without_lines_give_a_note(levels):
    lines = cf.fair_field(np.full((6, 5), 1.5)).contours(levels)
    assert isinstance(lines, Contours)
    assert list(lines) == []
    assert len(lines.notes) == bool(levels)


def test_result_is_a_sequence_sorted_by_level_with_each_level_once():
    field = field_of("cone")
    lines = field.contours([0.6, 0.3, 0.6])
    assert lines.levels == (0.3, 0.6)
    assert [line.level for line in lines] == sorted(line.level for line in lines)
    assert isinstance(lines[0], ContourLine)
    assert lines[:2] == tuple(lines)[:2]
    assert "2 levels" in repr(lines)


@pytest.mark.parametrize("trace", [contours, filled])
def test_progress_counts_rows_of_cells(trace):
    field, calls = field_of("plane"), []
    trace(field, [0.5, 1.0], progress=lambda *call: calls.append(call))
    assert calls
    assert [total for _, total in calls] == [field.shape[0] - 1] * len(calls)
    assert 0 < calls[0][0] <= calls[-1][0] <= field.shape[0] - 1


def test_spacing_and_origin_only_move_the_lines():
    field = field_of("franke")
    plain = BezierField(field.control_points, jnp.ones(2), jnp.zeros(2))
    levels = inner_levels(field.samples)
    for moved, line in zip(field.contours(levels), plain.contours(levels), strict=True):
        placed = line.points * np.asarray(field.spacing) + np.asarray(field.origin)
        np.testing.assert_allclose(moved.points, placed, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("levels", "tolerance", "message"),
    [
        ([0.1, np.nan], 0.01, "levels must be finite"),
        ([[0.1]], 0.01, "levels must be real numbers in one sequence"),
        (["a"], 0.01, "levels must be real"),
        ([[0.1], [0.2, 0.3]], 0.01, "levels must be real numbers in one sequence"),
        (np.ma.array([0.1, 0.2], mask=[False, True]), 0.01, "not masked, got 1 that are"),
        (np.arange(10_001.0), 0.01, "levels must be at most 10000"),
        (0.1, 0.0, "tolerance must be"),
        (0.1, -1.0, "tolerance must be"),
        (0.1, np.nan, "tolerance must be"),
        (0.1, True, "tolerance must be"),
        (0.1, "0.1", "tolerance must be"),
        (0.1, np.array([0.1]), "tolerance must be"),
        (0.1, np.array(0.1j), "tolerance must be"),
    ],
)
def test_bad_arguments(levels, tolerance, message):
    with refused(ValueError, match=message):
        field_of("cone").contours(levels, tolerance)


@pytest.mark.parametrize(
    ("levels", "message"),
    [
        ([[0, 1], [2, 3]], "levels must be real numbers in one sequence"),
        ([1 + 2j, 2], "levels must be real .* complex128"),
        (["a", "b"], "levels must be real"),
        ([0.1, np.nan], "levels must be finite"),
        (np.ma.array([0.1, 0.2, 0.3], mask=[True, False, False]), "not masked, got 1 that are"),
    ],
)
def test_bad_ends_of_bands(levels, message):
    with refused(ValueError, match=message):
        field_of("cone").filled(levels)


def test_arrays_are_levels_and_tolerances():
    field = field_of("cone")
    plain = field.contours([0.25, 0.5], 0.125)
    for tolerance in (np.array(0.125), jnp.array(0.125), np.float32(0.125)):
        for levels in (np.ma.array([0.25, 0.5]), jnp.array([0.25, 0.5])):
            again = field.contours(levels, tolerance)
            assert all((a.points == b.points).all() for a, b in zip(plain, again, strict=True))


def test_three_dimensions_are_refused():
    field = BezierField(jnp.zeros((7, 7, 7)), jnp.ones(3), jnp.zeros(3))
    with pytest.raises(ValueError, match="field must be 2-D"):
        field.contours(0.0)
    with pytest.raises(ValueError, match="field must be 2-D"):
        field.filled([0.0, 1.0])


@pytest.mark.slow
def test_many_levels():
    lines = field_of("plane").contours(np.linspace(-1, 6, 2000))
    assert len(lines) > 1000
    assert metrics.crossings(lines) == 0


# Roots ------------------------------------------------------------------------------------


def test_roots_of_cubics_that_are_hard_for_newton(rng):
    points = rng.normal(size=(4, 4000)) * 10.0 ** rng.uniform(-8, 8, 4000)
    points[:, :1000] = np.array([[-1.0], [-1e-9], [1e-9], [1.0]]) ** 3  # flat in the middle
    points[:, 1000:2000] = np.array([[-1e-12], [0.0], [0.0], [1.0]])
    points = points[:, (points[0] > 0) != (points[3] > 0)]
    t = cubic_root(points, np.zeros(points.shape[1]))
    basis = np.stack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3])
    assert ((t >= 0) & (t <= 1)).all()
    assert (np.abs((basis * points).sum(0)) <= 1e-13 * np.abs(points).max(0)).all()


def test_root_at_an_end():
    points = np.array([[0.0, 1.0, 1.0], [1.0, 2.0, 2.0], [2.0, 3.0, 3.0], [3.0, 0.0, 4.0]])
    assert cubic_root(points, np.zeros(3)).tolist() == [0.0, 1.0, 0.0]


# Bands ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", cases.field_cases(2))
def test_bands_tile_the_grid(name):
    field = field_of(name)
    levels = [-np.inf, *inner_levels(field.samples), np.inf]
    bands = field.filled(levels, 1e-3)
    whole = np.prod((np.array(field.shape) - 1) * np.asarray(field.spacing))
    assert sum(band.area for band in bands) == pytest.approx(whole, rel=1e-9)
    fine = np.asarray(field.refine(32))
    middle = 0.25 * (fine[1:, 1:] + fine[:-1, 1:] + fine[1:, :-1] + fine[:-1, :-1])
    raised = 1e-9 * np.ptp(np.asarray(field.samples)) + 1e-12
    for band in bands:
        part = ((middle > band.lower + raised) & (middle <= band.upper + raised)).mean()
        assert band.area / whole == pytest.approx(part, abs=0.01)


@pytest.mark.parametrize("name", ["noise", "franke", "checkerboard", "cone"])
def test_polygons_have_their_holes(name):
    field = field_of(name)
    for band in field.filled([-np.inf, *inner_levels(field.samples), np.inf]):
        for outer, *holes in band.polygons:
            assert metrics.signed_area(outer) > 0
            assert (outer[0] == outer[-1]).all()
            for hole in holes:
                assert metrics.signed_area(hole) < 0
                assert _inside(hole[0], outer)


def _inside(point, ring):
    """Whether a ray from a point crosses a ring an odd number of times."""
    (x, y), a, b = point, ring[:-1], ring[1:]
    spans = (a[:, 0] > x) != (b[:, 0] > x)
    a, b = a[spans], b[spans]
    return (a[:, 1] + (x - a[:, 0]) / (b[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1]) < y).sum() % 2


def test_bands_agree_with_contourpy():
    """Polygons and holes of a field with rings, on the refined samples."""
    from contourpy import FillType, contour_generator

    field = cf.fair_field(cases.ANALYTIC["marschner_lobb_slice"].samples())
    levels = np.linspace(0.25, 0.55, 4)
    fine = np.asarray(field.refine(16))
    peer = contour_generator(z=fine, fill_type=FillType.OuterOffset)
    for band in field.filled(levels, 1e-3):
        points, offsets = peer.filled(band.lower, band.upper)
        holes = sorted(len(offset) - 2 for offset in offsets)
        assert sorted(len(polygon) - 1 for polygon in band.polygons) == holes
        areas = -sum(
            metrics.signed_area(xy[a:b, ::-1])
            for xy, at in zip(points, offsets, strict=True)
            for a, b in pairwise(at)
        )
        assert band.area == pytest.approx(areas / 16**2, rel=2e-3)


def test_bands_stop_at_missing_samples():
    samples = cases.FIELDS["smooth_random"].samples((15, 14), np.random.default_rng(0))
    samples[[5, 9], [5, 9]] = np.nan  # cells without values that touch at a corner
    samples[2, 12] = np.nan
    field = cf.fair_field(samples)
    valid = np.isfinite(np.asarray(field.bounds()[0]))
    bands = field.filled([-np.inf, *inner_levels(samples), np.inf])
    assert sum(band.area for band in bands) == pytest.approx(valid.sum(), rel=1e-9)
    assert all(len(np.unique(ring[:-1], axis=0)) == len(ring) - 1 for ring in _rings(bands))


def _rings(bands):
    return [ring for band in bands for polygon in band.polygons for ring in polygon]


def test_a_band_around_all_values_is_the_grid():
    (band,) = field_of("cone").filled([-np.inf, np.inf])
    ((ring,),) = band.polygons
    assert len(ring) == 5
    assert "1 polygons" in repr(band)


def test_bands_are_a_sequence():
    bands = field_of("cone").filled([0.9, 0.3, 0.6])
    assert bands.levels == (0.3, 0.6, 0.9)
    assert [(band.lower, band.upper) for band in bands] == [(0.3, 0.6), (0.6, 0.9)]
    assert bands[0] is next(iter(bands))
    assert bands[:1] == (bands[0],)
    assert (len(bands), bands.unproved, bands.notes) == (2, 0, ())
    assert "2 bands" in repr(bands)


def test_bands_need_two_levels():
    with pytest.raises(ValueError, match="levels must be at least two"):
        field_of("cone").filled([0.5])
    with pytest.raises(ValueError, match="levels must be finite"):
        field_of("cone").filled([0.5, np.nan])
