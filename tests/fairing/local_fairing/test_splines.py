"""The local spline space: functions, sets and tables, against the twin's B-splines and loops."""

import itertools

import jax.numpy as jnp
import numpy as np
import pytest
import twin

from contourfair_jax._bezier.bernstein import bernstein, quadrature
from contourfair_jax._fairing.local_fairing import splines

# The even and odd functions of one axis from phi_0 .. phi_4, and their parities.
PARITIES = (0, 0, 1, 0, 1)


def function(k, s, order=0):
    """Even or odd function number `k` at `s` in [0, 2], or a derivative."""
    phi = [twin.phi(i, s, order) for i in range(5)]
    powers = ((1, 0, 0), ((s - 1) ** 2, 2 * (s - 1), 2), (s - 1, 1, 0))
    return powers[k][order] if k < 3 else (phi[1] + phi[3], phi[3] - phi[1])[k - 3]


def test_coefficients_of_bezier_points_are_those_of_the_functions():
    matrix = splines.TO_BEZIER @ splines.FROM_PARITY
    for k, s in itertools.product(range(5), np.linspace(0, 2, 9)[:-1]):
        half = int(s)
        value = bernstein(3, np.array(s - half)) @ matrix[3 * half : 3 * half + 4, k]
        assert value == pytest.approx(function(k, s), abs=1e-12)


@pytest.mark.parametrize("order", [2, 4])
def test_functions_at_quadrature_points(order):
    table = splines.full_axis(order)
    points, _ = quadrature(order)
    for derivative, half, k, q in np.ndindex(table.shape):
        s = 1 + (points[q] if half == 0 else -points[q])
        assert table[derivative, half, k, q] == pytest.approx(function(k, s, derivative), abs=1e-11)


@pytest.mark.parametrize("ndim", [2, 3])
def test_sets_of_functions_sorted_by_parity(ndim):
    samples, fairing = (splines.index_set(ndim, kind) for kind in ("samples", "fairing"))
    assert (len(samples), len(fairing)) == (3**ndim, 5**ndim - 3**ndim)
    assert (samples < 3).all()
    assert (fairing >= 3).any(1).all()
    every = np.concatenate([samples, fairing])
    assert len(np.unique(every, axis=0)) == 5**ndim
    for chosen in (samples, fairing):
        block = splines.block_of(chosen)
        expected = [int("".join(str(PARITIES[i]) for i in row), 2) for row in chosen]
        np.testing.assert_array_equal(block, expected)
        assert (np.diff(block) >= 0).all()


@pytest.mark.parametrize("ndim", [2, 3])
def test_samples_and_coefficients_are_the_same_quadratic(ndim, rng):
    """Bezier points of samples alone: where samples lie, they are the samples."""
    values = rng.normal(size=(3,) * ndim)
    given = splines.samples_to_parity(ndim) @ values.ravel()
    points = splines.parity_to_bezier(ndim) @ np.append(given, np.zeros(5**ndim - 3**ndim))
    points = points.reshape((7,) * ndim)
    np.testing.assert_allclose(points[(slice(None, None, 3),) * ndim], values, atol=1e-12)
    for k, indices in enumerate(splines.index_set(ndim, "samples")):
        at = rng.uniform(0, 2, ndim)
        unit = splines.parity_to_bezier(ndim)[:, k].reshape((7,) * ndim)
        for s in at:
            half = int(s)
            weights = bernstein(3, np.array(s - half))
            unit = np.tensordot(weights, unit[3 * half : 3 * half + 4], 1)
        expected = np.prod([function(i, s) for i, s in zip(indices, at, strict=True)])
        assert unit == pytest.approx(expected)


@pytest.mark.parametrize("ndim", [2, 3])
def test_every_pair_of_functions_once_by_the_parities_that_meet(ndim):
    equal, others = splines.block_entries(ndim)
    block = splines.block_of(splines.index_set(ndim, "fairing"))
    pairs = [tuple(pair) for pair in equal.T.tolist()]
    assert len(set(pairs)) == len(pairs)
    assert (block[equal[0]] == block[equal[1]]).all()
    for differ in range(1, 2**ndim):
        mine = others[:, differ - 1]
        assert (block[mine[0]] ^ block[mine[1]] == differ).all()
        pairs += sorted(set(map(tuple, mine.T.tolist())))
    size = len(block)
    assert sorted(pairs) == list(itertools.combinations_with_replacement(range(size), 2))


def test_derivatives_of_products_in_physical_units():
    scale, order = np.array([2.0, 0.5]), 2
    indices, partials = np.array([[3, 1], [2, 4], [4, 3]]), [(), (0,), (0, 1), (1, 1)]
    table = splines.function_tables(
        jnp.asarray(splines.full_axis(order)), jnp.asarray(scale), indices, partials
    )
    points, _ = quadrature(order)
    places = list(itertools.product((0, 1), (0, 1), range(order), range(order)))
    assert table.shape == (4, len(places), 3)
    for (d, axes), (p, (h, i, q, r)), n in itertools.product(
        enumerate(partials), enumerate(places), range(3)
    ):
        expected = 1.0
        for k, (half, point) in enumerate(((h, q), (i, r))):
            s = 1 + (points[point] if half == 0 else -points[point])
            count = axes.count(k)
            expected *= function(indices[n, k], s, count) * scale[k] ** count
        assert float(table[d, p, n]) == pytest.approx(expected, abs=1e-10)


def test_products_of_hessians_are_sums_over_the_common_axis(rng):
    """sum_c f_ac g_bc + f_bc g_ac over two, and without the half for a < b."""
    hessians = rng.normal(size=(3, 4, 16))
    pairs = [(0, 0), (0, 1), (1, 1)]
    full = hessians[[0, 1, 1, 2]].reshape(2, 2, 4, 16)
    equal, others = splines.product_tables(jnp.asarray(hessians), 2)
    for ours, entries in zip((equal, others), splines.block_entries(2), strict=True):
        rows, columns = entries
        f, g = full[..., rows], full[..., columns]
        expected = [
            (1.0 if a < b else 0.5) * sum(f[a, c] * g[b, c] + f[b, c] * g[a, c] for c in (0, 1))
            for a, b in pairs
        ]
        expected = np.moveaxis(np.stack(expected), (0, 1), (-2, -1))
        np.testing.assert_allclose(np.asarray(ours).reshape(expected.shape), expected, atol=1e-12)


def test_weights_of_points_fill_the_neighbourhood():
    for ndim, order in ((1, 3), (2, 2), (3, 2)):
        weights = splines.point_weights(ndim, order)
        assert len(weights) == (2 * order) ** ndim
        assert weights.sum() == pytest.approx(2**ndim)
    one = quadrature(3)[1]
    expected = np.tile(np.outer(one, one).ravel(), 4)
    np.testing.assert_allclose(splines.point_weights(2, 3), expected)
