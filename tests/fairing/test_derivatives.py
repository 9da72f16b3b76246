"""Derivatives of fairing and of fields: jit, vmap, grad, jvp, vjp and second order, in every input.

One row of `CASES` for each method and dimension.  They compile long, so most are `slow`.
"""

import functools

import cases
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import contourfair_jax as cf
from contourfair_jax._fairing.global_fairing.renewals import fixed_point
from contourfair_jax._support.xla import working_set

SLOW = pytest.mark.slow
BOTH = pytest.mark.both_precisions
STEP = 1e-5

# Linear solves to rounding, so that derivatives are those of the exact minimum.
EXACT = {"tolerance": 1e-14}
MIXED = {
    "thin_plate_weight": 0.1,
    "coherence": 1.2,
    "hessian_weight": 0.7,
    "tension": 3.0,
    "smoothness": 0.04,
    "norm": 1.3,
}


def local(**settings):
    return cf.LocalFairing(iterations=2, **settings)


def overall(**settings):
    return cf.GlobalFairing(iterations=2, **EXACT, **settings)


def noisy(shape):
    rng = np.random.default_rng(3)
    return MIXED | {
        "sigma": rng.uniform(0.1, 0.6, shape),
        "cell_weights": rng.uniform(0.5, 2, [n - 1 for n in shape]),
    }


# Shape, method and its real-valued settings, which are differentiated.
CASES = {
    "local-2d": ((5, 6), local, {"thin_plate_weight": 0.1}),
    "local-3d": ((4, 4, 4), local, {"thin_plate_weight": 0.1}),
    "global-2d": ((5, 6), overall, MIXED),
    "global-3d": ((4, 4, 4), overall, MIXED),
    "noise-2d": ((5, 6), overall, noisy((5, 6))),
}
PLACE = ("values", "spacing", "origin", "points")


@functools.cache
def row(name):
    """Arguments, a direction for each, and the loss."""
    shape, make, settings = CASES[name]
    rng, ndim = np.random.default_rng(1), len(shape)
    spacing = 1 + 0.3 * np.arange(ndim)
    arguments = {
        "values": rng.normal(size=shape),
        "spacing": spacing,
        "origin": np.full(ndim, -0.5),
        "points": rng.uniform(0.2, 0.8, (5, ndim)) * (np.array(shape) - 1) * spacing - 0.5,
    } | settings
    arguments = {key: jnp.asarray(value, float) for key, value in arguments.items()}
    directions = {
        key: jnp.asarray(
            rng.normal(size=value.shape) * (0.1 if key == "points" else 1) if value.ndim else 1.0
        )
        for key, value in arguments.items()
    }
    weights = rng.normal(size=[3 * n - 2 for n in shape])

    def loss(arguments):
        """A number that depends on the net, and on what the field says of the points."""
        given = {key: value for key, value in arguments.items() if key not in PLACE}
        values, spacing, origin, points = (arguments[key] for key in PLACE)
        field = cf.fair_field(values, spacing=spacing, origin=origin, method=make(**given))
        value, gradient, hessian = field.jet(points)
        queries = jnp.sum(value**2) + jnp.sum(jnp.sin(gradient)) + 0.1 * jnp.sum(hessian**2)
        curvature = jnp.sum(field.mean_curvature(points))
        net = jnp.sum(jnp.sin(field.control_points) * weights.astype(values.dtype))
        return net + queries + curvature

    return arguments, directions, jax.jit(loss)


@functools.cache
def gradient_of(name):
    return jax.jit(jax.grad(row(name)[2]))


def along(arguments, directions, t, keys):
    return arguments | {key: arguments[key] + t * directions[key] for key in keys}


def inner(left, right):
    return sum(float(jnp.vdot(left[key], right[key])) for key in left)


@SLOW
@pytest.mark.parametrize("name", CASES)
def test_gradients_equal_differences(name):
    """In every argument apart."""
    arguments, directions, loss = row(name)
    gradient = gradient_of(name)(arguments)
    for key in arguments:
        ends = [float(loss(along(arguments, directions, t, [key]))) for t in (STEP, -STEP)]
        difference = (ends[0] - ends[1]) / (2 * STEP)
        assert abs(difference) > 1e-4, key
        assert inner({key: gradient[key]}, directions) == pytest.approx(difference, rel=2e-5), key


@SLOW
@pytest.mark.parametrize("name", CASES)
def test_forward_and_reverse_mode_agree(name):
    arguments, directions, loss = row(name)
    _, forward = jax.jit(lambda a, t: jax.jvp(loss, (a,), (t,)))(arguments, directions)
    reverse = inner(gradient_of(name)(arguments), directions)
    assert float(forward) == pytest.approx(reverse, rel=1e-10)


def forward_over_reverse(loss, arguments, directions):
    return jax.jvp(jax.grad(loss), (arguments,), (directions,))[1]


def reverse_over_forward(loss, arguments, directions):
    return jax.grad(lambda a: jax.jvp(loss, (a,), (directions,))[1])(arguments)


def reverse_over_reverse(loss, arguments, directions):
    def slope(arguments):
        gradient = jax.grad(loss)(arguments)
        return sum(jnp.vdot(gradient[key], directions[key]) for key in gradient)

    return jax.grad(slope)(arguments)


ORDERS = [forward_over_reverse, reverse_over_forward, reverse_over_reverse]
# In 3-D one order, for programs of second order compile for minutes there.
SECOND = [
    (name, order) for name in CASES for order in (ORDERS if name.endswith("2d") else ORDERS[:1])
]


@SLOW
@pytest.mark.parametrize(("name", "order"), SECOND)
def test_hessian_vector_products(name, order):
    arguments, directions, loss = row(name)
    product = jax.jit(functools.partial(order, loss))(arguments, directions)
    gradient = gradient_of(name)
    ends = [gradient(along(arguments, directions, t, arguments)) for t in (STEP, -STEP)]
    for key in arguments:
        difference = (ends[0][key] - ends[1][key]) / (2 * STEP)
        size = float(jnp.linalg.norm(difference))
        assert float(jnp.linalg.norm(product[key] - difference)) < 1e-4 * size, key


@SLOW
@pytest.mark.parametrize("name", [name for name in CASES if name.endswith("2d")])
def test_batches_of_gradients(name):
    arguments, directions, _ = row(name)
    batch = [along(arguments, directions, t, arguments) for t in (0.0, 0.01)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *batch)
    ours = jax.jit(jax.vmap(jax.grad(row(name)[2])))(stacked)
    for k, one in enumerate(batch):
        for key, expected in gradient_of(name)(one).items():
            np.testing.assert_allclose(ours[key][k], expected, rtol=1e-8, atol=1e-8)


def degenerate(shape):
    """Samples where normals, gradients or both vanish somewhere."""
    x = np.meshgrid(*[np.linspace(-1, 1, n) for n in shape], indexing="ij")
    spike = np.zeros(shape)
    spike[tuple(n // 2 for n in shape)] = 1
    return {
        "constant": np.full(shape, 3.7),
        "plane": 2 * x[0] - x[1],
        "ridge": np.exp(-((3 * (x[0] - 0.8 * x[1])) ** 2)),
        "saddle": x[0] * x[1],
        "spike": spike,
    }


@SLOW
@BOTH
@pytest.mark.parametrize("name", CASES)
def test_degenerate_samples_have_finite_derivatives(name, x64):
    """Of the net, in both precisions; missing samples get zero and leave the others finite."""
    shape, make, settings = CASES[name]
    if make is overall and not x64:
        make = functools.partial(cf.GlobalFairing, iterations=2)

    weights = np.random.default_rng(2).normal(size=[3 * n - 2 for n in shape])

    @jax.jit
    @jax.grad
    def gradient(arguments):
        given = {key: value for key, value in arguments.items() if key not in PLACE}
        field = cf.fair_field(
            arguments["values"], spacing=arguments["spacing"], method=make(**given)
        )
        return jnp.nansum(field.control_points * weights.astype(field.dtype))

    samples = degenerate(shape)
    hole = samples["ridge"].copy()
    hole[(0,) * len(shape)] = np.nan
    samples["missing"] = hole
    for kind, values in samples.items():
        arguments = {"values": values, "spacing": np.ones(len(shape))} | settings
        arguments = {key: jnp.asarray(value, float) for key, value in arguments.items()}
        for key, leaf in gradient(arguments).items():
            assert bool(jnp.isfinite(leaf).all()), (kind, key)
            if kind == "missing" and key == "values":
                assert float(jnp.abs(leaf[(0,) * len(shape)])) == 0


@SLOW
def test_points_outside_have_finite_derivatives(rng):
    """Their NaN values are not to spoil the derivatives of a loss that leaves them out."""
    net = jnp.asarray(cases.FIELDS["smooth_random"].samples((13, 10), rng))
    points = jnp.array([[1.0, 1.5], [-1.0, 2.0], [np.nan, 1.0]])

    def loss(net, points):
        field = cf.BezierField(net, jnp.ones(2), jnp.zeros(2))
        return jnp.nansum(field(points)) + jnp.nansum(field.mean_curvature(points))

    in_net, in_points = jax.grad(loss, argnums=(0, 1))(net, points)
    assert bool(jnp.isfinite(in_net).all())
    assert bool(jnp.isfinite(in_points[0]).all())
    assert bool(jnp.isfinite(in_points[1]).all())


@SLOW
@BOTH
@pytest.mark.parametrize("ndim", [2, 3])
def test_many_points_are_evaluated_in_batches(ndim, rng):
    """As a few of them are, also in what is differentiated, which is not cut."""
    net = jnp.asarray(rng.normal(size=[3 * n + 1 for n in (4, 3, 2)[:ndim]]))
    field = cf.BezierField(net, jnp.ones(ndim), jnp.zeros(ndim))
    count = working_set().batch_bytes // (4**ndim * field.dtype.itemsize) + 7
    points = jnp.asarray(rng.uniform(0, 2, (count, ndim)), field.dtype)
    some = points[:: count // 50]
    tolerance = 100 * float(jnp.finfo(field.dtype).eps)
    for many, few in zip(field.jet(points), field.jet(some), strict=True):
        np.testing.assert_allclose(many[:: count // 50], few, rtol=0, atol=30 * tolerance)
    slopes = jax.grad(lambda points: jnp.sum(field(points)))(points)
    np.testing.assert_allclose(slopes, field.gradient(points), rtol=0, atol=10 * tolerance)
    grid = field.spacing, field.origin
    in_net = jax.grad(lambda net: jnp.sum(cf.BezierField(net, *grid)(points)))
    assert float(jnp.sum(in_net(net))) == pytest.approx(count, rel=1e-4)


@SLOW
def test_clamped_points_on_the_border_keep_their_slope(rng):
    net = jnp.asarray(cases.FIELDS["smooth_random"].samples((13, 10), rng))
    field = cf.BezierField(net, jnp.ones(2), jnp.zeros(2))
    slope = jax.vmap(jax.grad(lambda point: field(point, outside="clamp")))
    ends = jnp.array([[0.0, 1.3], [4.0, 1.3], [2.2, 0.0], [4.0, 3.0]])
    np.testing.assert_allclose(slope(ends), field.gradient(ends), rtol=1e-12)
    beyond = slope(ends + jnp.array([[-0.1, 0.0], [0.1, 0.0], [0.0, -0.1], [0.1, 0.1]]))
    inside = field.gradient(ends) * jnp.array([[0.0, 1.0], [0.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
    np.testing.assert_allclose(beyond, inside, rtol=1e-12)


@SLOW
def test_what_is_differentiated_is_what_is_computed():
    """Wide holes are seen, and warnings given, inside `jax.grad` as outside."""
    values = np.add.outer(np.sin(np.arange(18.0)), np.arange(18.0) / 4)
    values[5:14, 5:14] = np.nan
    values = jnp.asarray(values)
    method = cf.GlobalFairing(iterations=0, max_steps=3)

    def loss(values):
        return jnp.sum(cf.fair_field(values, method=method).control_points ** 2)

    with pytest.warns(UserWarning, match="raise max_steps"):
        value = loss(values)
    with pytest.warns(UserWarning, match="raise max_steps"):
        beside, slope = jax.value_and_grad(loss)(values)
    assert float(beside) == float(value)
    assert bool(jnp.isfinite(slope[0, 0]))


# Converged global fairing ----------------------------------------------------------------


def limit_loss(arguments, **settings):
    """A number that depends on the limit of the normals."""
    shape = arguments["values"].shape
    weights = np.random.default_rng(2).normal(size=[3 * n - 2 for n in shape])
    given = {key: value for key, value in arguments.items() if key not in PLACE}
    field = cf.fair_field(
        arguments["values"],
        spacing=arguments["spacing"],
        method=cf.GlobalFairing(tolerance=1e-12, **settings, **given),
    )
    return jnp.sum(jnp.sin(field.control_points) * weights)


@SLOW
@pytest.mark.parametrize("sigma", [None, 0.2])
def test_the_limit_is_differentiated_implicitly(sigma, rng):
    """Against unrolling far beyond convergence, in forward and reverse mode."""
    shape = (5, 6)
    arguments = {
        "values": rng.normal(size=shape),
        "spacing": np.array([1.0, 1.3]),
        "thin_plate_weight": np.array(0.1),
        "coherence": np.array(1.2),
    }
    if sigma:
        arguments["sigma"] = np.array(sigma)
    arguments = {key: jnp.asarray(value) for key, value in arguments.items()}
    limit = functools.partial(limit_loss, converge=1e-11, iterations=80)
    unrolled = functools.partial(limit_loss, iterations=40)
    value, implicit = jax.jit(jax.value_and_grad(limit))(arguments)
    expected, explicit = jax.jit(jax.value_and_grad(unrolled))(arguments)
    assert float(value) == pytest.approx(float(expected), rel=1e-9)
    for key, leaf in explicit.items():
        size = float(jnp.abs(leaf).max())
        np.testing.assert_allclose(implicit[key], leaf, rtol=0, atol=1e-6 * size, err_msg=key)
    directions = jax.tree.map(lambda leaf: jnp.asarray(rng.normal(size=leaf.shape)), arguments)
    _, forward = jax.jit(lambda a, t: jax.jvp(limit, (a,), (t,)))(arguments, directions)
    assert float(forward) == pytest.approx(inner(implicit, directions), rel=1e-8)


@SLOW
@pytest.mark.parametrize("sigma", [None, 0.05, 0.6])
def test_the_limit_where_its_series_grows_at_first(sigma, rng):
    """Sharp normals, hardly any thin plate: against differences."""
    values, direction = (jnp.asarray(rng.normal(size=(5, 6))) for _ in range(2))
    rest = {"spacing": np.ones(2), "thin_plate_weight": 0.003, "norm": 1.0}
    if sigma:
        rest["sigma"] = sigma

    @jax.jit
    def loss(values):
        arguments = {"values": values, **rest}
        return limit_loss(arguments, converge=1e-10, iterations=400, sharpness=3)

    slope = jnp.vdot(jax.grad(loss)(values), direction)
    step = 5e-5 * direction
    difference = (loss(values + step) - loss(values - step)) / 1e-4
    np.testing.assert_allclose(slope, difference, rtol=1e-6, atol=1e-6)


@SLOW
@pytest.mark.parametrize("given", [{}, {"iterations": 40, "converge": 1e-9}])
def test_one_setting_is_differentiated_alone(given, rng):
    """Also that with which nothing but the springs to the samples changes."""
    values = jnp.asarray(rng.normal(size=(5, 6)))
    for name, at in (("sigma", 0.2), ("thin_plate_weight", 0.1), ("norm", 1.5)):

        @jax.jit
        def loss(setting, name=name):
            rest = {"sigma": 0.2} | {name: setting}
            method = cf.GlobalFairing(tolerance=1e-12, **rest, **given)
            return jnp.sum(jnp.sin(cf.fair_field(values, method=method).control_points))

        difference = (loss(at + 1e-5) - loss(at - 1e-5)) / 2e-5
        slope = jax.jit(jax.grad(loss))(at)
        np.testing.assert_allclose(slope, difference, rtol=1e-5, atol=1e-7, err_msg=name)


@BOTH
def test_derivatives_of_a_fixed_point_need_not_contract_but_exist():
    """Right ones of a turn that grows; NaN rather than wrong ones where there are none."""
    turn = jnp.array([[0.0, -1.5], [1.5, 0.0]])

    def limit(shift, matrix):
        known = jnp.ones(2), None
        point, _ = fixed_point(lambda z: matrix @ z + shift, lambda: known, jnp.zeros(2), 1e-5)
        return jnp.sum(point)

    expected = np.linalg.inv(np.eye(2) - np.asarray(turn)).sum(axis=0)
    np.testing.assert_allclose(jax.grad(limit)(jnp.ones(2), turn), expected, rtol=1e-5)
    assert bool(jnp.isnan(jax.grad(limit)(jnp.ones(2), jnp.eye(2))).all())


@SLOW
def test_memory_of_the_limit_does_not_grow_with_iterations():
    values = jnp.zeros((24, 24))

    def needed(**settings):
        def loss(values):
            net = cf.fair_field(values, method=cf.GlobalFairing(**settings)).control_points
            return jnp.sum(net**2)

        compiled = jax.jit(jax.grad(loss)).lower(values).compile()
        return compiled.memory_analysis().temp_size_in_bytes

    few, many = (needed(converge=1e-6, iterations=k) for k in (5, 500))
    assert many < 1.02 * few + 1e5


@SLOW
def test_a_limit_that_is_not_reached_is_reported():
    values = np.random.default_rng(0).normal(size=(5, 6))
    with pytest.warns(UserWarning, match="raise iterations"):
        field = cf.fair_field(values, method=cf.GlobalFairing(converge=1e-9, iterations=2))
    assert not bool(field.report.converged)
    with pytest.raises(ValueError, match="converge must be a real number above 0"):
        cf.GlobalFairing(converge=0.0)
    with pytest.raises(ValueError, match="iterations must be"):
        cf.GlobalFairing(converge=1e-6, iterations=0)
