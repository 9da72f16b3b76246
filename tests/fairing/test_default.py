"""The method where none is given, and what is no method."""

from functools import partial

import jax
import numpy as np
import pytest
from jax.sharding import Mesh
from shape_checks import refused

import contourfair_jax as cf
from contourfair_jax import inverse, tiles
from contourfair_jax._fairing.default import chosen_method

SAMPLES = np.zeros((5, 5))
POINT = inverse.Values(np.ones((1, 2)), np.zeros(1))
DEVICE = Mesh(np.array(jax.devices()[:1]), ("rows",))


def test_the_default_is_local_fairing():
    assert chosen_method(None) == cf.LocalFairing() == cf.FairUpsample(2).method
    given = cf.GlobalFairing(iterations=1)
    assert chosen_method(given) is given


@pytest.mark.parametrize("wrong", ["local", cf.LocalFairing, 3])
@pytest.mark.parametrize(
    "use",
    [
        partial(cf.fair_field, SAMPLES),
        partial(cf.FairUpsample, 2),
        partial(tiles.refine_tiles, SAMPLES, 2),
        partial(tiles.refine_sharded, SAMPLES, 2, DEVICE),
        partial(inverse.fit_samples, POINT, (5, 5)),
    ],
    ids=["field", "layer", "tiles", "devices", "inverse"],
)
def test_what_is_no_method_is_refused_everywhere(use, wrong):
    with refused(ValueError, match=r"^method must be an object such as LocalFairing\(\), "):
        use(method=wrong)
