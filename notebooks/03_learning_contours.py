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
# A small network reads a coarse image of a smooth shape, 10 x 10 pixels with noise, and has to draw
# its outline. It is trained on masks that are four times finer, through an upsampling layer at its
# end: bilinear or `FairUpsample`. What counts is the *contour*: how far the outline of its answer
# is from the true one, in pixels of the coarse image. Data, noise, network, its start and the
# training are the same for both layers.
#
# Open this file in Jupyter with jupytext, or run it as a script; `CONTOURFAIR_FIGURES=folder`
# stores the pictures.

# %%
import equinox as eqx
import figures
import jax
import jax.numpy as jnp
import numpy as np
import optax
from matplotlib.figure import Figure
from scipy.spatial import cKDTree
from skimage.measure import find_contours

import contourfair_jax as cf

jax.config.update("jax_enable_x64", False)  # networks are trained in float32
SIZE, FACTOR, NOISE = 10, 4, 0.03


# %% [markdown]
# ## Shapes
#
# Ovals with a threefold dent, in the middle of the image, at any angle, 2 to 7 pixels wide.
# A pixel is the share of its area that the shape covers, as in a photograph or a CT; the target is
# whether each place of the finer grid is inside.


# %%
def draw_shapes(rng, count):
    """Parameters of shapes: centre, half axes, angle, dent and its angle."""

    def uniform(low, high):
        return rng.uniform(low, high, (count, 1, 1))

    centre = SIZE / 2 - 0.5
    return {
        "at": [uniform(centre - 0.7, centre + 0.7) for _ in range(2)],
        "axes": [uniform(2.2, 3.5), uniform(1.0, 2.2)],
        "angle": uniform(0, np.pi),
        "dent": uniform(0.0, 0.12),
        "turn": uniform(0, 2 * np.pi),
    }


def radius(shapes, phi):
    """Distance of the outline from the centre, in the direction phi from the long axis."""
    long, short = shapes["axes"]
    oval = 1 / np.hypot(np.cos(phi) / long, np.sin(phi) / short)
    return oval * (1 + shapes["dent"] * np.cos(3 * phi + shapes["turn"]))


def inside(shapes, axis):
    """Which points of the grid with this axis are inside, shape (count, n, n)."""
    x, y = np.meshgrid(axis, axis, indexing="ij")
    dx, dy = x - shapes["at"][0], y - shapes["at"][1]
    return np.hypot(dx, dy) < radius(shapes, np.arctan2(dy, dx) - shapes["angle"])


def outlines(shapes, count=720):
    """Points of the true outlines, shape (count of shapes, points, 2)."""
    phi = np.linspace(0, 2 * np.pi, count, endpoint=False)[None, None]
    far, theta = radius(shapes, phi), phi + shapes["angle"]
    points = [shapes["at"][0] + far * np.cos(theta), shapes["at"][1] + far * np.sin(theta)]
    return np.concatenate(points, axis=1).transpose(0, 2, 1)


def dataset(seed, count, parts=8):
    """Images with noise, masks on the finer grid, true outlines."""
    rng = np.random.default_rng(seed)
    shapes = draw_shapes(rng, count)
    axis = (np.arange(SIZE * parts) + 0.5) / parts - 0.5
    covered = inside(shapes, axis).reshape(count, SIZE, parts, SIZE, parts).mean((2, 4))
    images = covered + NOISE * rng.normal(size=covered.shape)
    masks = inside(shapes, np.arange(FACTOR * (SIZE - 1) + 1) / FACTOR)
    return images.astype("float32"), masks.astype("float32"), outlines(shapes)


images, masks, _ = dataset(0, 1500)
test_images, _, truth = dataset(1, 200)

# %% [markdown]
# ## Network and training
#
# Four convolutions from the image to one number per pixel, from which the upsampling layer makes
# the logits of the finer grid. The loss is the cross entropy of the mask there, and nothing else.


# %%
class Network(eqx.Module):
    """Convolutions to coarse logits, and what makes them finer."""

    layers: list

    def __init__(self, key):
        keys = jax.random.split(key, 4)
        sizes = ((1, 24), (24, 24), (24, 24), (24, 1))
        self.layers = [
            eqx.nn.Conv2d(n, m, 3, padding=1, key=k) for (n, m), k in zip(sizes, keys, strict=True)
        ]

    def __call__(self, image):
        x = image[None]
        for layer in self.layers[:-1]:
            x = jax.nn.gelu(layer(x))
        return 4 * (image - 0.5) + self.layers[-1](x)[0]


def bilinear(factor):
    """Bilinear upsampling to the points of `FairUpsample`."""

    def upsample(x):
        at = jnp.arange(factor * (x.shape[-1] - 1) + 1) / factor
        weights = jnp.maximum(1 - jnp.abs(at[:, None] - jnp.arange(x.shape[-1])), 0)
        return weights @ x @ weights.T

    return upsample


def fair(factor):
    """Global fairing, its normals renewed once."""
    return cf.FairUpsample(factor, method=cf.GlobalFairing(iterations=1, tolerance=1e-3))


LAYERS = {"bilinear": bilinear, "fair": fair}


def trained(upsample, seed, steps=400, batch=16):
    """The network after training, and its losses."""
    network = Network(jax.random.key(seed))
    optimiser = optax.adam(optax.cosine_decay_schedule(4e-3, steps))
    state = optimiser.init(eqx.filter(network, eqx.is_inexact_array))

    def loss(network, given, target):
        logits = upsample(jax.vmap(network)(given))
        return jnp.mean(optax.sigmoid_binary_cross_entropy(logits, target))

    @eqx.filter_jit
    def step(network, state, given, target):
        value, slope = eqx.filter_value_and_grad(loss)(network, given, target)
        updates, state = optimiser.update(slope, state)
        return eqx.apply_updates(network, updates), state, value

    rng, losses = np.random.default_rng(seed), []
    for _ in range(steps):
        chosen = rng.choice(len(images), batch, replace=False)
        network, state, value = step(network, state, images[chosen], masks[chosen])
        losses.append(float(value))
    return network, losses


networks, history = {}, {}
for name, layer in LAYERS.items():
    networks[name], history[name] = trained(layer(FACTOR), 0)
    print(f"{name}: loss {history[name][0]:.4f}, at the end {np.mean(history[name][-50:]):.4f}")

# %% [markdown]
# ## Boundary error
#
# Mean distance between outlines, both ways, of 200 new shapes. The outline of an answer is that of
# its own interpolant, traced on a grid 16 times finer than the image. Beside the networks is what
# either layer draws without one, at half of full cover. Training takes away most of the bias of
# bilinear upsampling, as the network learns to push its numbers outwards; corners at the edges of
# cells remain, and fairing has none. Where boundaries are rough, as those of terrain, we saw no
# gain from fairing.


# %%
def border(fine):
    """Points of the outline of one answer, in pixels of the coarse image."""
    return np.concatenate(find_contours(fine, 0.0)) / 16


def border_error(found, true):
    """Mean distance of the points of either outline from the other one."""
    return (cKDTree(true).query(found)[0].mean() + cKDTree(found).query(true)[0].mean()) / 2


answers = {}
for name, layer in LAYERS.items():
    finest = jax.jit(jax.vmap(layer(16)))
    answers[f"{name}, no network"] = np.asarray(finest(test_images - 0.5))
    answers[f"{name}, network"] = np.asarray(finest(jax.vmap(networks[name])(test_images)))
errors = {
    name: np.array([border_error(border(a), b) for a, b in zip(answer, truth, strict=True)])
    for name, answer in answers.items()
}
for name, each in errors.items():
    print(f"{name:>20}: {each.mean():.4f} +- {each.std() / len(each) ** 0.5:.4f} pixels")
gain = errors["bilinear, network"] - errors["fair, network"]
print(
    f"fair is nearer by {gain.mean():.4f} +- {gain.std() / len(gain) ** 0.5:.4f} pixels, "
    f"and in {np.mean(gain > 0):.0%} of the shapes"
)
for name in LAYERS:
    assert np.mean(history[name][-50:]) < 0.5 * history[name][0]
    assert errors[f"{name}, network"].mean() < errors[f"{name}, no network"].mean()
assert gain.mean() > 3 * gain.std() / len(gain) ** 0.5

# %%
figure = Figure(figsize=(13, 4.8), layout="constrained")
order = np.argsort(gain)
for ax, k in zip(figure.subplots(1, 3), order[[-1, len(order) // 2, 0]], strict=True):
    ax.imshow(test_images[k], cmap="Greys", vmax=1.6)
    ax.plot(*truth[k].T[::-1], color="black", lw=3, alpha=0.35, label="truth")
    for name, color in (("bilinear", "tab:orange"), ("fair", "tab:blue")):
        for n, line in enumerate(find_contours(answers[f"{name}, network"][k], 0.0)):
            ax.plot(*line.T[::-1] / 16, color=color, lw=1.4, label=None if n else name)
    both = [errors[f"{name}, network"][k] for name in LAYERS]
    ax.set(title="bilinear {:.3f}, fair {:.3f}".format(*both), xticks=[], yticks=[])
ax.legend(loc="lower right")
figure.suptitle("boundary error, pixels: the shape best for fair, the median, the worst")
figures.show(figure, "learning_contours.png")
