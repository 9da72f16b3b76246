"""Errors, checks, memory, precisions, XLA, results; nothing of the package is imported here."""
