"""Processes of the tests of tiles: one that gets killed, one with four devices, two as one.

Tiles are small here, so that small grids have many.
"""

import sys
import time

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

import contourfair_jax as cf
from contourfair_jax import tiles
from contourfair_jax.tiles import _program
from contourfair_jax.tiles._program import Overlap

SMALL = {
    cf.LocalFairing: Overlap(1, {2: 8, 3: 4}),
    cf.GlobalFairing: Overlap(6, {2: 8, 3: 4}),
}
METHOD = cf.LocalFairing(iterations=0)


def refine(source, target, workers):
    """Refine slowly enough to be killed on the way; say when it begins."""

    def progress(done, total):
        time.sleep(0.02)

    print("begins", flush=True)
    tiles.refine_to(
        source, target, 2, method=METHOD, workers=int(workers), resume=True, progress=progress
    )


def mesh(path, what):
    """How far four devices are from one: refined samples, or the gradient of a sum of squares."""
    values = np.load(path)
    grid = Mesh(np.array(jax.devices()).reshape(2, 2), ("rows", "columns"))

    def sharded(values):
        return tiles.refine_sharded(values, 2, grid, method=METHOD)

    def whole(values):
        return cf.fair_field(values, method=METHOD).refine(2)

    if what == "gradient":
        ours, theirs = (
            jax.grad(lambda values, refine=refine: (refine(values) ** 2).sum())(values)
            for refine in (sharded, whole)
        )
    else:
        ours, theirs = sharded(values), whole(values)
        tiled = from_tiles(values)
        print(len(ours.sharding.device_set), float(np.abs(np.asarray(ours) - tiled).max()))
    print(float(np.abs(np.asarray(ours) - np.asarray(theirs)).max()))


def explicit(path):
    """The same with the axes of `jax.make_mesh`, of samples divided along them and not."""
    values = np.load(path)[:30]
    grid = jax.make_mesh((2, 2), ("rows", "columns"))
    divided = jax.device_put(values, NamedSharding(grid, PartitionSpec("rows", "columns")))
    tiled = from_tiles(values)
    for given in (values, divided):
        fine = tiles.refine_sharded(given, 2, grid, method=METHOD)
        print(len(fine.sharding.device_set), float(np.abs(np.asarray(fine) - tiled).max()))


def from_tiles(values):
    """The same, from one device after the other."""
    tiled = np.zeros([2 * n - 1 for n in values.shape])
    for region, part in tiles.refine_tiles(values, 2, method=METHOD):
        tiled[region] = part
    return tiled


def pair(path, port, number):
    """One of two processes that refine together, each with its half of the devices."""
    jax.distributed.initialize(f"127.0.0.1:{port}", 2, int(number))
    values = np.load(path)
    grid = Mesh(np.array(jax.devices()), ("rows",))
    fine = tiles.refine_sharded(values, 2, grid, method=METHOD)
    tiled = from_tiles(values)
    plain = np.asarray(cf.fair_field(values, method=METHOD).refine(2))
    for shard in fine.addressable_shards:
        np.testing.assert_array_equal(shard.data, tiled[shard.index])
        np.testing.assert_allclose(shard.data, plain[shard.index], atol=1e-12)
    print("equal", len(jax.devices()), len(jax.local_devices()))


if __name__ == "__main__":
    _program._OVERLAPS.update(SMALL)
    {"refine": refine, "mesh": mesh, "explicit": explicit, "pair": pair}[sys.argv[1]](*sys.argv[2:])
