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
# # Inverse problems, and how sure their answers are
#
# First, terrain from digitised contour lines alone: `fit_samples` finds the samples whose field has
# these contours, and says how uncertain it is where. Then the other way round: how the volume
# within an isosurface depends on every voxel of a CT, by one reverse pass through the fairing.
#
# Open this file in Jupyter with jupytext, or run it as a script; `CONTOURFAIR_FIGURES=folder`
# stores the pictures. Origin and licence of the data: `notebooks/data/README.md`.

# %%
import io
import os
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import PIL.Image
from IPython.display import Image, display
from matplotlib.figure import Figure
from scipy.interpolate import griddata
from skimage.measure import find_contours

import contourfair_jax as cf
from contourfair_jax import export, geometry
from contourfair_jax.inverse import ContourLines, ThinPlate, fit_samples
from contourfair_jax.io import example

jax.config.update("jax_enable_x64", True)
FOLDER = os.environ.get("CONTOURFAIR_FIGURES")
HERE = Path("notebooks/data") if Path("notebooks/data").is_dir() else Path("data")


def show(figure, name):
    """Display a figure, and store it where asked."""
    drawn, small = io.BytesIO(), io.BytesIO()
    figure.savefig(drawn, format="png", dpi=80, bbox_inches="tight")
    PIL.Image.open(drawn).convert("RGB").quantize(128).save(small, format="png", optimize=True)
    if FOLDER:
        Path(FOLDER).mkdir(parents=True, exist_ok=True)
        (Path(FOLDER) / name).write_bytes(small.getvalue())
    display(Image(small.getvalue()))


# %% [markdown]
# ## Terrain from its contours
#
# The lines are those of real terrain, every 40 m, drawn by bilinear interpolation, which favours
# neither method. What was measured between them is not given. Linear gridding, over a triangulation
# of the points of the lines, makes terraces: a triangle with all corners on one line is flat.

# %%
terrain = example("jacksboro").crop(((164, 196), (200, 232))).values.astype(float)
levels = np.arange(np.ceil(terrain.min() / 40) * 40, terrain.max(), 40.0) + 0.5
lines = [(level, line) for level in levels for line in find_contours(terrain, level)]
fit = fit_samples(
    ContourLines(lines, sigma=1.0),
    terrain.shape,
    method=cf.LocalFairing(iterations=0),
    regularisation=ThinPlate(weight=0.01),
)
assert bool(fit.converged)
points = np.concatenate([line for _, line in lines])
known = np.concatenate([np.full(len(line), level) for level, line in lines])
gridded = griddata(points, known, tuple(np.indices(terrain.shape)), "linear")
inside = ~np.isnan(gridded)


def rms(values):
    return float(np.sqrt(np.mean((np.asarray(values) - terrain)[inside] ** 2)))


missed = float(jnp.std(fit.residuals[0]))
print(f"{len(lines)} lines, missed by {missed:.2f} m; steps: {int(fit.steps)}")
print(f"error at the samples: linear gridding {rms(gridded):.2f} m, fit {rms(fit.samples):.2f} m")
assert rms(fit.samples) < rms(gridded)

# %% [markdown]
# ## Uncertainty
#
# `standard_deviation` of any number that depends on the field: here the height at every second
# sample. It takes sigma for the noise of the lines, and the regularisation for how rough terrain
# is, `sigma / sqrt(weight)` from one sample to the next, 10 m here. Near lines heights are known to
# a metre or so, on wide slopes between them and at the border to several.

# %%
places = jnp.asarray(np.indices(terrain.shape)[:, ::2, ::2].reshape(2, -1).T, dtype=float)
deviation = jax.vmap(lambda place: fit.standard_deviation(lambda field: field(place)))(places)
deviation = np.asarray(deviation).reshape(terrain[::2, ::2].shape)
error = np.abs(np.asarray(fit.samples) - terrain)[::2, ::2]
print(f"deviation {deviation.min():.1f} to {deviation.max():.1f} m")
print(f"errors within two deviations: {np.mean(error < 2 * deviation):.0%}")
assert np.corrcoef(error.ravel(), deviation.ravel())[0, 1] > 0.2

figure = Figure(figsize=(13.5, 4.6), layout="constrained")
axes = figure.subplots(1, 3)
fine = np.arange(levels[0], levels[-1] + 1, 20.0)
for ax, values, title in (
    (axes[0], terrain, "the terrain, lines every 20 m"),
    (axes[1], fit.samples, "fit to the lines every 40 m alone"),
):
    export.draw_lines(cf.fair_field(values).contours(fine), ax, color="#1a1a1a", width=0.8)
    ax.set(title=title, aspect="equal", xlim=(0, 31), ylim=(31, 0), xticks=[], yticks=[])
for _, line in lines:
    axes[1].plot(line[:, 1], line[:, 0], color="tab:orange", lw=2, alpha=0.6, zorder=0)
image = axes[2].imshow(deviation, extent=(-1, 31, 31, -1), cmap="viridis")
for _, line in lines:
    axes[2].plot(line[:, 1], line[:, 0], color="white", lw=0.8)
axes[2].set(title="standard deviation, m", xlim=(0, 31), ylim=(31, 0), xticks=[], yticks=[])
figure.colorbar(image, ax=axes[2])
show(figure, "inverse_contours.png")

# %% [markdown]
# ## How a volume depends on every voxel
#
# A piece of a head, CT; bone is above 1150. Air is put around it, so that the surface closes. By
# how much would the volume of bone change if one voxel were measured higher? `geometry.volume` is
# differentiable in all samples: voxels near the surface count, most where the edge of the bone is
# soft, as a point of the surface moves by `df / |grad f|`.

# %%
head = np.pad(np.load(HERE / "head_volume.npz")["head"].astype(float), 1)
spacing, level = (1.5, 3.2, 3.2), 1150.0


def fair(samples):
    return cf.fair_field(samples, spacing=spacing, method=cf.GlobalFairing(iterations=1))


surface = fair(head).isosurface(level)


@jax.jit
def bone(samples):
    return geometry.volume(fair(samples), surface.vertices, surface.triangles, level)


volume, sensitivity = jax.value_and_grad(bone)(head)
print(f"bone: {float(volume) / 1e3:.2f} cubic cm, {len(surface.triangles)} triangles")
noise = 10.0 * float(jnp.sqrt(jnp.sum(sensitivity**2)))
print(f"noise of 10 in every voxel makes it uncertain by {noise / 1e3:.3f} cubic cm")

# %% [markdown]
# Against differences: the samples are changed along a random direction, and the surfaces of both
# found anew.


# %%
def counted(samples):
    """Volume within the surface of other samples."""
    field = fair(samples)
    found = field.isosurface(level)
    return float(geometry.volume(field, found.vertices, found.triangles, level))


direction = np.random.default_rng(0).normal(size=head.shape)
difference = counted(head + direction) - counted(head - direction)
along = 2 * float(jnp.sum(sensitivity * direction))
print(f"change of the volume: {difference:.3f} cubic mm, by its derivative {along:.3f}")
assert abs(along - difference) < 0.05 * abs(difference)

figure = Figure(figsize=(13, 4.4), layout="constrained")
sensitivity = np.asarray(sensitivity)
reach = float(np.percentile(sensitivity, 99.8))
for ax, k in zip(figure.subplots(1, 3), (6, 13, 20), strict=True):
    ax.imshow(head[k], cmap="Greys_r")
    strength = np.clip(sensitivity[k] / reach, 0, 1)
    shown = ax.imshow(sensitivity[k], cmap="autumn", vmin=0, vmax=reach, alpha=strength)
    ax.set(title=f"slice {k}", xticks=[], yticks=[])
figure.colorbar(shown, ax=ax, label="cubic mm per CT number")
figure.suptitle("how much the volume of bone depends on each voxel")
show(figure, "inverse_volume.png")
