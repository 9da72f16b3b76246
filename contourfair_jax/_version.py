"""The version, in a file of its own: the build and all floors read it, and import no more."""

__version__ = "0.1.0"
