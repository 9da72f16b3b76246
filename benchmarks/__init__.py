"""Accuracy, robustness and cost of the engine beside what people use instead.

Run from the repository root: ``python -m benchmarks --help``.
"""
