"""Isosurfaces: on the field, watertight, oriented, within tolerance."""

import json

import jax.numpy as jnp
import numpy as np
import pytest
from shape_checks import refused
from splines import catmull_rom

import contourfair_jax as cf
from contourfair_jax import metrics
from contourfair_jax._field import BezierField
from contourfair_jax.isosurface import isosurface
from contourfair_jax.isosurface._mesh import edges_of

N = 12


def axes(n=N):
    """Coordinates of n^3 points of [-1, 1]^3."""
    x = np.linspace(-1, 1, n)
    return np.meshgrid(x, x, x, indexing="ij")


def on_cube(samples, n=N):
    """A field on [-1, 1]^3."""
    return catmull_rom(samples, 2 / (n - 1), -1.0)


def ball(n=N):
    """The squared distance from the centre."""
    return on_cube(sum(x * x for x in axes(n)), n)


def waves():
    """A surface that meets the border everywhere."""
    x, y, z = axes()
    return on_cube(np.sin(3 * x + 0.3) + np.cos(4 * y) * np.sin(3 * z))


def noise(shape=(8, 9, 10)):
    return catmull_rom(np.random.default_rng(0).normal(size=shape))


def dense(field, points):
    """Value and gradient; padded, so that one number of points is compiled."""
    padded = np.zeros((-len(points) % 8192 + len(points), 3))
    padded[: len(points)] = points
    value, gradient, _ = field.jet(jnp.asarray(padded), outside="clamp")
    return np.asarray(value)[: len(points)], np.asarray(gradient)[: len(points)]


def across(mesh):
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    return np.cross(b - a, c - a)


def assert_manifold(mesh, field):
    """Edges have two triangles that pass them opposite ways, or one and lie on the border."""
    edges = edges_of(mesh.triangles)
    assert set(np.unique(edges.faces)) <= {1, 2}
    directed = np.concatenate([mesh.triangles[:, [k, (k + 1) % 3]] for k in range(3)])
    assert len(np.unique(directed, axis=0)) == len(directed)
    low = np.asarray(field.origin)
    high = low + np.asarray(field.spacing) * (np.array(field.shape) - 1)
    first, last = np.moveaxis(mesh.vertices[edges.ends[edges.faces == 1]], 1, 0)
    near = 1e-12 * np.abs(high - low)
    assert (
        ((abs(first - last) <= near) & ((first <= low + near) | (first >= high - near)))
        .any(1)
        .all()
    )
    assert np.array_equal(np.unique(mesh.triangles), np.arange(len(mesh.vertices)))


@pytest.mark.parametrize(
    ("build", "level"), [(ball, 0.36), (ball, 1.3), (waves, 0.0), (noise, 0.3), (noise, -1.0)]
)
def test_vertices_lie_on_the_field_and_edges_have_two_triangles(build, level):
    field = build()
    mesh = field.isosurface(level, 0.03)
    assert_manifold(mesh, field)
    value, gradient = dense(field, mesh.vertices)
    assert np.abs(value - level).max() <= 1e-9 * np.ptp(np.asarray(field.samples))
    unit = gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
    np.testing.assert_allclose(mesh.normals, unit, atol=1e-9)


@pytest.mark.parametrize(("build", "level"), [(ball, 0.36), (ball, 1.3), (waves, 0.0)])
def test_triangles_turn_left_around_the_gradient(build, level):
    mesh = build().isosurface(level)
    facing = across(mesh) * mesh.normals[mesh.triangles].sum(1)
    assert (facing.sum(1) > 0).all()


def test_ball_has_its_area_volume_and_curvatures():
    mesh, radius = ball().isosurface(0.36, 1e-3), 0.6
    assert mesh.watertight
    assert mesh.euler_characteristic == 2
    assert mesh.area == pytest.approx(4 * np.pi * radius**2, rel=2e-3)
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * radius**3, rel=2e-3)
    np.testing.assert_allclose(mesh.mean_curvature, 1 / radius, rtol=0.05)
    np.testing.assert_allclose(mesh.gaussian_curvature, 1 / radius**2, rtol=0.1)
    found = metrics.surface_metrics(mesh)
    assert found.bending == pytest.approx(4 * np.pi, rel=1e-2)
    assert (found.components, found.euler_characteristic, found.watertight) == (1, 2, True)


def test_volume_around_larger_values_is_negative():
    field = ball()
    upside_down = BezierField(-field.control_points, field.spacing, field.origin)
    found = upside_down.isosurface(-0.36).volume
    assert found == pytest.approx(-field.isosurface(0.36).volume, rel=1e-6)


def test_curvatures_of_a_cylinder_and_of_a_saddle():
    x, y, z = axes()
    mesh = on_cube(x**2 + y**2).isosurface(0.36)
    np.testing.assert_allclose(mesh.mean_curvature, 0.5 / 0.6, rtol=0.05)
    np.testing.assert_allclose(mesh.gaussian_curvature, 0, atol=1e-6)
    saddle = on_cube(z - (x**2 - y**2) / 2).isosurface(1e-3)
    middle = np.argmin(np.linalg.norm(saddle.vertices, axis=1))
    assert saddle.gaussian_curvature[middle] == pytest.approx(-1, abs=0.15)


@pytest.mark.slow
def test_curvature_is_that_of_the_field_with_other_spacing():
    field = catmull_rom(np.random.default_rng(3).normal(size=(6, 7, 5)), (1.0, 0.5, 3.0), 100.0)
    mesh = field.isosurface(0.1, 0.1)
    cells = (mesh.vertices - np.asarray(field.origin)) / np.asarray(field.spacing)
    within = np.abs(cells - np.rint(cells)).min(1) > 1e-6  # Hessians jump on faces of cells.
    expected = np.asarray(field.mean_curvature(jnp.asarray(mesh.vertices)))
    assert within.sum() > 100
    scale = 1 + np.abs(expected[within])
    assert (np.abs(mesh.mean_curvature[within] - expected[within]) <= 1e-6 * scale).mean() > 0.999


@pytest.mark.parametrize(
    ("level", "parts", "euler"), [(0.24, 2, 4), (0.26, 1, 2)], ids=["apart", "joined"]
)
def test_two_balls_that_touch(level, parts, euler):
    x, y, z = axes(15)
    lemniscate = ((x - 0.5) ** 2 + y**2 + z**2) * ((x + 0.5) ** 2 + y**2 + z**2)
    touching = on_cube(np.sqrt(lemniscate), 15).isosurface(level)
    assert touching.watertight
    found = metrics.surface_metrics(touching)
    assert (found.components, found.euler_characteristic) == (parts, euler)


def test_torus():
    x, y, z = axes(16)
    field = on_cube(np.hypot(np.hypot(x, y) - 0.55, z), 16)
    mesh = field.isosurface(0.25)
    assert mesh.watertight
    assert mesh.euler_characteristic == 0
    assert mesh.area == pytest.approx(4 * np.pi**2 * 0.55 * 0.25, rel=0.05)


def test_blocks_join():
    """A surface through many blocks of cells, with the level at samples."""
    x = np.arange(36.0)
    field = catmull_rom(x[:, None, None] + np.sin(x[:, None]) + np.cos(x) + np.zeros((36, 1, 1)))
    mesh = field.isosurface(17.0, 0.1)
    assert_manifold(mesh, field)
    assert mesh.euler_characteristic == 1


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [0.1, 0.01, 1e-3])
def test_triangles_keep_to_the_tolerance(tolerance):
    field = waves()
    mesh = field.isosurface(0.1, tolerance)
    weights = np.random.default_rng(0).dirichlet(np.ones(3), len(mesh.triangles))
    points = np.einsum("nk,nkc->nc", weights, mesh.vertices[mesh.triangles])
    value, gradient = dense(field, points)
    off = np.abs(value - 0.1) / np.linalg.norm(gradient, axis=1) / float(field.spacing[0])
    # Edges that may miss the tolerance are counted, and each belongs to two triangles.
    assert np.count_nonzero(off > tolerance) <= 2 * mesh.unmet
    assert mesh.unmet <= len(mesh.triangles) / 1000
    assert ("take a larger tolerance, or finer samples" in " ".join(mesh.notes)) == (mesh.unmet > 0)


def test_surface_ends_at_cells_without_values():
    samples = np.array(np.asarray(ball().samples))
    samples[7, 6, 5] = np.nan
    field = cf.BezierField(
        jnp.where(jnp.isnan(on_cube(samples).control_points), jnp.nan, ball().control_points),
        jnp.full(3, 2 / 11),
        jnp.full(3, -1.0),
    )
    mesh = field.isosurface(0.02, 0.03)
    whole = ball().isosurface(0.02, 0.03)
    assert 0 < len(mesh.triangles) < len(whole.triangles)
    assert not mesh.watertight
    assert np.isnan(mesh.volume)
    assert np.isfinite(mesh.vertices).all()
    assert np.isfinite(mesh.mean_curvature).all()
    edges = edges_of(mesh.triangles)
    assert edges.faces.max() == 2
    first, last = np.moveaxis((mesh.vertices[edges.ends[edges.faces == 1]] + 1) * 5.5, 1, 0)
    on_plane = (np.abs(first - np.rint(first)) < 1e-9) & (np.abs(first - last) < 1e-9)
    assert on_plane.any(1).all()


def test_progress_is_told():
    told = []
    isosurface(ball(), 0.36, 0.01, progress=lambda done, total: told.append(done / total))
    assert told[0] == 0
    assert told == sorted(told)
    assert 0.9 < told[-1] <= 1


@pytest.mark.parametrize("level", [-5.0, 9.0])
def test_a_level_that_the_field_does_not_have(level):
    mesh = ball().isosurface(level)
    assert mesh.vertices.shape == (0, 3)
    assert mesh.triangles.shape == (0, 3)
    assert mesh.normals.shape == (0, 3)
    assert mesh.mean_curvature.shape == (0,)
    assert (mesh.area, mesh.volume, mesh.euler_characteristic) == (0.0, 0.0, 0)
    assert any("no surface" in note for note in mesh.notes)
    assert metrics.surface_metrics(mesh).components == 0


def tiny_ball(centre=(0.1, 0.07, 0.13)):
    """The squared distance from a place between the samples, a quarter of a unit apart."""
    squared = sum((x - c) ** 2 for x, c in zip(axes(9), centre, strict=True))
    return on_cube(squared, 9)


@pytest.mark.parametrize(
    ("field", "radius", "whole"),
    [
        (tiny_ball(), 0.05, 1),
        (tiny_ball(), 0.01, 1),
        (tiny_ball((0.1, 0.25, 0.13)), 0.05, 1),  # across the face of a cell
        (tiny_ball((0.1, -1.0, 0.13)), 0.05, 0.5),  # at the border of the grid
    ],
)
def test_parts_between_the_points_of_the_lattice(field, radius, whole):
    mesh = field.isosurface(radius**2, 0.01)
    assert (mesh.unproved, mesh.notes) == (0, ())
    assert mesh.watertight == (whole == 1)
    assert mesh.euler_characteristic == 2 * whole
    assert mesh.area == pytest.approx(whole * 4 * np.pi * radius**2, rel=0.6)
    assert_manifold(mesh, field)
    upside_down = BezierField(-field.control_points, field.spacing, field.origin)
    assert len(upside_down.isosurface(-(radius**2), 0.01).triangles) == len(mesh.triangles)


def test_parts_too_small_for_the_finest_lattice_are_counted():
    mesh = tiny_ball().isosurface(1e-6)
    assert (len(mesh.triangles), mesh.unproved) == (0, 1)
    assert any("no surface was found" in note for note in mesh.notes)
    assert any("1 cells may hold small parts" in note for note in mesh.notes)
    assert tiny_ball().isosurface(-1e-3).notes == ("the field has no surface at level -0.001",)


def test_small_parts_among_large_ones(monkeypatch):
    """They are apart from the others, balls or cut by the border, and leave these as they are."""
    field = noise((12, 12, 12))
    mesh = field.isosurface(-1.5, 0.1)
    assert_manifold(mesh, field)
    monkeypatch.setattr("contourfair_jax.isosurface._lattice.small_parts", lambda *_: ([], 0))
    large = field.isosurface(-1.5, 0.1)
    more = metrics.surface_metrics(mesh).components - metrics.surface_metrics(large).components
    assert more > 0
    assert more <= mesh.euler_characteristic - large.euler_characteristic <= 2 * more


def test_a_constant_field_and_one_without_values():
    for value in (1.5, np.nan):
        assert len(catmull_rom(np.full((4, 4, 4), value)).isosurface(1.5).vertices) == 0


def test_a_plateau_at_the_level_is_below_it():
    samples = np.full((9, 8, 8), 7.1)
    samples[:3] = 20 + np.random.default_rng(0).normal(size=(3, 8, 8))
    field = catmull_rom(samples)
    mesh = field.isosurface(7.1)
    assert metrics.surface_metrics(mesh).components == 1
    assert mesh.vertices[:, 0].max() < 5
    assert_manifold(mesh, field)


def test_float32_fields():
    field = ball()
    single = BezierField(*(x.astype(jnp.float32) for x in (field.control_points, field.spacing,
                                                           field.origin)))  # fmt: skip
    mesh = single.isosurface(0.36)
    assert mesh.watertight
    assert mesh.vertices.dtype == np.float64
    assert mesh.area == pytest.approx(field.isosurface(0.36).area, rel=1e-3)


@pytest.mark.slow
def test_faired_samples_have_isosurfaces():
    x = np.linspace(-1, 1, 5)
    values = x[:, None, None] ** 2 + x[:, None] ** 2 + x**2
    mesh = cf.fair_field(values, spacing=0.5, origin=-1.0).isosurface(0.5)
    assert mesh.watertight
    assert mesh.euler_characteristic == 2
    assert "triangles" in repr(mesh)


@pytest.mark.slow
@pytest.mark.parametrize("method", [cf.LocalFairing(), cf.GlobalFairing()], ids=["local", "global"])
@pytest.mark.parametrize("kind", ["noise", "steps"])
def test_surfaces_of_faired_samples_are_manifold(method, kind):
    samples = np.random.default_rng(4).normal(size=(6, 6, 6))
    if kind == "steps":  # Values as labels have them, levels at samples included.
        samples = np.rint(samples)
    field = cf.fair_field(samples, method=method)
    for level in (-1.0, 0.0, 0.3):
        mesh = field.isosurface(level, 0.1)
        assert_manifold(mesh, field)
        value = dense(field, mesh.vertices)[0]
        assert np.abs(value - level).max() <= 1e-8 * np.ptp(samples)


@pytest.mark.parametrize(
    ("level", "tolerance", "message"),
    [
        (np.nan, 0.01, "levels must be finite"),
        (np.inf, 0.01, "levels must be finite"),
        ([0.1, 0.2], 0.01, "level must be one number"),
        ("a", 0.01, "levels must be real"),
        (0.1, 0.0, "tolerance must be"),
        (0.1, -1.0, "tolerance must be"),
        (0.1, np.nan, "tolerance must be"),
    ],
)
def test_bad_arguments(level, tolerance, message):
    with refused(ValueError, match=message):
        ball().isosurface(level, tolerance)


def test_two_dimensions_are_refused():
    with pytest.raises(ValueError, match="field must be 3-D"):
        catmull_rom(np.eye(4)).isosurface(0.5)


def volumes(folder, half=10):
    """Every 3-D array among the real data, cropped to twice `half` around its middle."""
    for record in json.loads((folder / "manifest.json").read_text()):
        path = folder / f"{record['id']}.npz"
        if path.exists():
            with np.load(path, allow_pickle=False) as archive:
                values = archive["data"].astype(float)
                valid = archive["valid"] if "valid" in archive else np.isfinite(values)
            if values.ndim == 3 and min(values.shape) >= 3:
                part = tuple(slice(max(n // 2 - half, 0), n // 2 + half) for n in values.shape)
                yield record["id"], np.where(valid, values, np.nan)[part]


@pytest.mark.data
def test_isosurfaces_of_real_volumes_are_watertight(shared_data):
    seen = 0
    for name, samples in volumes(shared_data):
        present = np.unique(samples[np.isfinite(samples)])
        if len(present) < 2:
            continue
        field = catmull_rom(samples)
        middle = present[len(present) // 2]  # A level that samples have.
        for level in (present[0] + 0.4 * np.ptp(present), middle):
            mesh = field.isosurface(level, 0.1)
            if np.isfinite(samples).all():
                assert_manifold(mesh, field)
            assert edges_of(mesh.triangles).faces.max(initial=0) <= 2, name
            value = dense(field, mesh.vertices)[0][:-1]
            assert np.nanmax(np.abs(value - level), initial=0) <= 1e-9 * np.ptp(present), name
            seen += len(mesh.triangles) > 0
    assert seen >= 20


@pytest.mark.data
def test_isosurfaces_of_faired_real_volumes_are_watertight(shared_data):
    seen = 0
    for _, samples in volumes(shared_data, 4):
        if not np.isfinite(samples).all() or min(samples.shape) < 8 or np.ptp(samples) == 0:
            continue
        field = cf.fair_field(samples)
        middle = np.unique(samples)[len(np.unique(samples)) // 2]
        for level in (samples.min() + 0.4 * np.ptp(samples), middle):
            mesh = field.isosurface(level, 0.1)
            assert_manifold(mesh, field)
            seen += len(mesh.triangles) > 0
    assert seen >= 16


def test_single_precision_far_from_zero_moves_the_surface_little_and_says_so():
    x = np.linspace(-1.0, 1.0, 9)
    ball = np.sqrt(x[:, None, None] ** 2 + x[:, None] ** 2 + x**2)
    plate = cf.LocalFairing(iterations=0)
    far = cf.fair_field(np.float32(10 * ball + 1e5), spacing=0.25, origin=-1.0, method=plate)
    mesh = far.isosurface(6 + 1e5)
    radii = np.linalg.norm(mesh.vertices, axis=1)
    assert mesh.euler_characteristic == 2
    np.testing.assert_allclose(radii, 0.6, atol=0.02)  # of a cell of 0.25
    assert "take a constant off them, or use float64" in mesh.notes[0]
