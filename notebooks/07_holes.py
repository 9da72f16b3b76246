# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Filling holes
#
# `GlobalFairing` takes NaN for a missing sample, and fills it by the energy that makes the rest
# fair. Two real fields with missing samples follow: in both, some known samples are taken out as
# well, so that what fills them can be compared with the truth and with other methods. Whatever is
# filled is a guess, and the pictures veil it: `field.report.filled` tells which samples it is.
#
# Open this file in Jupyter with jupytext, or run it as a script; `CONTOURFAIR_FIGURES=folder`
# stores the pictures. Origin and licence of the data: `notebooks/data/README.md`.

# %%
import figures
import jax
import numpy as np
from matplotlib.figure import Figure
from scipy.interpolate import griddata
from skimage.restoration import inpaint_biharmonic

import contourfair_jax as cf
from contourfair_jax import metrics, plot

jax.config.update("jax_enable_x64", True)
DATA = np.load(figures.DATA / "holes.npz")


def draw(ax, field, levels, veiled, cmap, title):
    """Colours and lines of a field; veiled where a corner of the cell was missing."""
    image = np.asarray(field.refine(4))
    high = np.array(field.shape) - 1
    box = (-0.125, high[1] + 0.125, -0.125, high[0] + 0.125)
    ax.imshow(image, origin="lower", extent=box, cmap=cmap, vmin=levels[0], vmax=levels[-1])
    lines = field.contours(levels)
    assert metrics.crossings(lines) == 0
    plot.draw_lines(lines, ax, color="#1a1a1a", width=0.7)
    cells = veiled[:-1, :-1] | veiled[1:, :-1] | veiled[:-1, 1:] | veiled[1:, 1:]
    veil = np.ones((*cells.shape, 4))
    veil[..., 3] = 0.6 * cells
    ax.imshow(veil, origin="lower", extent=(0, high[1], 0, high[0]), zorder=5)
    ax.set(title=title, xticks=[], yticks=[], xlim=(0, high[1]), ylim=(0, high[0]))


def fillings(values):
    """The missing samples filled in four ways; the faired field."""
    missing = np.isnan(values)
    at, known = np.argwhere(~missing), values[~missing]
    scale = np.nanmax(values) - np.nanmin(values)
    field = cf.fair_field(values, method=cf.GlobalFairing())
    assert bool(field.report.converged)
    assert np.array_equal(np.asarray(field.report.filled), missing)
    filled = {
        name: griddata(at, known, tuple(np.indices(values.shape)), name)
        for name in ("nearest", "linear")
    }
    filled["biharmonic"] = scale * inpaint_biharmonic(np.nan_to_num(values) / scale, missing)
    filled["fair"] = np.asarray(field.samples)
    assert np.array_equal(filled["fair"][~missing], known)
    return filled, field


def report(filled, truth, judged):
    """Root mean square errors where samples had been taken out."""
    errors = {
        name: float(np.sqrt(np.mean((values - truth)[judged] ** 2)))
        for name, values in filled.items()
    }
    for name, error in errors.items():
        print(f"{name:>11}: {error:.3f}")
    return errors


def discs(shape, places, radius):
    """A mask of discs."""
    at = np.indices(shape)
    return np.any([np.hypot(at[0] - i, at[1] - j) <= radius for i, j in places], axis=0)


# %% [markdown]
# ## Terrain
#
# A corner of the map of Mount St Helens, 30 m apart. The map is turned against the grid, so wedges
# at its border have no data. Six round voids of 11 samples across are cut out as well.
# On terrain this rough, biharmonic inpainting is a little nearer to the truth than fairing.

# %%
terrain = DATA["st_helens"].astype(float)
terrain[terrain == -32767] = np.nan
voids = discs(terrain.shape, [(18, 18), (18, 44), (34, 60), (40, 28), (58, 14), (58, 48)], 5.5)
filled, field = fillings(np.where(voids, np.nan, terrain))
print(f"{np.isnan(terrain).sum()} samples without data, {voids.sum()} cut out; errors there, m:")
errors = report(filled, terrain, voids)
assert errors["fair"] < errors["linear"]

levels = np.arange(np.ceil(np.nanmin(terrain) / 20) * 20, np.nanmax(terrain), 20.0) + 0.5
figure = Figure(figsize=(13, 6.6), layout="constrained")
axes = figure.subplots(1, 2)
whole = cf.fair_field(terrain, method=cf.GlobalFairing())
draw(axes[0], whole, levels, np.isnan(terrain), "terrain", "the map, veiled where filled")
draw(axes[1], field, levels, voids | np.isnan(terrain), "terrain", "with voids, filled")
figures.show(figure, "holes_terrain.png")

# %% [markdown]
# ## Sea-surface temperature
#
# The western North Atlantic, every two degrees: land has no temperature of the sea. Filling it lets
# contours run up to the coast without corners; they are veiled beyond it. Eight discs of the sea
# are taken out, as clouds would.

# %%
sst = DATA["sst"].astype(float)
land = np.isnan(sst)
sea = np.argwhere(~land & ~discs(sst.shape, np.argwhere(land), 2.9))
chosen = sea[np.random.default_rng(3).choice(len(sea), 8, replace=False)]
clouds = discs(sst.shape, chosen, 2.9)
filled, field = fillings(np.where(clouds, np.nan, sst))
print(f"{land.sum()} samples of land, {clouds.sum()} below clouds; errors there, degrees:")
errors = report(filled, sst, clouds)
assert errors["fair"] < errors["linear"]

levels = np.arange(0.0, 31.0, 1.0)
figure = Figure(figsize=(13, 5.2), layout="constrained")
axes = figure.subplots(1, 2)
whole = cf.fair_field(sst, method=cf.GlobalFairing())
draw(axes[0], whole, levels, land, "RdYlBu_r", "land veiled")
draw(axes[1], field, levels, land | clouds, "RdYlBu_r", "with clouds, filled")
figures.show(figure, "holes_sea.png")
