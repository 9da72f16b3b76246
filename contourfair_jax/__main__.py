"""The entry of the command line, alone because an interrupt may come before all imports."""

import os
import sys


def main() -> int:
    """`cli.main`, which an interrupt ends in one line while modules are being imported, too."""
    try:
        from .cli import main as run

        return run()
    except KeyboardInterrupt:
        if "--json" in sys.argv:
            print('{"error": "interrupted"}', flush=True)
        print("contourfair: interrupted", file=sys.stderr, flush=True)
        os._exit(130)  # nothing has begun; Python itself might end by the signal instead


if __name__ == "__main__":
    sys.exit(main())
