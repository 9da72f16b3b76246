"""The command ``contourfair``.

Options and messages live here; what is computed, traced, drawn and stored is in the modules that
the commands call.  JAX and Matplotlib are imported by the commands that need them, so that
``contourfair --help`` answers at once.
"""

from ._app import app as app
from ._app import main as main

__all__ = [
    "app",
    "main",
]
