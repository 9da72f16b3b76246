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
# # Isosurfaces of volumes
#
# The same samples under two interpolants: linear, what marching cubes show, and global fairing.
# Both surfaces are exact to a fraction of a cell, so what differs is the field. Samples that were
# left out say which field is nearer to the truth.
#
# Open this file in Jupyter with jupytext, or run it as a script; `CONTOURFAIR_FIGURES=folder`
# stores the pictures. Origin and licence of the data: `notebooks/data/README.md`.

# %%
import figures
import jax
import numpy as np
from matplotlib.figure import Figure

import contourfair_jax as cf
from contourfair_jax import metrics
from contourfair_jax.plot import draw_surface

jax.config.update("jax_enable_x64", True)
DATA = np.load(figures.DATA / "volumes.npz")


def both_fields(samples, spacing):
    """The samples interpolated linearly, and faired."""
    fair = cf.fair_field(samples, spacing=spacing, method=cf.GlobalFairing())
    return {"linear": metrics.bilinear_field(fair), "fair": fair}


def panels(fields, levels, view, colors, tolerance):
    """Isosurfaces of every field, side by side."""
    figure = Figure(figsize=(5 * len(fields), 5), layout="constrained")
    for k, (name, field) in enumerate(fields.items()):
        ax = figure.add_subplot(1, len(fields), k + 1, projection="3d")
        for level, color in zip(levels, colors, strict=True):
            mesh = field.isosurface(level, tolerance)
            print(f"{name}: {mesh}, {mesh.unmet} edges coarser than the tolerance")
            draw_surface(mesh, ax, *view, color=color)
        low = np.asarray(field.origin)[::-1]
        high = low + (np.asarray(field.spacing) * (np.array(field.shape) - 1))[::-1]
        ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        ax.set_box_aspect(high - low, zoom=1.5)
        ax.set_title(name)
    return figure


def rms(difference):
    return float(np.sqrt(np.mean(np.square(difference))))


# %% [markdown]
# ## A face
#
# CT of a head: samples 3.2 mm apart in every slice, slices 1.5 mm apart. Every second slice is
# given; the skin is at 500. Linear interpolation draws the steps of the grid into the skin, like
# the lines of a map. They are in the interpolant, not in the head.

# %%
face = DATA["face"].astype(float)
fields = both_fields(face[::2], (3.0, 3.2, 3.2))
skin = [(0.93, 0.8, 0.68)]
figures.show(panels(fields, [500.0], (10, -70), skin, 0.3), "volumes_face.png")

# %%
errors = {
    name: rms(np.asarray(field.refine(2))[1::2, ::2, ::2] - face[1::2])
    for name, field in fields.items()
}
for name, field in fields.items():
    print(
        f"{name:>7}: error in the slices left out {errors[name]:.1f}, "
        f"largest jump of the slope {metrics.c1_jump(field):.0e}"
    )
assert errors["fair"] < errors["linear"]

# %% [markdown]
# ## A head
#
# MR of a whole head, samples 4 mm apart. Linear interpolation terraces the forehead; what is noise
# in the samples, around the face, stays noise in both.

# %%
head = DATA["head"].astype(float)
fields = both_fields(head, 4.0)
figures.show(panels(fields, [40.0], (10, -50), skin, 0.3), "volumes_head.png")
jumps = {name: metrics.c1_jump(field) for name, field in fields.items()}
assert jumps["fair"] < 1e-6 * jumps["linear"]

# %% [markdown]
# ## A nucleon
#
# A simulated density of 41 samples along each axis, near its largest values, from every second
# sample; and, beside it, from all samples. The shell is thinner there than the steps of the grid,
# and linear interpolation tears it. The data do not come along, as their licence is not stated;
# they are drawn where the folder `CONTOURFAIR_DATA` has them as `nucleon.npz`.

# %%
nucleon = figures.real_data("nucleon.npz")
if nucleon is not None:
    density = nucleon["data"].astype(float)
    fields = both_fields(density[::2, ::2, ::2], 2.0)
    errors = {name: rms(np.asarray(field.refine(2)) - density) for name, field in fields.items()}
    for name, error in errors.items():
        print(f"{name:>7}: error at all samples {100 * error / np.ptp(density):.2f} % of the range")
    fields["all samples"] = cf.fair_field(density, method=cf.GlobalFairing())
    figures.show(panels(fields, [190.0], (15, -50), skin, 0.02), "volumes_nucleon.png")

# %% [markdown]
# ## An orbital
#
# The highest occupied orbital of benzene, of both signs, at a fifth of its largest value, from
# every third sample; and, beside it, from all samples.

# %%
orbital = DATA["orbital"][:28].astype(float)
fields = both_fields(orbital[::3, ::3, ::3], 3.0)
errors = {name: rms(np.asarray(field.refine(3)) - orbital) for name, field in fields.items()}
for name, error in errors.items():
    print(f"{name:>7}: error at all samples {100 * error / np.ptp(orbital):.2f} % of the range")
assert errors["fair"] < 0.6 * errors["linear"]

fields["all samples"] = cf.fair_field(orbital, method=cf.GlobalFairing(iterations=0))
signs = [(0.95, 0.62, 0.35), (0.45, 0.65, 0.9)]
figures.show(panels(fields, [0.04, -0.04], (25, -50), signs, 0.01), "volumes_orbital.png")
