"""Run by `test_watchdog` as a process of its own: prints ``done`` unless something hangs.

Usage: ``hang_worker.py KIND METHOD``, named as in `KINDS` and `METHODS`.

One compiled program holds several independent fairings, with values and gradients, that the
runtime may work on side by side.  It runs alone, then from two threads at a time.
"""

import sys
import threading

import jax
import jax.numpy as jnp

import contourfair_jax as cf

# Enough vertices for batched calls to be split over threads; one shape, to compile fast.
KINDS = {"small": (3, (34, 36)), "plane": (8, (64, 66)), "volume": (3, (9, 10, 11))}
METHODS = {"local": cf.LocalFairing, "lu": lambda: cf.LocalFairing(solver=cf.LU())}
if hasattr(cf, "GlobalFairing"):
    METHODS["global"] = cf.GlobalFairing
REPEATS = 3


def main(kind: str, name: str) -> None:
    copies, shape = KINDS[kind]
    method = METHODS[name]()
    batch = [jax.random.normal(jax.random.key(seed), shape) for seed in range(copies)]

    def loss(values):
        return jnp.sum(cf.fair_field(values, method=method).control_points ** 2)

    program = jax.jit(lambda batch: [jax.value_and_grad(loss)(values) for values in batch])
    program = program.lower(batch).compile()

    def work():
        for _ in range(REPEATS):
            jax.block_until_ready(program(batch))

    work()
    threads = [threading.Thread(target=work) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    print("done", jax.__version__)


if __name__ == "__main__":
    main(*sys.argv[1:])
