"""The version, alone because the build and all floors read it."""

__version__ = "0.1.0"
