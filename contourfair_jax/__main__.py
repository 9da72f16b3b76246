"""The entry of the command line: ``contourfair``, and ``python -m contourfair_jax``."""

import sys


def main() -> int:
    """`cli.main`, which an interrupt ends in one line while modules are being imported, too."""
    try:
        from .cli import main as run

        return run()
    except KeyboardInterrupt:
        if "--json" in sys.argv:
            print('{"error": "interrupted"}')
        print("contourfair: interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
