"""Where the program starts: `neugrasp`, and `python -m neugrasp`."""

from __future__ import annotations


def main() -> int:
    """Runs the program; 130 where it is interrupted before it can say so itself.

    What it imports takes its first second; whoever ends it then has made no mistake.
    """
    try:
        from neugrasp import cli

        return cli.main()
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    raise SystemExit(main())
