"""Where the program starts: `neugrasp`, and `python -m neugrasp`."""

from __future__ import annotations

import sys

from neugrasp.interrupt import CODE, ends_at_once


def main() -> int:
    """Runs the program; 130 where it is interrupted before it can say so itself.

    What it imports takes its first second; whoever ends it then has made no mistake.
    """
    try:
        with ends_at_once():
            from neugrasp import cli

        return cli.main()
    except KeyboardInterrupt:
        return CODE


if __name__ == "__main__":
    sys.exit(main())
