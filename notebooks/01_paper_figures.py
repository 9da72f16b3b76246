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
# # Figures 1, 9 and 10 of the paper
#
# M. Bertram, *Fairing Scalar Fields by Variational Modeling of Contours*, shows local fairing on
# small synthetic samples. The samples themselves are not printed, so these are ours, of the same
# kind and size. Every panel of a figure shows the same samples (dots) and the same levels.
#
# Open this file in Jupyter with jupytext, or run it as a script; `CONTOURFAIR_FIGURES=folder`
# stores the pictures.

# %%
import figures
import jax
import numpy as np
from contourpy import contour_generator
from matplotlib.figure import Figure

import contourfair_jax as cf
from contourfair_jax.metrics import bilinear_field
from contourfair_jax.plot import compare_figure, plot_contours

jax.config.update("jax_enable_x64", True)


def faired(values, iterations):
    """Local fairing; no iterations are thin plate."""
    return cf.fair_field(values, method=cf.LocalFairing(iterations=iterations))


def inner_levels(values, count=10):
    """Levels that divide the range of the samples evenly."""
    return np.linspace(values.min(), values.max(), count + 2)[1:-1]


def lines(field, level, refine=16):
    """The contours at a level, as arrays of points in sample numbers."""
    traced = contour_generator(z=np.asarray(field.refine(refine))).lines(level)
    return [np.asarray(line) / refine for line in traced]


# %% [markdown]
# ## Figure 1: a diagonal feature
#
# A bar across 7 x 7 samples, at an angle that is not the grid's. Bilinear interpolation breaks it
# into islands. Minimal thin plate energy is smooth, but the islands stay. Fair contours run along
# the bar. The number of contours over ten levels says it: the bar itself has two per level.

# %%
axis = np.linspace(-1.0, 1.0, 7)
x, y = np.meshgrid(axis, axis, indexing="ij")
bar = np.clip(1.3 - 3.0 * np.abs(x - 0.7 * y), 0.0, 1.0)

fields = {
    "(a) bilinear": bilinear_field(faired(bar, 0)),
    "(b) thin plate": faired(bar, 0),
    "(c) fair contours": faired(bar, 2),
}
levels = inner_levels(bar)
counts = {name: sum(len(lines(f, at)) for at in levels) for name, f in fields.items()}
titled = {f"{name}: {counts[name]} contours": field for name, field in fields.items()}
figures.show(compare_figure(titled, levels), "figure_01.png", dpi=70, crop=True)

# %%
bilinear_count, plate_count, fair_count = counts.values()
assert bilinear_count > plate_count > fair_count == 2 * len(levels)

# %% [markdown]
# ## Figure 9: two local situations
#
# One vertex and its eight neighbours. The first row is an oblique edge, the second a bar that turns
# into a corner. Thin plate comes first, then the normals are renewed once, twice, ten times.
# Most of the change is in the first step; above each panel is the largest change since the panel
# before.

# %%
situations = {
    "edge": np.array([[0.0, 0.2, 1.0], [0.1, 0.7, 1.0], [0.6, 1.0, 1.0]]),
    "corner": np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 1.0], [1.0, 1.0, 0.0]]),
}
steps = {0: "(a) thin plate", 1: "(b) 1 iteration", 2: "(c) 2 iterations", 10: "(d) 10 iterations"}
figure = Figure(figsize=(16, 8.6), layout="compressed")
changes = {}
for row, (name, values) in enumerate(situations.items()):
    before = None
    for column, (iterations, title) in enumerate(steps.items()):
        field = faired(values, iterations)
        fine = np.asarray(field.refine(32))
        if before is not None:
            changes[name, iterations] = np.abs(fine - before).max()
            title += f", change {changes[name, iterations]:.3f}"
        before = fine
        ax = figure.add_subplot(2, 4, 4 * row + column + 1)
        plot_contours(field, inner_levels(values), ax=ax, limits=(0.0, 1.0), title=title)
        ax.set_axis_off()
figures.show(figure, "figure_09.png", dpi=70, crop=True)

# %%
for name in situations:
    assert changes[name, 1] > 2 * changes[name, 2] > 2 * changes[name, 10]

# %% [markdown]
# ## Figure 10: a circle from 10 x 10 samples
#
# A disk with a soft rim: every contour should be a circle. How far contours stray from their own
# mean radius, on average over the levels, is in the titles.

# %%
axis = np.linspace(-1.0, 1.0, 10)
x, y = np.meshgrid(axis, axis, indexing="ij")
disk = 1.0 / (1.0 + np.exp(12.0 * (np.hypot(x, y) - 0.6)))


def out_of_round(field):
    """Largest deviation from the mean radius over the mean radius, averaged over the levels."""
    deviations = []
    for level in inner_levels(disk):
        (line,) = lines(field, level)
        radius = np.hypot(*(line - 4.5).T)
        deviations.append(np.abs(radius - radius.mean()).max() / radius.mean())
    return np.mean(deviations)


fields = {"(a) bilinear": bilinear_field(faired(disk, 0)), "(b) two iterations": faired(disk, 2)}
strays = {name: out_of_round(field) for name, field in fields.items()}
titled = {f"{name}: {100 * strays[name]:.1f} % out of round": f for name, f in fields.items()}
figures.show(compare_figure(titled, inner_levels(disk)), "figure_10.png", dpi=70, crop=True)

# %%
bilinear_stray, fair_stray = strays.values()
assert fair_stray < 0.5 * bilinear_stray
