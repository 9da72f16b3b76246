"""Cubic Bezier nets as arrays, in any dimension, on JAX and on the host; no field, no file."""
