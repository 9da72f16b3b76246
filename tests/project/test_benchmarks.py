"""The benchmarks' own arithmetic: fields, alignment of the peers, metrics, tables, rectangles.

And the ratios of times that must not get worse: against a straightforward program, against SciPy.
"""

import itertools
import json
import time
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import ndimage

import contourfair_jax as cf
from benchmarks import __main__ as suite
from benchmarks.common import clock, data, fields, metrics, peers, report
from benchmarks.common.inside import even_levels
from benchmarks.common.naive import fair_naively
from benchmarks.speed import upsampling
from benchmarks.speed.cost import waves
from benchmarks.speed.targets import fairing

EXACT = {**peers.SPLINES, **peers.OTHER_ENDS}
REFERENCE = {
    ("thin diagonal ridge 10x10", peers.LINEAR): (0.0699, 32),
    ("thin diagonal ridge 10x10", peers.CUBIC): (0.0330, 23),
    ("thin diagonal ridge 10x10", peers.QUINTIC): (0.0230, 20),
    ("oblique step 10x10", peers.CUBIC): (0.0197, 10),
    ("blurred disk 10x10", peers.QUINTIC): (0.0103, 10),
    ("cone 10x10", peers.CATMULL_ROM): (0.0052, 19),
    ("Franke 12x12", peers.CUBIC): (0.0019, 14),
}


def case(name):
    return next(c for c in (*fields.PLANE, fields.VOLUME) if c.name == name)


@pytest.mark.parametrize("tested", fields.PLANE, ids=lambda c: c.name)
def test_truth_contains_the_samples(tested):
    coarse = tested.truth()[:: tested.factor, :: tested.factor]
    np.testing.assert_allclose(coarse, tested.samples(), atol=1e-12)


def test_marschner_lobb_gradient_is_the_derivative():
    points = np.random.default_rng(0).uniform(-0.9, 0.9, (50, 3))
    step = 1e-6
    slopes = [
        (fields.marschner_lobb(*(points + e).T) - fields.marschner_lobb(*(points - e).T)) / 2 / step
        for e in step * np.eye(3)
    ]
    expected = fields.marschner_lobb_gradient(*points.T)
    np.testing.assert_allclose(np.stack(slopes, -1), expected, atol=1e-6)


@pytest.mark.parametrize("name", EXACT)
@pytest.mark.parametrize("shape", [(9, 7), (7, 8, 9)])
def test_peers_are_aligned_on_the_samples(name, shape):
    values = np.random.default_rng(1).standard_normal(shape)
    refined = EXACT[name](values, 1.0, 3)
    assert refined.shape == tuple(3 * (n - 1) + 1 for n in shape)
    np.testing.assert_allclose(refined[(slice(None, None, 3),) * len(shape)], values, atol=1e-10)


@pytest.mark.parametrize("name", EXACT)
def test_peers_keep_axes_in_order(name):
    x, y = np.meshgrid(np.arange(11.0), np.arange(9.0), indexing="ij")
    refined = EXACT[name](2.0 * x - 3.0 * y, 1.0, 2)
    middle = refined[8:13, 6:11]
    np.testing.assert_allclose(np.diff(middle, axis=0), 1.0, atol=0.1)
    np.testing.assert_allclose(np.diff(middle, axis=1), -1.5, atol=0.1)


def test_catmull_rom_at_points_agrees_with_the_grid():
    values = np.random.default_rng(2).standard_normal((8, 9))
    refined = peers.catmull_rom(values, 1.0, 4)
    found = peers.catmull_rom_at(values, np.array([[2.25, 3.5], [4.75, 5.0]]))
    np.testing.assert_allclose(found, [refined[9, 14], refined[19, 20]], atol=1e-12)


@pytest.mark.parametrize(("name", "method"), REFERENCE)
def test_reference_figures(name, method):
    tested = case(name)
    samples = tested.samples()
    refined = peers.SPLINES[method](samples, tested.spacing, tested.factor)
    rms, parts = REFERENCE[name, method]
    assert metrics.rms(refined - tested.truth()) == pytest.approx(rms, abs=6e-5)
    assert metrics.parts(refined, even_levels(samples)) == parts


def test_circle_turns_once_and_bends_like_a_circle():
    axis = np.arange(161) / 8.0 - 10.0
    shape = metrics.contour_shape(np.hypot(axis[:, None], axis[None, :]), 6.0, 8.0, 6.0)
    assert shape.turning == pytest.approx(1.0, abs=0.01)
    assert shape.bending == pytest.approx(1.0, abs=0.1)


def test_psnr_and_overshoot():
    truth = np.array([0.0, 1.0, 0.0, 1.0])
    assert metrics.psnr(truth + 0.1, truth) == pytest.approx(20.0)
    assert metrics.overshoot(np.array([-0.2, 1.1]), truth) == pytest.approx(0.2)
    assert metrics.overshoot(np.array([0.2, 0.9]), truth) == 0.0


@pytest.mark.parametrize("seed", range(5))
def test_largest_rectangle_against_all_rectangles(seed):
    valid = np.random.default_rng(seed).uniform(size=(7, 9)) < 0.7
    rows, columns = data.largest_rectangle(valid)
    assert valid[rows, columns].all()
    areas = [
        (b - a) * (d - c)
        for a in range(7)
        for b in range(a + 1, 8)
        for c in range(9)
        for d in range(c + 1, 10)
        if valid[a:b, c:d].all()
    ]
    assert (rows.stop - rows.start) * (columns.stop - columns.start) == max(areas)


def test_tables_replace_only_between_their_markers():
    text = "a\n<!-- table:one -->\nold\n<!-- end -->\nb\n<!-- table:two -->\n<!-- end -->\n"
    fresh = report.replace_tables(text, {"one": "new", "three": "nowhere"})
    assert fresh == text.replace("old", "new")
    assert report.replace_tables(fresh, {"one": "new"}) == fresh
    with pytest.raises(ValueError, match="table:one"):
        report.replace_tables("<!-- table:one -->", {"one": "new"})


def test_results_survive_the_round_trip(tmp_path):
    path = report.save("x", {"rows": [{"a": np.pi, "shape": (3, 4)}]}, tmp_path)
    stored = report.load("x", tmp_path)
    assert stored is not None
    assert stored["rows"] == [{"a": 3.14159, "shape": [3, 4]}]
    assert set(stored["machine"]) == {"processor", "cores", "python", "packages"}
    assert json.loads(path.read_text()) == stored
    assert report.load("y", tmp_path) is None


def test_table_cells():
    assert report.figure(0.01234) == ".0123"
    assert report.figure(None) is None
    assert report.bold_least(["1", "2", None], [1.0, 2.0, None]) == ["**1**", "2", None]
    assert report.table(["a", "b"], [["x", None]]).splitlines()[-1] == "| x | – |"


def test_smoothed_lines_cross_and_contours_do_not():
    pytest.importorskip("shapely")
    from benchmarks.quality import robustness

    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]])
    assert robustness.crossings([(0.0, square), (1.0, square + 0.5)]) == 1
    assert robustness.crossings([(0.0, square), (1.0, square + 2.0)]) == 0
    assert robustness.crossings([(0.0, square), (0.0, square + 0.5)]) == 0


@pytest.mark.data
def test_real_field_scores():
    from benchmarks.quality import real

    field = data.load(data.PLANE, "sea-level pressure")
    if field is None:
        pytest.skip("the folder of real data sets is missing")
    row = real.score(field, dict(peers.SPLINES))
    assert row["shape"] == [21, 35]
    assert real.best_peer(row["methods"])[0] == peers.CATMULL_ROM
    assert row["methods"][peers.CATMULL_ROM]["psnr"] == pytest.approx(33.19, abs=0.01)


@pytest.mark.data
@pytest.mark.parametrize("name", [*data.PLANE, *data.SURFACE])
def test_real_fields_load(name):
    field = data.load(data.PLANE | data.SURFACE, name)
    if field is None:
        pytest.skip("the folder of real data sets is missing")
    assert np.isfinite(field.values).all()
    assert field.values.ndim == len(field.spacing) == (2 if name in data.PLANE else 3)
    assert min(field.values.shape) >= 21


def test_what_takes_times_runs_alone_and_before_what_does_not(monkeypatch, tmp_path):
    at_once, most, ran = [], [], []

    def run(command, check):
        at_once.append(command)
        most.append((command[3], len(at_once)))
        time.sleep(0.02)
        at_once.remove(command)
        ran.append(command[3])

    monkeypatch.setattr(suite.subprocess, "run", run)
    readme = tmp_path / "README.md"
    monkeypatch.setattr(suite, "DOCUMENTS", (readme,))
    monkeypatch.setattr(suite.upsampling, "PICTURE", tmp_path / "upsampling.png")
    readme.write_text("no tables\n")
    suite.run_all(quiet=True)
    shared = {name for name, benchmark in suite.BENCHMARKS.items() if benchmark.shared}
    assert sorted(ran) == sorted(set(suite.BENCHMARKS) - {"gpu"})
    assert not shared & set(ran[: -len(shared)])
    assert all(count == 1 for name, count in most if name not in shared)


def test_picture_of_times():
    times = {"local": {"64": 0.1, "128": 0.4}, upsampling.ZOOM: {"64": 0.2}}
    (axes,) = upsampling.draw({"factor": 4, "seconds": times}).axes
    drawn = {line.get_label(): line.get_xydata().tolist() for line in axes.get_lines()}
    assert drawn == {
        "local": [[4096, 0.1], [16384, 0.4]],
        upsampling.ZOOM: [[4096, 0.2]],
    }


def test_a_ratio_does_not_depend_on_the_drift_of_the_machine(monkeypatch):
    slowness = itertools.count(1)
    monkeypatch.setattr(clock, "ready", lambda seconds: seconds() * 1.1 ** next(slowness))
    assert clock.ratio(lambda: 2.2, lambda: 1.0, repeats=5) == pytest.approx(2)


def test_a_ratio_of_long_runs_takes_one_round(monkeypatch):
    ran = []
    monkeypatch.setattr(clock, "ready", lambda seconds: ran.append(seconds()) or ran[-1])
    assert clock.ratio(lambda: 30.0, lambda: 10.0, budget=20.0) == 3
    assert ran == [30.0, 10.0]


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in upsampling.NAMES if name != upsampling.GMT])
def test_what_is_timed_is_a_finer_grid(name):
    values = waves((9, 9))
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):  # interpax
        finer = np.asarray(upsampling.delivery(name, values)())
    assert finer.size >= 33**2
    assert abs(finer).max() < 2


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(7, 6), (4, 3, 5)])
def test_the_straightforward_program_is_local_fairing(shape):
    values = jnp.asarray(waves(shape))
    net = cf.fair_field(values).control_points
    np.testing.assert_allclose(fair_naively(values), net, atol=2e-5)


@pytest.mark.slow
def test_local_fairing_stays_ahead_of_a_straightforward_program():
    values = jnp.asarray(waves((64, 64)))
    naive = partial(fair_naively.lower(values).compile(), values)
    fair = fairing((64, 64), cf.LocalFairing()).run
    assert clock.ratio(naive, fair) > 10


@pytest.mark.slow
def test_global_fairing_keeps_up_with_a_cubic_zoom():
    values = waves((512, 512))
    fair = fairing((512, 512), cf.GlobalFairing(tolerance=1e-3)).run
    assert clock.ratio(fair, lambda: ndimage.zoom(values, 4, order=3)) < 5
