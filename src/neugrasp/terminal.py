"""What the program says, as a terminal can show it."""

from __future__ import annotations

import io
import logging
import sys

from neugrasp.data.strict_json import CONTROL


def plain(text: str) -> str:
    """The text with control characters, which move a terminal, spelt out."""
    return CONTROL.sub(lambda found: repr(found[0])[1:-1], text)


class _Plain(logging.Formatter):
    """Log messages as they are, but plain."""

    def format(self, record: logging.LogRecord) -> str:
        return plain(super().format(record))


def speak_plainly() -> None:
    """What a stream cannot say in its own encoding is spelt out, and what is logged goes to stderr."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_Plain("%(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
