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
# # How a volume depends on every voxel
#
# The other way round through fairing: from a measure of an isosurface back to the samples. The
# volume within the surface is differentiable in all of them, by one reverse pass. So a fit can
# steer it, and the noise of the samples says how uncertain it is.
#
# Open this file in Jupyter with jupytext, or run it as a script; `CONTOURFAIR_FIGURES=folder`
# stores the pictures. Origin and licence of the data: `notebooks/data/README.md`.

# %%
import figures
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import contourfair_jax as cf
from contourfair_jax import geometry

jax.config.update("jax_enable_x64", True)


# %% [markdown]
# ## The volume of an orbital
#
# Every third sample of the highest occupied orbital of benzene, 1 Bohr apart; the surface is where
# it is 0.04. `geometry.volume` takes an isosurface, found on the host, and ties its vertices to
# the field; like `surface.volume` it is negative around larger values. A point of the surface moves
# by `df / |grad f|`: voxels near the surface count, most where the field is flat.

# %%
samples = jnp.asarray(
    np.load(figures.DATA / "volumes.npz")["orbital"][:28:3, ::3, ::3].astype(float)
)
level = 0.04


@jax.jit
def fair(samples):
    return cf.fair_field(samples, method=cf.GlobalFairing(iterations=1))


surface = fair(samples).isosurface(level, 0.02)
assert surface.watertight


def within(samples):
    return -geometry.volume(fair(samples), surface)


volume, sensitivity = jax.jit(jax.value_and_grad(within))(samples)
noise = 0.001 * float(jnp.sqrt(jnp.sum(sensitivity**2)))
print(f"volume {float(volume):.2f} cubic Bohr, {len(surface.triangles)} triangles")
print(f"noise of 0.001 in every sample makes it uncertain by {noise:.2f} cubic Bohr")
assert sensitivity.shape == samples.shape
assert abs(float(volume) + surface.volume) < 1e-3 * float(
    volume
)  # inwards is towards larger values

# %% [markdown]
# Against differences: samples are changed, and surfaces found anew. First all samples, each by
# another amount up to 0.001, then the most influential one alone. As derivatives are those of the
# polygons, they are as good as the mesh: on surfaces that it barely resolves, such as thin bone in
# a coarse CT, we saw derivatives a quarter too small.


# %%
def counted(samples):
    """Volume within the surface of other samples."""
    return -fair(samples).isosurface(level, 0.02).volume


most = np.unravel_index(int(jnp.argmax(jnp.abs(sensitivity))), samples.shape)
single = np.zeros(samples.shape)
single[most] = 0.002
uneven = np.random.default_rng(0).uniform(0.0, 0.001, samples.shape)
for what, change in (("all samples", uneven), (f"sample {tuple(map(int, most))}", single)):
    difference = counted(samples + change) - counted(samples - change)
    along = 2 * float(jnp.sum(sensitivity * change))
    print(f"{what}: the volume changes by {difference:.4f}, by its derivative {along:.4f}")
    assert abs(along - difference) < 0.03 * abs(difference)

# %% [markdown]
# In three slices: the derivative with respect to every sample, and the outline of the surface.
# Some samples away from the surface count as negative, as a smooth field through samples swings a
# little.

# %%
fine = np.asarray(fair(samples).refine(8))
strength = float(jnp.max(jnp.abs(sensitivity)))
figure = Figure(figsize=(13, 4.6), layout="constrained")
for ax, k in zip(figure.subplots(1, 3), (2, 3, 6), strict=True):
    shown = ax.imshow(sensitivity[k], cmap="RdBu_r", vmin=-strength, vmax=strength, origin="lower")
    rows, columns = (np.arange(n) / 8 for n in fine[8 * k].shape)
    ax.contour(columns, rows, fine[8 * k], [level], colors="black", linewidths=1.5)
    ax.set(title=f"slice {k}", xticks=[], yticks=[])
figure.colorbar(shown, ax=ax, label="cubic Bohr per unit of the orbital")
figures.show(figure, "sensitivity.png")
