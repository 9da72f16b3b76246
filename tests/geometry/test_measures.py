"""Differentiable geometry: against differences of what the host finds, and closed forms."""

import itertools
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shape_checks import refused
from splines import catmull_rom

import contourfair_jax as cf
from contourfair_jax import geometry
from contourfair_jax._bezier.host import HostField
from contourfair_jax._field import BezierField
from contourfair_jax.geometry._level_points import SidedField
from contourfair_jax.metrics import signed_area

SPACING = 0.4
LEVEL = -1.1


def hill(ndim, size):
    """-|x|^2 with a slant of higher order, so that nothing is symmetric."""
    axes = np.meshgrid(*[SPACING * (np.arange(size) - (size - 1) / 2)] * ndim, indexing="ij")
    return -sum(x * x for x in axes) + 0.1 * axes[0] ** 3 + 0.05 * axes[0] * axes[1]


def field_of(samples):
    return catmull_rom(samples, SPACING, -SPACING * (len(samples) - 1) / 2)


@pytest.fixture(scope="module")
def disk():
    field = field_of(hill(2, 9))
    return field, field.contours(LEVEL, tolerance=1e-5)


@pytest.fixture(scope="module")
def ball():
    return field_of(hill(3, 9)), field_of(hill(3, 9)).isosurface(LEVEL)


def moved(field, direction, t):
    return BezierField(field.control_points + t * direction, field.spacing, field.origin)


def direction_of(field, rng):
    """A change of the net that keeps it C1."""
    return field_of(1 + rng.normal(size=field.shape)).control_points


def measures_2d(field, lines, level=None):
    args = field, lines, level
    return jnp.stack([geometry.length(*args), geometry.area(*args), geometry.bending(*args)])


def host_measures(field, level=LEVEL):
    (line,) = field.contours(level, tolerance=1e-5)
    steps = np.linalg.norm(np.diff(line.points, axis=0), axis=1)
    return np.array([steps.sum(), signed_area(line.points)])


@pytest.mark.slow
def test_measures_of_a_disk(disk, rng):
    """Values and derivatives against contours that are traced again, and closed forms."""
    field, lines = disk
    direction = direction_of(field, rng)

    @jax.jit
    def measures(t, level):
        return measures_2d(moved(field, direction, t), lines, level)

    values, slopes = jax.jvp(lambda t: measures(t, LEVEL), (0.0,), (1.0,))
    np.testing.assert_allclose(values[:2], host_measures(field), rtol=1e-8)
    assert values[2] == pytest.approx(2 * np.pi / np.sqrt(-LEVEL), rel=0.1)
    step = 1e-4
    ends = [host_measures(moved(field, direction, t)) for t in (step, -step)]
    np.testing.assert_allclose(slopes[:2], (ends[0] - ends[1]) / (2 * step), rtol=1e-4)

    # Reverse mode is the transpose; the area of a level set goes with the integral of 1 / |g|.
    reverse = jax.grad(lambda t, level: measures(t, level)[1], argnums=(0, 1))(0.0, LEVEL)
    assert float(reverse[0]) == pytest.approx(float(slopes[1]), rel=1e-12)
    points = lines[0].points
    inverse = 1 / np.linalg.norm(field.gradient(jnp.asarray(points)), axis=1)
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    integral = np.sum(chords * (inverse[1:] + inverse[:-1]) / 2)
    assert float(reverse[1]) == pytest.approx(-integral, rel=1e-4)


@pytest.mark.slow
def test_length_of_lines_that_end_at_the_border(rng):
    """Their ends slide along it."""
    field = field_of(hill(2, 9))
    level = -4.0
    direction = direction_of(field, rng)
    lines = field.contours(level, tolerance=1e-5)
    assert len(lines) > 1
    assert not any(line.closed for line in lines)

    def traced(t):
        return sum(
            np.linalg.norm(np.diff(line.points, axis=0), axis=1).sum()
            for line in moved(field, direction, t).contours(level, tolerance=1e-5)
        )

    _, slope = jax.jvp(lambda t: geometry.length(moved(field, direction, t), lines), (0.0,), (1.0,))
    assert float(slope) == pytest.approx((traced(1e-4) - traced(-1e-4)) / 2e-4, rel=1e-3)


def test_contours_and_surfaces_of_differentiated_and_of_traced_fields(disk, ball):
    """Found where the numbers are known; elsewhere it is said what to do."""
    for field, find in (
        (disk[0], lambda f: f.contours(LEVEL)[0].points),
        (ball[0], lambda f: f.isosurface(LEVEL).vertices),
        (disk[0], lambda f: f.adaptive(0.5).values),
    ):

        def total(net, field=field, find=find):
            found = find(BezierField(net, field.spacing, field.origin))
            return jnp.sum(jnp.asarray(found)) + jnp.sum(net)

        np.testing.assert_array_equal(jax.grad(total)(field.control_points), 1)
        with pytest.raises(ValueError, match="field must be known"):
            jax.jit(total)(field.control_points)


@pytest.mark.slow
def test_second_derivatives(disk, rng):
    """The points follow the contour: their slopes change as those at the places that they reach."""
    field, lines = disk
    direction = direction_of(field, rng)

    @jax.jit
    def slope(t):
        return jax.grad(lambda s: geometry.area(moved(field, direction, s), lines))(t)

    step = 1e-4
    expected = (slope(step) - slope(-step)) / (2 * step)
    assert float(jax.grad(slope)(0.0)) == pytest.approx(float(expected), rel=2e-3)


@pytest.mark.slow
def test_volume_and_surface_of_a_ball(ball, rng):
    field, surface = ball
    direction = direction_of(field, rng)
    radius = np.sqrt(-LEVEL)

    def measures(t, mesh=surface):
        args = moved(field, direction, t), mesh
        return jnp.stack([geometry.volume(*args), geometry.surface_area(*args)])

    assert float(-measures(0.0)[0]) == pytest.approx(4 / 3 * np.pi * radius**3, rel=0.05)
    assert float(geometry.bending(*ball)) == pytest.approx(4 * np.pi, rel=0.1)
    _, slopes = jax.jvp(measures, (0.0,), (1.0,))
    step = 1e-2
    ends = [measures(t, mesh=moved(field, direction, t).isosurface(LEVEL)) for t in (step, -step)]
    np.testing.assert_allclose(slopes, (ends[0] - ends[1]) / (2 * step), rtol=0.02)


def test_points_stay_on_the_contour(disk, rng):
    """To second order without a step, and on it with steps, inside jit."""
    field, lines = disk
    points, direction = jnp.asarray(lines[0].points), direction_of(field, rng)
    place = jax.jit(lambda t: geometry.level_points(moved(field, direction, t), points, LEVEL, 0))
    start, velocity = jax.jvp(place, (0.0,), (1.0,))
    np.testing.assert_array_equal(start, points)
    misses = []
    for step in (1e-2, 5e-3):
        values = moved(field, direction, step)(start + step * velocity)
        misses.append(float(jnp.abs(values - LEVEL).max()))
    assert misses[0] / misses[1] == pytest.approx(4, rel=0.2)
    changed = moved(field, direction, 1e-2)
    projected = geometry.level_points(changed, points, LEVEL)
    assert float(jnp.abs(changed(projected) - LEVEL).max()) < 1e-7


@pytest.mark.slow
@pytest.mark.both_precisions
@pytest.mark.parametrize("value", [0.0, 3.7, -1e6])
def test_a_constant_has_no_curvature_and_nowhere_to_move_to(value):
    """Roundings of its gradient are not taken for one."""
    net = jnp.full((13, 13), value)
    points = jnp.array([[0.3, 0.7], [1.9, 2.2], [3.1, 0.0]])

    def measures(net, level):
        field = BezierField(net, jnp.ones(2), jnp.zeros(2))
        moved = geometry.level_points(field, points, level)
        return jnp.sum(moved**2) + jnp.sum(field.mean_curvature(points) ** 2)

    field = BezierField(net, jnp.ones(2), jnp.zeros(2))
    np.testing.assert_array_equal(field.mean_curvature(points), 0)
    in_net, in_level = jax.grad(measures, argnums=(0, 1))(net, jnp.asarray(value))
    assert bool((in_net == 0).all())
    assert float(in_level) == 0
    turned = jax.jvp(jax.grad(measures), (net, jnp.asarray(value)), (net, jnp.asarray(0.0)))[1]
    assert bool(jnp.isfinite(turned).all())


def test_flat_places_and_missing_points():
    field = catmull_rom(np.zeros((4, 4)))
    points = jnp.array([[1.0, 1.5], [np.nan, np.nan]])

    @jax.jit
    @partial(jax.grad, has_aux=True)
    def gradient(level):
        placed = geometry.level_points(field, points, level)
        return jnp.sum(placed[0]), placed

    slope, placed = gradient(1.0)
    assert float(slope) == 0
    np.testing.assert_array_equal(placed, points)


def net_with_gaps(shape, rng):
    """A net of which some cells have no values, and which cells have them."""
    net = catmull_rom(rng.normal(size=shape)).control_points
    cells = tuple(n - 1 for n in shape)
    valid = rng.uniform(size=cells) > 0.4
    for cell in np.argwhere(~valid):
        net = net.at[tuple(slice(3 * c + 1, 3 * c + 3) for c in cell)].set(jnp.nan)
    return net, valid


def every_half(shape):
    """Vertices, and the middles of edges, of faces and of cells."""
    return np.array(list(itertools.product(*(np.arange(0, n - 0.9, 0.5) for n in shape))))


def cells_around(point, shape):
    """All cells that hold a point."""
    sides = [
        {int(np.floor(x)), int(np.ceil(x)) - 1} & set(range(n - 1))
        for x, n in zip(point, shape, strict=True)
    ]
    return list(itertools.product(*sides))


@pytest.mark.parametrize("shape", [(6, 7), (4, 5, 4)])
def test_ends_are_faces_with_no_values_behind_them(shape, rng):
    """Along an axis: on a face across it, and none but the own side of that has values."""
    net, valid = net_with_gaps(shape, rng)
    field = BezierField(net, 0.5 * jnp.ones(len(shape)), jnp.zeros(len(shape)))
    points = every_half(shape)
    sided = SidedField.of(field, 0.5 * points)
    kinds = set()
    for point, own, ends in zip(points, *map(np.asarray, (sided.cells, sided.ends)), strict=True):
        around = cells_around(point, shape)
        good = [cell for cell in around if valid[cell]]
        whole = len(good) == 2 ** np.sum(point == np.round(point))
        kinds.add((len(good), bool(ends.any())))
        if whole or not good:
            assert (own == -1).all(), point
            assert not ends.any(), point
            continue
        assert tuple(own) in good
        for axis, end in enumerate(ends):
            across = np.array(own)
            across[axis] += 1 if point[axis] > own[axis] else -1
            on_face = point[axis] == np.round(point[axis])
            assert end == (on_face and tuple(across) not in good), (point, axis)
    assert {(0, False), (1, False), (1, True), (2, True)} <= kinds


@pytest.mark.parametrize("shape", [(6, 7), (4, 5, 4)])
def test_the_host_has_values_on_faces_beside_cells_without(shape, rng):
    """Those of a cell that holds the point and has values; NaN where there is none such."""
    net, valid = net_with_gaps(shape, rng)
    host, points = HostField(np.asarray(net)), every_half(shape)
    np.testing.assert_array_equal(host.valid, valid)
    known = np.array([any(valid[c] for c in cells_around(p, shape)) for p in points])
    assert 0.1 < known.mean() < 0.95
    located = host.locate(points[known])
    for cell, point in zip(located, points[known], strict=True):
        assert valid[tuple(cell)]
        assert tuple(cell) in cells_around(point, shape)
    values, slopes = host.jet(points, 1)
    np.testing.assert_array_equal(np.isnan(values[0]), ~known)
    np.testing.assert_array_equal(np.isnan(slopes).any(axis=0), ~known)


@pytest.mark.slow
@pytest.mark.both_precisions
@pytest.mark.parametrize("gap", [(3, 5), (4, 2), (6, 6), (0, 4)])
def test_contours_that_end_at_missing_samples(gap, rng, x64):
    """Whichever side of the cells without values they end on."""
    samples = jnp.asarray(hill(2, 9), float if x64 else np.float32).at[gap].set(jnp.nan)

    def fair(samples):
        return cf.fair_field(samples, spacing=SPACING, method=cf.LocalFairing(iterations=0))

    field = fair(samples)
    lines = field.contours(LEVEL, tolerance=1e-5)
    assert any(not line.closed for line in lines)
    host = sum(np.linalg.norm(np.diff(line.points, axis=0), axis=1).sum() for line in lines)
    assert geometry.length(field, lines) == pytest.approx(host, rel=1e-4)
    whole = fair(jnp.asarray(hill(2, 9), samples.dtype))
    assert (
        0
        < geometry.bending(field, lines)
        < 1.2 * geometry.bending(whole, whole.contours(LEVEL, tolerance=1e-5))
    )
    points = np.concatenate([line.points for line in lines])
    placed = geometry.level_points(field, points, LEVEL)
    np.testing.assert_allclose(placed, points, atol=1e-4 if x64 else 1e-3)
    if not x64:
        return
    change, step = jnp.asarray(rng.normal(size=(9, 9))), 1e-3
    slope = jnp.vdot(
        change, jnp.nan_to_num(jax.grad(lambda s: geometry.length(fair(s), lines))(samples))
    )
    lengths = []
    for sign in (1, -1):
        near = fair(samples + sign * step * change).contours(LEVEL, tolerance=1e-5)
        lengths.append(
            sum(np.linalg.norm(np.diff(each.points, axis=0), axis=1).sum() for each in near)
        )
    assert slope == pytest.approx((lengths[0] - lengths[1]) / (2 * step), rel=0.02, abs=1e-3)


@pytest.mark.both_precisions
@pytest.mark.parametrize("gap", [(2, 5, 3), (6, 3, 4)])
def test_surfaces_that_end_at_missing_samples(gap, x64):
    samples = jnp.asarray(hill(3, 9), float if x64 else np.float32).at[gap].set(jnp.nan)
    field = cf.fair_field(samples, spacing=SPACING, method=cf.LocalFairing(iterations=0))
    mesh = field.isosurface(LEVEL)
    assert not mesh.watertight
    found = geometry.surface_area(field, mesh)
    assert found == pytest.approx(mesh.area, rel=1e-4)
    assert 0 < geometry.bending(field, mesh) < 4 * np.pi


def test_derivative_of_an_area_in_the_samples(rng):
    """Through the fairing: to every sample, and to the spacing."""
    samples, direction = hill(2, 9), rng.normal(size=(9, 9))

    def fair(samples, spacing=SPACING):
        return cf.fair_field(samples, spacing=spacing, origin=-4 * SPACING)

    lines = fair(samples).contours(LEVEL, tolerance=1e-5)
    gradient, in_spacing = jax.jit(
        jax.grad(lambda s, h: geometry.area(fair(s, h), lines), argnums=(0, 1))
    )(samples, SPACING)
    step = 1e-4
    ends = [host_measures(fair(samples + t * direction))[1] for t in (step, -step)]
    expected = (ends[0] - ends[1]) / (2 * step)
    assert float(np.vdot(gradient, direction)) == pytest.approx(expected, rel=1e-3)
    ends = [host_measures(fair(samples, SPACING + t))[1] for t in (step, -step)]
    assert float(in_spacing) == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-3)


def test_measures_of_a_surface_are_those_of_the_mesh(ball):
    """One sign: negative around larger values, as that of the mesh; the level can be changed."""
    field, surface = ball
    assert float(geometry.volume(field, surface)) == pytest.approx(surface.volume, rel=1e-6)
    assert float(geometry.surface_area(field, surface)) == pytest.approx(surface.area, rel=1e-6)
    turned = replace(surface, triangles=surface.triangles[:, ::-1])
    assert float(geometry.volume(field, turned)) == pytest.approx(-surface.volume, rel=1e-6)
    higher = field.isosurface(LEVEL + 0.02)
    found = float(geometry.volume(field, surface, LEVEL + 0.02))
    assert found == pytest.approx(higher.volume, rel=0.02)
    assert abs(found) < abs(surface.volume)


def test_surfaces_as_arrays_as_before(ball):
    field, surface = ball
    arrays = field, surface.vertices, surface.triangles
    for call, sign in ((geometry.volume, -1), (geometry.surface_area, 1), (geometry.bending, 1)):
        expected = sign * float(call(field, surface))
        with pytest.warns(DeprecationWarning, match=r"use .*\(field, surface\)"):
            assert float(call(*arrays, LEVEL)) == pytest.approx(expected, rel=1e-12)
    with pytest.warns(DeprecationWarning, match=r"use volume\(field, surface\)"):
        turned = geometry.volume(
            field, vertices=arrays[1], triangles=arrays[2][:, ::-1], level=LEVEL
        )
    assert float(turned) == pytest.approx(-float(geometry.volume(field, surface)), rel=1e-12)


def test_lines_are_the_former_name_of_what_bends(disk):
    field, lines = disk
    with pytest.warns(DeprecationWarning, match="lines= of bending .* use level_set="):
        assert geometry.bending(field, lines=lines) == geometry.bending(field, lines)


def test_bad_input(disk, ball):
    field, lines = disk
    solid, surface = ball
    vertices, triangles = surface.vertices, surface.triangles

    def with_triangles(triangles, vertices=vertices):
        return replace(surface, vertices=vertices, triangles=triangles)

    with pytest.raises(ValueError, match="lines must hold at least one line"):
        geometry.length(field, [])
    with pytest.raises(ValueError, match=r"lines must be closed .* got 1 that end"):
        geometry.area(field, field_of(hill(2, 9)[:5]).contours(LEVEL))
    with pytest.raises(ValueError, match="field must be 2-D"):
        geometry.length(solid, lines)
    with pytest.raises(ValueError, match="field must be 3-D"):
        geometry.volume(field, surface)
    with refused(ValueError, match=r"surface must be an Isosurface, got Contours"):
        geometry.surface_area(solid, lines)
    with pytest.raises(ValueError, match="got 3 open edges"):
        geometry.volume(solid, with_triangles(triangles[1:]))
    with pytest.raises(ValueError, match=r"triangles must have shape \(m, 3\)"):
        geometry.surface_area(solid, with_triangles(triangles[:, :2]))
    with pytest.raises(ValueError, match=r"triangles must have shape \(m, 3\)"):
        geometry.volume(solid, with_triangles(triangles[:, :2]))
    with pytest.raises(ValueError, match="triangles must be whole numbers"):
        geometry.volume(solid, with_triangles(triangles * 1.0))
    with pytest.raises(ValueError, match="numbers of the"):
        geometry.surface_area(solid, with_triangles(triangles, vertices[:5]))
    with pytest.raises(ValueError, match="steps"):
        geometry.level_points(field, vertices[:, :2], LEVEL, -1)
    with pytest.raises(ValueError, match="points"):
        geometry.level_points(field, vertices, LEVEL)
