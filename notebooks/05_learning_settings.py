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
# # Learning the settings of fairing
#
# `cf.tune` compares a list of settings by cross-validation. The same error is differentiable in the
# settings, so it can be minimised by gradient: here by Adam (optax), over the logarithms of thin
# plate weight, coherence and tension. Samples at every other place of a real field are given; those
# between are held back, and say at the end whether the settings are good.
#
# Open this file in Jupyter with jupytext, or run it as a script; `CONTOURFAIR_FIGURES=folder`
# stores the pictures. Origin and licence of the data: `notebooks/data/README.md`.

# %%
import figures
import jax
import jax.numpy as jnp
import numpy as np
import optax
from matplotlib.figure import Figure
from scipy.interpolate import RectBivariateSpline

import contourfair_jax as cf
from contourfair_jax.io import example

jax.config.update("jax_enable_x64", True)
GALLERY = np.load(figures.DATA / "gallery.npz")
FIELDS = {
    "CT of a chest": GALLERY["ct"][20:69, 30:79].astype(float),
    "CT of a head": GALLERY["head"][6:55, 6:55].astype(float),
    "terrain": example("jacksboro").crop(((164, 213), (200, 249))).values.astype(float),
}

# %% [markdown]
# ## The error, and a step down
#
# All settings are positive: their logarithms are learned. The error is taken relative to that of
# the start, so that one rate of learning does for all fields.

# %%
START = {"thin_plate_weight": 0.05, "coherence": 1.2, "tension": 1.0}
LIMITS = {"thin_plate_weight": (1e-3, 1.0), "coherence": (0.3, 2.5), "tension": (1e-2, 1e3)}
STEPS = 12


def method_of(logarithms):
    """The method with these settings."""
    settings = {
        name: jnp.exp(jnp.clip(value, *np.log(LIMITS[name]))) for name, value in logarithms.items()
    }
    return cf.GlobalFairing(iterations=2, sharpness=2, tolerance=1e-2, max_steps=60, **settings)


def error(logarithms, values):
    """Logarithm of the cross-validation error, of scaled samples."""
    return jnp.log(cf.cross_validation_error(method_of(logarithms), values, jnp.ones(2)))


descend = jax.jit(jax.value_and_grad(error))
optimiser = optax.adam(0.4)


def learned(samples):
    """Best settings seen, and the errors of all steps."""
    values = jnp.asarray(samples / samples.std())
    logarithms = {name: jnp.log(jnp.asarray(value)) for name, value in START.items()}
    state, history = optimiser.init(logarithms), []
    for _ in range(STEPS):
        value, slope = descend(logarithms, values)
        history.append((float(value), logarithms))
        updates, state = optimiser.update(slope, state)
        logarithms = optax.apply_updates(logarithms, updates)
    return method_of(min(history, key=lambda each: each[0])[1]), [each[0] for each in history]


# %% [markdown]
# ## Held-back samples
#
# Root mean square error at the samples that no method has seen.


# %%
def held_back(values, refined):
    """Error where neither coordinate, or only one, belongs to a given sample."""
    unseen = np.ones(values.shape, bool)
    unseen[::2, ::2] = False
    return float(np.sqrt(np.mean((np.asarray(refined) - values)[unseen] ** 2)))


rows, histories = {}, {}
for name, values in FIELDS.items():
    samples = values[::2, ::2]
    method, histories[name] = learned(samples)
    at = np.arange(len(samples))
    fine = np.arange(len(values)) / 2
    candidates = {"default": cf.GlobalFairing(), "tune": cf.tune(samples), "learned": method}
    rows[name] = {
        kind: held_back(values, cf.fair_field(samples, method=each).refine(2))
        for kind, each in candidates.items()
    }
    rows[name]["cubic spline"] = held_back(values, RectBivariateSpline(at, at, samples)(fine, fine))
    settings = ", ".join(f"{key} {float(getattr(method, key)):.3g}" for key in START)
    print(f"{name}: {settings}")
print(f"\n{'':>16}" + "".join(f"{kind:>14}" for kind in rows[name]))
for name, row in rows.items():
    print(f"{name:>16}" + "".join(f"{value:14.3f}" for value in row.values()))

# %%
figure = Figure(figsize=(8, 4), layout="constrained")
ax = figure.subplots()
for name, history in histories.items():
    ax.plot(np.exp((np.array(history) - history[0]) / 2), label=name)
ax.set(xlabel="step", ylabel="cross-validation error, relative to the start")
ax.legend()
figures.show(figure, "learning_settings.png", dpi=90, colors=64)
for name, history in histories.items():
    assert min(history) < history[0]
    assert rows[name]["learned"] < 1.05 * rows[name]["default"]
