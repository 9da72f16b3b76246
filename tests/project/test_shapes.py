"""The annotations of the package are checked while the tests run: shapes, dtypes, types."""

import sys

import jax
import jax.numpy as jnp
import pytest
from jaxtyping import TypeCheckError

import contourfair_jax as cf
from contourfair_jax._fairing.global_fairing.hermite import to_net
from contourfair_jax._fairing.small_systems import solve_small

BOTH = pytest.mark.both_precisions


@BOTH
@pytest.mark.parametrize("call", [solve_small, jax.jit(solve_small)])
def test_shapes_that_do_not_fit_each_other_are_found(call):
    assert call(jnp.eye(3), jnp.ones((3, 2))).shape == (3, 2)
    with pytest.raises(TypeCheckError, match=r"small_systems\.solve_small"):
        call(jnp.eye(3), jnp.ones((4, 2)))


@BOTH
def test_wrong_types_are_found():
    with pytest.raises(TypeCheckError, match=r"hermite\.to_net"):
        to_net(jnp.zeros((4, 9), int), (3, 3))
    with pytest.raises(TypeCheckError, match=r"hermite\.to_net"):
        to_net(jnp.zeros((4, 9)), (3.0, 3.0))
    with pytest.raises(TypeCheckError, match=r"GlobalFairing\.__init__"):
        cf.GlobalFairing(sharpness="1")


@BOTH
def test_every_module_is_checked():
    loaded = [name for name in sys.modules if name.split(".")[0] == "contourfair_jax"]
    assert len(loaded) > 50
    for name in loaded:
        loader = sys.modules[name].__spec__.loader
        assert type(loader).__module__ == "jaxtyping._import_hook", name
