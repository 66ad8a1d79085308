"""`python -m neugrasp` is `neugrasp`."""

from __future__ import annotations

from neugrasp.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
