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
# # Learning contours
#
# A small network reads coarse and noisy terrain, every fifth sample, and has to say where the land
# is above a level. It is trained on masks at full resolution, through an upsampling layer at its
# end: bilinear or `FairUpsample`. What counts is the *contour*: how far, on average, the border of
# its answer is from the true border. The network, its start, the data, the noise and the training
# are the same for both.
#
# Open this file in Jupyter with jupytext, or run it as a script; `CONTOURFAIR_FIGURES=folder`
# stores the pictures.

# %%
import io
import os
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import PIL.Image
from IPython.display import Image, display
from matplotlib.figure import Figure
from scipy.spatial import cKDTree
from skimage.measure import find_contours

import contourfair_jax as cf
from contourfair_jax.io import example

FOLDER = os.environ.get("CONTOURFAIR_FIGURES")
FACTOR, SIZE, NOISE = 5, 10, 0.3
FINE = FACTOR * (SIZE - 1) + 1

# %% [markdown]
# ## Data
#
# Patches of the bundled terrain. The level of each is the median of its coarse samples, so every
# mask has a long border. Training patches come from the northern two thirds, test patches from the
# rest. The noise is 0.3 of the spread of a patch, drawn anew in every step of the training.

# %%
terrain = example("jacksboro").values.astype("float32")


def patches(rows, step):
    """Coarse samples, and full ones, of all patches: relative to the level, in units of spread."""
    coarse, full = [], []
    for i in range(rows[0], rows[1] - FINE + 1, step):
        for j in range(0, terrain.shape[1] - FINE + 1, step):
            patch = terrain[i : i + FINE, j : j + FINE]
            samples = patch[::FACTOR, ::FACTOR]
            level = np.median(samples) + 0.5  # between the integers
            coarse.append((samples - level) / samples.std())
            full.append((patch - level) / samples.std())
    return np.stack(coarse), np.stack(full)


train, train_full = patches((0, 229), 23)
test, test_full = patches((229, terrain.shape[0]), 23)
masks = (train_full > 0).astype("float32")
noisy = test + NOISE * np.random.default_rng(1).normal(size=test.shape).astype("float32")
print(f"{len(train)} patches to learn from, {len(test)} to test")

# %% [markdown]
# ## Network and training
#
# Three convolutions that add to the samples they are given; 5 000 weights. The loss is the cross
# entropy of the mask, at full resolution.


# %%
class Network(eqx.Module):
    """Corrects coarse samples, then upsamples them."""

    layers: list
    upsample: eqx.Module

    def __init__(self, upsample, key):
        keys = jax.random.split(key, 3)
        sizes = ((1, 20), (20, 20), (20, 1))
        self.layers = [
            eqx.nn.Conv2d(n, m, 3, padding=1, padding_mode="REPLICATE", key=k)
            for (n, m), k in zip(sizes, keys, strict=True)
        ]
        self.upsample = upsample

    def __call__(self, samples):
        x = samples[None]
        for layer in self.layers[:-1]:
            x = jax.nn.relu(layer(x))
        return self.upsample(samples + 0.1 * self.layers[-1](x)[0])


class Bilinear(eqx.Module):
    """Bilinear upsampling on the same points as `FairUpsample`."""

    def __call__(self, x):
        at = jnp.arange(FINE) / FACTOR
        weights = jnp.maximum(1 - jnp.abs(at[:, None] - jnp.arange(x.shape[0])), 0)
        return weights @ x @ weights.T


@eqx.filter_jit
def loss(network, samples, target):
    logits = 4 * jax.vmap(network)(samples)
    return jnp.mean(optax.sigmoid_binary_cross_entropy(logits, target))


def trained(network, steps=250, batch=16):
    """The network after training, and its losses."""
    optimiser = optax.adam(optax.cosine_decay_schedule(3e-3, steps))
    state = optimiser.init(eqx.filter(network, eqx.is_inexact_array))

    @eqx.filter_jit
    def step(network, state, samples, target):
        value, slope = eqx.filter_value_and_grad(loss)(network, samples, target)
        updates, state = optimiser.update(slope, state)
        return eqx.apply_updates(network, updates), state, value

    rng, losses = np.random.default_rng(0), []
    for _ in range(steps):
        chosen = rng.choice(len(train), batch, replace=False)
        given = train[chosen] + NOISE * rng.normal(size=(batch, SIZE, SIZE)).astype("float32")
        network, state, value = step(network, state, given, masks[chosen])
        losses.append(float(value))
    return network, losses


fair = cf.FairUpsample(FACTOR, method=cf.LocalFairing(iterations=1))
layers = {"bilinear": Bilinear(), "fair": fair}
networks = {name: Network(layer, jax.random.key(0)) for name, layer in layers.items()}
history = {}
for name, network in networks.items():
    networks[name], history[name] = trained(network)
    print(f"{name}: loss {history[name][0]:.4f}, at the end {np.mean(history[name][-20:]):.4f}")

# %% [markdown]
# ## Border error
#
# Mean distance between the borders, both ways, in samples of the full terrain; and the share of
# samples on the wrong side. Beside the networks, what either upsampling does without one.


# %%
def border_error(found, truth):
    """Mean distance of the points of either border from the other one."""
    borders = [np.concatenate(find_contours(np.asarray(each), 0.0)) for each in (found, truth)]
    there, back = (cKDTree(a).query(b)[0] for a, b in (borders, borders[::-1]))
    return (there.mean() + back.mean()) / 2


answers = {f"{name}, no network": jax.vmap(layer)(noisy) for name, layer in layers.items()}
answers |= {f"{name}, network": jax.vmap(network)(noisy) for name, network in networks.items()}
errors = {
    name: np.array([border_error(a, b) for a, b in zip(answer, test_full, strict=True)])
    for name, answer in answers.items()
}
print(f"{'':>22} {'border':>8} {'wrong side':>11}")
for name, answer in answers.items():
    wrong = np.mean((np.asarray(answer) > 0) != (test_full > 0))
    print(f"{name:>22} {errors[name].mean():8.3f} {100 * wrong:9.2f} %")
difference = errors["bilinear, network"] - errors["fair, network"]
print(
    f"fair is nearer by {difference.mean():.3f} +- {difference.std() / len(test) ** 0.5:.3f} "
    f"on average, and in {np.mean(difference > 0):.0%} of the patches"
)

# %%
figure = Figure(figsize=(12, 4.4), layout="constrained")
for ax, k in zip(
    figure.subplots(1, 3), np.argsort(difference)[[-1, len(test) // 2, 0]], strict=True
):
    ax.imshow(test_full[k] > 0, cmap="Greys", alpha=0.35, interpolation="nearest")
    for name, color in (("bilinear, network", "tab:orange"), ("fair, network", "tab:blue")):
        for number, line in enumerate(find_contours(np.asarray(answers[name][k]), 0.0)):
            ax.plot(line[:, 1], line[:, 0], color=color, lw=1.6, label=None if number else name)
    both = [errors[f"{name}, network"][k] for name in layers]
    ax.set(title="bilinear {:.2f}, fair {:.2f}".format(*both))
    ax.set(xticks=[], yticks=[])
ax.legend(loc="lower right")
figure.suptitle("border error: the patch best for fair, the median, the worst; truth in grey")
drawn, small = io.BytesIO(), io.BytesIO()
figure.savefig(drawn, format="png", dpi=80)
PIL.Image.open(drawn).convert("RGB").quantize(128).save(small, format="png", optimize=True)
if FOLDER:
    Path(FOLDER).mkdir(parents=True, exist_ok=True)
    (Path(FOLDER) / "learning_contours.png").write_bytes(small.getvalue())
display(Image(small.getvalue()))
for name in networks:
    assert np.mean(history[name][-20:]) < history[name][0]
    assert errors[f"{name}, network"].mean() < errors["bilinear, no network"].mean()
