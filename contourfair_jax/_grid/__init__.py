"""Samples with their place: `Grid`, affine maps, reference systems, missing samples, other grids.

JAX is not imported.
"""
