"""Metrics against closed forms, brute force and planted faults."""

import cases
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import samples_of
from splines import catmull_rom

import contourfair_jax as cf
from contourfair_jax import metrics
from contourfair_jax._field import BezierField
from contourfair_jax.contours import ContourLine
from contourfair_jax.metrics import bilinear_field
from contourfair_jax.metrics._parts import components
from contourfair_jax.metrics._surfaces import crease_bending
from contourfair_jax.plot._metrics import metrics_figure

GRID = cases.GRIDS[2][1]


def line(*points, level=0.0):
    points = np.array(points, dtype=float)
    return ContourLine(level, points, bool((points[0] == points[-1]).all()))


@pytest.fixture(scope="module")
def bowl():
    """`x^2 + y^2` on [-1, 1]^2, exactly, as one cell."""
    square = np.array([1, -1 / 3, -1 / 3, 1])
    net = square[:, None] + square[None, :]
    return BezierField(jnp.asarray(net), jnp.full(2, 2.0), jnp.full(2, -1.0))


# Crossings ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lines", "count"),
    [
        ([line((0, 0), (1, 1)), line((0, 1), (1, 0))], 1),
        ([line((0, 0), (1, 0)), line((0, 1), (1, 1))], 0),
        ([line((0, 0), (2, 0)), line((1, 0), (1, 1))], 1),  # touches
        ([line((0, 0), (2, 0)), line((1, 0), (3, 0))], 1),  # overlaps
        ([line((0, 0), (2, 0)), line((3, 0), (4, 0))], 0),  # on one straight line, apart
        ([line((0, 0), (2, 2), (2, 0), (0, 2))], 1),  # with itself
        ([line((0, 0), (1, 0), (1, 1), (0, 0))], 0),  # a loop's neighbours share vertices
        ([line((0, 0), (1, 0), (1, 1), (0, 0)), line((0.5, -1), (0.5, 2))], 2),
        ([line((0, 0), (100, 100)), line((0, 1e-9), (100, 100 + 1e-9))], 0),
        ([line((5e6, 4e5), (5e6 + 1, 4e5 + 1)), line((5e6, 4e5 + 1), (5e6 + 1, 4e5))], 1),
        ([], 0),
    ],
)
def test_planted_crossings(lines, count):
    assert metrics.crossings(lines) == count


def test_crossings_of_random_lines_agree_with_all_pairs(rng):
    lines = [
        line(*np.cumsum(rng.normal(size=(rng.integers(2, 25), 2)) * 10.0 ** rng.uniform(-2, 1), 0))
        for _ in range(40)
    ]
    segments = [(k, i, *at[i : i + 2]) for k, at in enumerate(x.points for x in lines)
                for i in range(len(at) - 1)]  # fmt: skip
    count = 0
    for n, (k, i, a, b) in enumerate(segments):
        for m, j, p, q in segments[:n]:
            if k == m and abs(i - j) == 1:
                continue
            count += _cross(a, b, p) != _cross(a, b, q) and _cross(p, q, a) != _cross(p, q, b)
    assert count > 50
    assert metrics.crossings(lines) == count


def _cross(a, b, p):
    return (b[0] - a[0]) * (p[1] - a[1]) > (b[1] - a[1]) * (p[0] - a[0])


def test_a_shifted_vertex_is_found():
    field = catmull_rom(cases.ANALYTIC["marschner_lobb_slice"].samples())
    lines = list(field.contours(np.linspace(0.2, 0.6, 9)))
    assert metrics.crossings(lines) == 0
    longest = int(np.argmax([len(each.points) for each in lines]))
    points = lines[longest].points.copy()
    points[len(points) // 2] += 4.0
    lines[longest] = ContourLine(lines[longest].level, points, lines[longest].closed)
    assert metrics.crossings(lines) > 0


# Levels ------------------------------------------------------------------------------------


def test_a_circle(bowl):
    lines = bowl.contours([0.25, 0.64], 1e-5)
    small, large = metrics.level_metrics(lines, 0.02)
    for each, radius in ((small, 0.5), (large, 0.8)):
        assert each.length == pytest.approx(2 * np.pi * radius, rel=1e-3)
        assert each.turning == pytest.approx(2 * np.pi, rel=1e-9)
        assert each.bending == pytest.approx(2 * np.pi / radius, rel=2e-2)
        assert (each.components, each.holes) == (1, 1)


def test_an_open_line_and_a_kink():
    (each,) = metrics.level_metrics([line((0, 0), (1, 0), (1, 1))], 0.25)
    assert each.length == 2
    assert each.turning == pytest.approx(np.pi / 2)
    assert each.bending == pytest.approx((np.pi / 2) ** 2 / 0.25)
    assert (each.components, each.holes) == (1, 0)


def test_summits_are_no_holes():
    counter_clockwise = line((0, 0), (1, 0), (1, 1), (0, 0))
    clockwise = line((0, 0), (1, 1), (1, 0), (0, 0), level=1.0)
    below, above = metrics.level_metrics([counter_clockwise, clockwise], 0.1)
    assert (below.holes, above.holes) == (0, 1)


def test_levels_without_lines_are_zero(bowl):
    (each,) = metrics.level_metrics(bowl.contours(9.0), 0.1, [9.0])
    assert (each.level, each.length, each.components) == (9.0, 0.0, 0)
    assert metrics.level_metrics([], 0.1) == []
    first, second = metrics.level_metrics([line((0, 0), (1, 0), level=2.0)], 0.1, [1.0, 2.0])
    assert (first.length, second.length) == (0.0, 1.0)


@pytest.mark.parametrize("level", [0.5, 1.5, 3.0])
def test_lines_of_other_levels_are_left_out(level):
    lines = [line((0, 0), (1, 0), level=2.0), line((0, 1), (5, 1), level=level)]
    found = metrics.level_metrics(lines, 0.1, [1.0, 2.0])
    assert [each.length for each in found] == [0.0, 1.0]
    assert [each.components for each in found] == [0, 1]
    assert metrics.level_metrics(lines[1:], 0.1, [1.0])[0].length == 0


def test_step_is_checked():
    with pytest.raises(ValueError, match="step must be a length above zero"):
        metrics.level_metrics([], 0.0)


def test_a_picture_of_metrics_has_whole_counts_and_shows_curves_that_are_equal():
    tables = {name: [(1.5, 2), (2.5, 3)] for name in ("bilinear", "fair")}
    for ax, whole in zip(
        metrics_figure([0, 1], ("length", "parts"), tables).axes, (False, True), strict=True
    ):
        assert all(tick % 1 == 0 for tick in ax.get_yticks()) == whole
        below, above = ax.lines
        assert below.get_linewidth() > 2 * above.get_linewidth()


# All levels --------------------------------------------------------------------------------


def test_a_speck_that_bends_without_end_does_not_hide_the_others():
    levels = [0, 1, 2, 3]
    for largest, scale in ((3.5, "linear"), (1e9, "log")):
        table = {"fair": [(1.5,), (2.5,), (largest,), (1.25,)]}
        (axes,) = metrics_figure(levels, ("bending",), table).axes
        assert axes.get_yscale() == scale


def test_coarea_of_a_bowl(bowl):
    """`|k| |grad f| = 2`, and `|grad f| = 2 r`."""
    found = metrics.coarea(bowl, order=8)
    assert found.turning == pytest.approx(8.0, rel=1e-12)
    # The integral of r over the square of side 2.
    radius = 4 / 3 * (np.sqrt(2) + np.arcsinh(1.0))
    assert found.length == pytest.approx(2 * radius, rel=2e-3)


def test_coarea_is_the_sum_over_levels():
    field = catmull_rom(cases.ANALYTIC["franke"].samples(), np.array([0.5, 0.7]), 1.0)
    low, high = np.min(field.samples), np.max(field.samples)
    levels = low + (high - low) * (np.arange(200) + 0.5) / 200
    lines = metrics.level_metrics(field.contours(levels, 1e-4), 0.05, levels.tolist())
    found = metrics.coarea(field)
    width = (high - low) / len(levels)
    assert sum(each.length for each in lines) * width == pytest.approx(found.length, rel=0.01)
    assert sum(each.turning for each in lines) * width == pytest.approx(found.turning, rel=0.03)


def test_coarea_leaves_missing_samples_out(bowl):
    net = np.asarray(bowl.control_points)
    wide = np.concatenate([net[:-1], np.full((4, 4), np.nan)])
    wide[3] = net[3]
    beside = BezierField(jnp.asarray(wide), bowl.spacing, bowl.origin)
    assert metrics.coarea(beside).length == pytest.approx(metrics.coarea(bowl).length)


def radii(low, high, size):
    """Distances from the origin on a cube away from it, and the field of them."""
    x = np.linspace(low, high, size)
    samples = np.sqrt(x[:, None, None] ** 2 + x[:, None] ** 2 + x**2)
    return catmull_rom(samples, (high - low) / (size - 1), low)


def test_coarea_of_spheres():
    """Of `|x|^2` on [1, 2]^3, exactly, as one cell: `|grad f| = 2 r` and H = 1 / r."""
    square = np.array([1, 5 / 3, 8 / 3, 4])
    net = square[:, None, None] + square[:, None] + square
    field = BezierField(jnp.asarray(net), jnp.ones(3), jnp.ones(3))
    at, weights = np.polynomial.legendre.leggauss(12)
    at, weights = 1.5 + at / 2, weights / 2
    radius = np.sqrt(at[:, None, None] ** 2 + at[:, None] ** 2 + at**2)
    found = metrics.coarea(field, order=6)
    area, bending = (np.einsum("ijk,i,j,k", q, *[weights] * 3) for q in (2 * radius, 2 / radius))
    assert [found.area, found.bending] == pytest.approx([area, bending], rel=1e-8)


def test_coarea_of_a_shell():
    """Of cells between two spheres: the integral over their levels of 4 pi r^2, and of 4 pi."""
    field = radii(-1.0, 1.0, 41)
    inner, outer = 0.3, 0.95

    def between(low, high):
        net = np.asarray(field.control_points)
        low_cell, high_cell = (np.asarray(bound) for bound in field.bounds())
        left_out = (low_cell < low) | (high_cell > high)
        for axis in range(3):
            left_out = left_out.repeat(3, axis)
        kept = net.copy()
        kept[:-1, :-1, :-1][left_out] = np.nan
        return BezierField(jnp.asarray(kept), field.spacing, field.origin)

    shell = between(inner, outer)
    sums = metrics.coarea(shell)
    inside = np.isfinite(np.asarray(shell.bounds()[0]))
    centres = np.linspace(-0.975, 0.975, 40)
    radius = np.sqrt(centres[:, None, None] ** 2 + centres[:, None] ** 2 + centres**2)[inside]
    assert sums.area == pytest.approx(inside.sum() * 0.05**3, rel=1e-3)
    assert sums.bending == pytest.approx((0.05**3 / radius**2).sum(), rel=2e-2)
    # Most of what lies between the spheres is in these cells.
    assert 0.7 < sums.area / (4 / 3 * np.pi * (outer**3 - inner**3)) < 1
    assert 0.7 < sums.bending / (4 * np.pi * (outer - inner)) < 1


def test_coarea_of_volumes_is_the_sum_over_levels():
    x = np.linspace(-1, 1, 9)
    samples = np.exp(-(x[:, None, None] ** 2) - 1.5 * x[:, None] ** 2 - 0.5 * x**2)
    field = catmull_rom(samples, np.array([0.5, 0.6, 0.7]), 1.0)
    low, high = float(samples.min()), float(samples.max())
    levels = low + (high - low) * (np.arange(40) + 0.5) / 40
    each = [metrics.surface_metrics(field.isosurface(level, 0.02)) for level in levels.tolist()]
    found = metrics.coarea(field)
    width = (high - low) / len(levels)
    assert sum(one.area for one in each) * width == pytest.approx(found.area, rel=0.01)
    assert sum(one.bending for one in each) * width == pytest.approx(found.bending, rel=0.03)


def test_coarea_works_in_slabs(bowl, monkeypatch):
    fields = catmull_rom(samples_of("noise", GRID)), radii(0.0, 1.0, 5)
    whole = metrics.coarea(fields[0]), metrics.coarea(fields[1])
    monkeypatch.setattr("contourfair_jax.metrics._coarea._POINTS", 1)
    parts = metrics.coarea(fields[0]), metrics.coarea(fields[1])
    for one, other in zip(whole, parts, strict=True):
        assert list(vars(one).values()) == pytest.approx(list(vars(other).values()), rel=1e-12)


def test_coarea_of_lines_and_surfaces(bowl):
    assert isinstance(metrics.coarea(bowl), metrics.Coarea)
    assert isinstance(metrics.coarea(radii(0.0, 1.0, 4)), metrics.SurfaceCoarea)


# Overshoot and jumps -----------------------------------------------------------------------


@pytest.mark.parametrize("ndim", [2, 3])
@pytest.mark.parametrize("name", ["noise", "sharp_step", "constant", "plane"])
def test_overshoot_is_that_of_dense_samples(name, ndim):
    grid = cases.GRIDS[ndim][0]
    samples = samples_of(name, grid)
    field = catmull_rom(samples)
    fine = np.asarray(field.refine(16))
    span = np.ptp(samples) or 1.0
    dense = max(samples.min() - fine.min(), fine.max() - samples.max(), 0.0) / span
    found = metrics.overshoot(field)
    assert dense - 1e-9 <= found <= dense + 0.01


def test_c1_jump_is_rounding_when_fair_and_not_when_bilinear():
    field = cf.fair_field(samples_of("noise", GRID), spacing=GRID.spacing)
    assert metrics.c1_jump(field) < 1e-13
    assert metrics.c1_jump(bilinear_field(field)) > 0.1
    flat = BezierField(jnp.zeros((7, 7)), jnp.ones(2), jnp.zeros(2))
    assert metrics.c1_jump(flat) == 0


def test_overshoot_of_missing_samples():
    field = BezierField(jnp.full((7, 7), jnp.nan), jnp.ones(2), jnp.zeros(2))
    assert metrics.overshoot(field) == 0
    lonely = field.control_points.at[3, 3].set(1.0).at[6, 6].set(2.0)  # samples without a cell
    assert metrics.overshoot(BezierField(lonely, jnp.ones(2), jnp.zeros(2))) == 0


# Comparison --------------------------------------------------------------------------------


def test_components_follow_the_bilinear_interpolant():
    samples = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    assert components(samples, 0.4).max() == 0
    assert components(samples, 0.6).max() == 2
    assert (components(samples, 0.6) >= 0).sum() == 3
    assert components(samples, 2.0).max() == -1


@pytest.mark.parametrize("level", [-0.5, 0.0, 0.7])
def test_components_agree_with_a_fine_grid(level, rng):
    from scipy.ndimage import label, zoom

    samples = rng.normal(size=(12, 11))
    fine = zoom(samples, 64, order=1, grid_mode=False)
    truth = label(fine > level)[0]
    at = np.ix_(*(np.linspace(0, n - 1, k).round().astype(int)
                  for n, k in zip(truth.shape, samples.shape, strict=True)))  # fmt: skip
    truth, found = truth[at] - 1, components(samples, level)
    assert len(np.unique(np.stack([truth.ravel(), found.ravel()]), axis=1).T) == len(
        np.unique(found)
    )


def test_components_of_volumes_agree_with_a_fine_grid():
    """Cell by cell; of every other one two opposite corners meet, if at all, in the middle."""
    from scipy.ndimage import label

    rng = np.random.default_rng(0)  # of other cells a finer grid may be needed
    at = np.linspace(0, 1, 41)
    weights = np.stack([1 - at, at], axis=1)
    meetings = 0
    for trial in range(200):
        corners = rng.normal(size=(2, 2, 2)) * rng.uniform(0.05, 1, size=(2, 2, 2))
        if trial % 2:
            corners = -np.abs(corners)
            corners[0, 0, 0], corners[1, 1, 1] = rng.uniform(0.2, 1.5, 2)
        fine = np.einsum("ai,bj,ck,ijk->abc", *[weights] * 3, corners)
        truth, found = label(fine > 0)[0][::40, ::40, ::40] - 1, components(corners + 7, 7.0)
        both = np.unique(np.stack([truth.ravel(), found.ravel()]), axis=1)
        assert len(both.T) == len(np.unique(found)) == len(np.unique(truth))
        meetings += trial % 2 and found.max() == 0
    assert 10 < meetings < 90


@pytest.mark.slow
def test_a_thin_ridge_is_joined():
    case = cases.ANALYTIC["ridge"]
    found = metrics.compare(cf.fair_field(case.samples(), spacing=case.spacing, origin=-1.0))
    plain, fair = (sum(each.components for each in side) for side in (found.bilinear, found.fair))
    assert plain > fair
    merged = [change for change in found.changes if change.kind == "merged"]
    assert any(change.side == "above" and change.parts > 1 for change in merged)
    assert all(np.abs(change.position).max() <= 1 for change in merged)
    assert str(merged[0]) in str(found)


@pytest.mark.slow
@pytest.mark.parametrize("method", [cf.LocalFairing(), cf.GlobalFairing()])
def test_both_fields_are_compared_in_the_same_cells(method):
    x = np.linspace(-1, 1, 12)
    plane = x[:, None] + 0.5 * x
    plane[5, 5] = plane[9, 0] = np.nan
    found = metrics.compare(cf.fair_field(plane, method=method), [0.0, 0.3])
    for plain, fair in zip(found.bilinear, found.fair, strict=True):
        assert plain.length == pytest.approx(fair.length, rel=1e-5)
        assert (plain.components, plain.holes) == (fair.components, fair.holes)
    assert found.changes == ()


def test_a_bilinear_field_is_nan_where_the_fair_one_is():
    samples = samples_of("noise", GRID)
    samples[4:6, 3] = np.nan
    field = cf.fair_field(samples)
    plain, fair = (np.isnan(np.asarray(f.bounds()[0])) for f in (bilinear_field(field), field))
    np.testing.assert_array_equal(plain, fair)
    assert fair.sum() > 6


def test_a_comparison_prints_a_table():
    text = str(metrics.compare(cf.fair_field(samples_of("cone", GRID)), [0.4, 0.6]))
    assert len(text.splitlines()) == 4
    assert "bilinear" in text
    assert "places merged: 0, split: 0" in text


def test_samples_are_compared_as_before():
    """As `compare` was called formerly, with settings of `fair_field`."""
    samples = samples_of("cone", GRID)
    expected = metrics.compare(cf.fair_field(samples, spacing=0.5), [0.4, 0.6])
    for given in ({}, {"values": samples}):
        with pytest.warns(DeprecationWarning, match=r"use compare\(fair_field\(values"):
            found = metrics.compare(
                *(() if given else (samples,)), levels=[0.4, 0.6], spacing=0.5, **given
            )
        assert found == expected


@pytest.mark.slow
def test_a_thin_rod_is_joined():
    """A rod across a volume, oblique: trilinear interpolation tears it into beads."""
    x = np.linspace(-1, 1, 9)
    across = np.stack(
        [x[:, None, None] - 0.8 * x + 0 * x[:, None], x[:, None] + 0.5 * x + 0 * x[:, None, None]]
    )
    samples = np.exp(-((5 * across) ** 2).sum(0))
    found = metrics.compare(cf.fair_field(samples, spacing=0.25, origin=-1.0), [0.3, 0.45, 0.6])
    plain, fair = (sum(each.components for each in side) for side in (found.bilinear, found.fair))
    assert plain > fair
    merged = [change for change in found.changes if change.kind == "merged"]
    assert any(change.side == "above" and change.parts > 1 for change in merged)
    assert all(
        np.abs(change.position).max() <= 1 and len(change.position) == 3 for change in merged
    )
    text = str(found).splitlines()
    assert text[0].split() == ["area", "bending/4pi", "parts", "Euler"]
    assert [row.split()[0] for row in text[1:3]] == ["trilinear", "fair"]
    assert str(merged[0]) in str(found)


@pytest.mark.slow
def test_volumes_are_compared_in_the_same_cells():
    x = np.linspace(-1, 1, 7)
    plane = x[:, None, None] + 0.5 * x[:, None] + 0.2 * x
    plane[2, 3, 3] = plane[5, 0, 6] = np.nan
    found = metrics.compare(cf.fair_field(plane), [0.1])
    (plain,), (fair,) = found.bilinear, found.fair
    assert plain.area == pytest.approx(fair.area, rel=1e-5)
    assert plain.euler_characteristic == fair.euler_characteristic
    assert [plain.bending, fair.bending] == pytest.approx([0, 0], abs=1e-9)
    assert found.changes == ()


def test_creases_of_a_roof():
    """Two planes that meet in a face, at an angle: the length of the ridge is 4 cells of 0.5."""
    samples = np.repeat(np.repeat(-np.abs(np.arange(5.0) - 2)[:, None, None], 5, 1), 5, 2)
    samples = samples + np.arange(5.0)[:, None]
    field = cf.fair_field(samples, spacing=0.5)
    kinked = bilinear_field(field)
    expected = (np.pi / 2) ** 2 * 2 / (4 * 0.1)
    assert crease_bending(kinked, 1.3, 0.1) == pytest.approx(expected, rel=1e-6)
    assert crease_bending(kinked, 9.0, 0.1) == 0
    assert crease_bending(field, 1.3, 0.1) < 1e-12


REAL = ("Maunga Whau terrain", "Olinda terrain", "Luxembourg terrain", "sea-surface temperature")


@pytest.mark.data
@pytest.mark.slow
def test_no_lines_cross_on_real_data(shared_data):
    """Integers, plateaus and missing samples; `benchmarks contours` does all data sets."""
    from benchmarks.quality import contours

    seen = 0
    for name, samples in contours.raw_fields(shared_data):
        if name in REAL:
            field = cf.fair_field(samples)
            for kind in contours.KINDS:
                lines = field.contours(contours.levels_of(samples, kind))
                assert metrics.crossings(lines) == 0, name
                assert lines.unproved == 0, name
                seen += len(lines) > 10
    assert seen == 2 * len(REAL)
