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
# # Gallery: contours one can trust
#
# Real samples under three interpolants: bilinear, what every plotting library draws; local fairing,
# the method of the paper; and global fairing. The lines are exact: every vertex lies on its field,
# chords stay within a hundredth of a cell, and no two lines cross. Each picture is followed by a
# table: length, total turning, bending energy, number of parts and holes, summed over the levels.
#
# Open this file in Jupyter with jupytext, or run it as a script; `CONTOURFAIR_FIGURES=folder`
# stores the pictures. Origin and licence of the data: `notebooks/data/README.md`.

# %%
import figures
import jax
import numpy as np
from matplotlib.figure import Figure
from scipy.interpolate import RectBivariateSpline

import contourfair_jax as cf
from contourfair_jax import metrics, plot
from contourfair_jax.io import example

jax.config.update("jax_enable_x64", True)
DATA = np.load(figures.DATA / "gallery.npz")


def three_fields(values, spacing):
    """The same samples under three interpolants."""
    local = cf.fair_field(np.asarray(values, float), spacing=spacing)
    smooth = cf.fair_field(np.asarray(values, float), spacing=spacing, method=cf.GlobalFairing())
    return {
        "bilinear": metrics.bilinear_field(local),
        "fair, local": local,
        "fair, global": smooth,
    }


def panels(fields, levels, upward=False, width=0.9):
    """Bands and lines of every field, side by side."""
    figure = Figure(figsize=(15, 5.6), layout="constrained")
    for ax, (name, field) in zip(figure.subplots(1, len(fields)), fields.items(), strict=True):
        bands = plot.draw_filled(field.filled([-np.inf, *levels, np.inf]), ax)
        bands.set_cmap("viridis")
        lines = field.contours(levels)
        assert metrics.crossings(lines) == 0
        assert lines.unproved == 0
        plot.draw_lines(lines, ax, color="#1a1a1a", width=width)
        high = np.asarray(field.spacing) * (np.array(field.shape) - 1)
        ax.set(xlim=(0, high[1]), ylim=(0, high[0]) if upward else (high[0], 0), aspect="equal")
        ax.set(title=name, xticks=[], yticks=[])
    return figure


def table(fields, levels):
    """Metrics of the lines, summed over the levels."""
    print(f"{'':>14} {'length':>10} {'turning/2pi':>12} {'bending':>10} {'parts':>6} {'holes':>6}")
    found = {}
    for name, field in fields.items():
        step = 0.25 * float(np.min(np.asarray(field.spacing)))
        levelled = metrics.level_metrics(field.contours(levels, 1e-3), step)
        found[name] = np.sum(
            [
                [m.length, m.turning / (2 * np.pi), m.bending, m.components, m.holes]
                for m in levelled
            ],
            axis=0,
        )
        length, turning, bending, parts, holes = found[name]
        print(
            f"{name:>14} {length:10.4g} {turning:12.1f} {bending:10.4g} {parts:6.0f} {holes:6.0f}"
        )
    return found


# %% [markdown]
# ## Terrain
#
# Ridges and valleys around the Jacksboro fault, every 20 m. Elevations are integers, and the ridges
# run obliquely to the grid.

# %%
terrain = example("jacksboro").crop(((164, 198), (210, 244)))
levels = np.arange(290.0, 900.0, 20.0) + 0.5
fields = three_fields(terrain.values, terrain.spacing)
figures.show(panels(fields, levels), "gallery_terrain.png", crop=True)
found = table(fields, levels)
assert found["fair, global"][2] < found["bilinear"][2]

# %% [markdown]
# ## Isobars
#
# Pressure on a grid of 22 x 36 samples, isobars every 4 hPa. Nobody would draw the corners that
# bilinear interpolation has at the edges of its cells by hand. Bending energy is that of a loop
# times its curvature, so one loop that is smaller than a cell can outweigh many long lines.

# %%
pressure = DATA["pressure"] / 100.0
levels = np.arange(984.0, 1032.0, 4.0)
fields = three_fields(pressure, (1.0, 1.0))
figures.show(panels(fields, levels, upward=True), "gallery_isobars.png", crop=True)
found = table(fields, levels)
assert found["fair, local"][2] < 0.7 * found["bilinear"][2]

# %% [markdown]
# ## A CT slice
#
# A vertebra: lung, tissue and bone. Noise of the tissue stays noise, with smooth lines.

# %%
ct = DATA["ct"][2:82, 20:100]
levels = np.array([-400.0, 160.0, 350.0])
fields = three_fields(ct, (0.661468, 0.661468))
figures.show(panels(fields, levels), "gallery_ct.png", crop=True)
found = table(fields, levels)
assert found["fair, global"][2] < found["bilinear"][2]

# %% [markdown]
# ## A head
#
# Samples 3.2 mm apart: skin (500) and bone (1150). The thin walls of the sinuses are one sample
# wide.

# %%
head = DATA["head"][3:61, 4:60]
levels = np.array([500.0, 1150.0])
fields = three_fields(head, (3.2, 3.2))
figures.show(panels(fields, levels, width=1.1), "gallery_head.png", crop=True)
found = table(fields, levels)
assert found["fair, global"][2] < found["bilinear"][2]

# %% [markdown]
# ## Where parts merge
#
# `metrics.compare` follows the parts above and below every level, and says where the fair field
# joins what bilinear interpolation had torn, or separates what it had joined.

# %%
terrain_field = cf.fair_field(terrain.values.astype(float), spacing=terrain.spacing)
comparison = metrics.compare(terrain_field)
print(comparison)
for change in comparison.changes[:8]:
    print(change)
assert any(change.kind == "merged" for change in comparison.changes)

# %% [markdown]
# ## Waves that the samples just resolve
#
# Rings after Marschner and Lobb, with hardly more than two samples to a wave at the corner: the
# truth, the cubic spline through 41 x 41 samples of it, and the field with the settings that
# `tune` chooses from the same samples. A quarter is shown.

# %%
FINER = 8
coarse, fine = (np.linspace(-1.0, 1.0, 40 * k + 1) for k in (1, FINER))


def rings(axis):
    radius = np.hypot(axis[:, None], axis[None, :])
    return np.cos(12 * np.pi * np.cos(np.pi * radius / 2))


samples = rings(coarse)
spline = RectBivariateSpline(coarse, coarse, samples, s=0)(fine, fine)
tuned = cf.fair_field(samples, method=cf.tune(samples))
plate = cf.LocalFairing(iterations=0)
fields = {
    "truth": cf.fair_field(rings(fine), spacing=1 / FINER, method=plate),
    "cubic spline": cf.fair_field(spline, spacing=1 / FINER, method=plate),
    "fair, tuned": tuned,
}
levels = np.array([-0.6, -0.2, 0.2, 0.6])
figure = panels(fields, levels)
for ax in figure.axes:
    ax.set(xlim=(0, 20), ylim=(20, 0))
figures.show(figure, "gallery_waves.png", colors=24, crop=True)
found = table(fields, levels)
parts = {name: row[3] for name, row in found.items()}
assert abs(parts["fair, tuned"] - parts["truth"]) < 0.02 * parts["truth"]
assert parts["cubic spline"] > 1.5 * parts["truth"]
error, other = (np.std(each - rings(fine)) for each in (tuned.refine(FINER), spline))
print(f"root mean square error: tuned {error:.4f}, spline {other:.4f}")
assert error < other / 4

# %% [markdown]
# ## Noise
#
# The same waves, on 61 x 61 samples, with noise of a quarter of their standard deviation. Through
# every sample, the contours are those of the noise. `tune` with `noisy=True` finds from the samples
# alone how far to trust them; SciPy's smoothing spline is told the noise. A quarter is shown.

# %%
coarse, fine = (np.linspace(-1.0, 1.0, 60 * k + 1) for k in (1, FINER))
truth = rings(coarse)
noise = 0.25 * truth.std()
noisy = truth + noise * np.random.default_rng(0).normal(size=truth.shape)
method = cf.tune(noisy, noisy=True)
smooth = cf.fair_field(noisy, method=method)
spline = RectBivariateSpline(coarse, coarse, noisy, s=noise**2 * noisy.size)(fine, fine)
fields = {
    "fair, through every sample": cf.fair_field(noisy, method=cf.tune(noisy)),
    "smoothing spline": cf.fair_field(spline, spacing=1 / FINER, method=plate),
    "fair, tuned with noise": smooth,
}
figure = panels(fields, levels)
for ax in figure.axes:
    ax.set(xlim=(0, 30), ylim=(30, 0))
figures.show(figure, "gallery_noise.png", colors=24, crop=True)
truth = cf.fair_field(rings(fine), spacing=1 / FINER, method=plate)
found = table({"truth": truth, **fields}, levels)
assert found["fair, tuned with noise"][1] < 1.1 * found["truth"][1]
errors = {
    name: np.std(field.refine(FINER // (field.shape[0] // 60)) - rings(fine))
    for name, field in fields.items()
}
print(f"noise {noise:.3f}, found {float(method.sigma):.3f}; root mean square errors:")
print({name: round(float(error), 3) for name, error in errors.items()})
assert errors["fair, tuned with noise"] < 0.8 * errors["smoothing spline"]

# %% [markdown]
# ## Convergence
#
# How much each renewal of the normals changes the field of `GlobalFairing`, in units of the
# samples' spread, for samples of this gallery. The first solve, without normals, is renewal 0.
# Terrain is near the limit after three, the default; waves that are hardly resolved need some three
# more, and with noise, whose weight is found on the way, one more again.

# %%
RENEWALS = 10
several = {
    "terrain": terrain.values,
    "waves": samples,
    "noisy waves": noisy,
}
figure = Figure(figsize=(6, 4), layout="constrained")
ax = figure.subplots()
for name, values in several.items():
    sigma = noise if name == "noisy waves" else None
    exact = cf.GlobalFairing(iterations=RENEWALS, tolerance=1e-8, sigma=sigma)
    updates = np.asarray(cf.fair_field(np.asarray(values, float), method=exact).report.updates)
    ax.semilogy(range(RENEWALS + 1), updates, "o-", markersize=4, label=name)
    print(f"{name:<12}", *(f"{update:.1e}" for update in updates))
    assert updates[-1] < updates[1] / 10
ax.set(xlabel="renewal of the normals", ylabel="largest change / spread of the samples")
ax.grid(alpha=0.3)
ax.legend()
figures.show(figure, "gallery_convergence.png", colors=32)
