"""What the program says, as a terminal can show it."""

from __future__ import annotations

import difflib
import io
import logging
import shlex
import sys
import time
import unicodedata
from collections.abc import Collection
from typing import TextIO

from neugrasp import progress
from neugrasp.errors import InputError
from neugrasp.progress import Progress


def speak_plainly() -> TerminalLog:
    """What a stream cannot say in its own encoding is spelt out, and what is logged goes to stderr."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    handler = TerminalLog(sys.stderr)
    logging.basicConfig(level=logging.INFO, handlers=[handler])
    progress.log.setLevel(logging.DEBUG)
    # It tells of every request.
    logging.getLogger("httpx").setLevel(logging.WARNING)
    return handler


def next_step(*words: object, why: str = "") -> str:
    """The line that says what to type next: a command for a shell, which takes the reason for a comment."""
    return f"next: neugrasp {shlex.join(map(str, words))}" + (f"  # {why}" if why else "")


def check_command(name: str, commands: Collection[str]) -> None:
    """Raises `InputError` with the nearest command where there is none of this name."""
    if name in commands:
        return
    near = difflib.get_close_matches(name, commands, n=1)
    hint = f"did you mean {near[0]}?" if near else f"choose one of {', '.join(commands)}"
    raise InputError(f"there is no command {name!r}; {hint}")


def printable(text: object, stream: TextIO | None = None) -> str:
    """The text as a terminal may get it: words from a file cannot move the cursor, colour or clear anything.

    Control characters, marks that turn the direction of writing, halves of characters, and what the encoding
    of `stream` (sys.stdout by default) lacks are written as escapes; new lines and tabs stay.
    """
    shown = "".join(map(_visible, str(text)))
    encoding = getattr(stream or sys.stdout, "encoding", None) or "utf-8"
    return shown.encode(encoding, "backslashreplace").decode(encoding)


def _visible(character: str) -> str:
    is_harmless = character in "\n\t" or unicodedata.category(character) not in ("Cc", "Cf", "Cs", "Zl", "Zp")
    return character if is_harmless else character.encode("unicode_escape", "surrogatepass").decode("ascii")


class _Printable(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return printable(super().format(record), sys.stderr)


class _Once(logging.Filter):
    """A warning is told once, however often a file is read."""

    def __init__(self) -> None:
        super().__init__()
        self._told: set[str] = set()

    def filter(self, record: logging.LogRecord) -> bool:
        text = record.getMessage()
        if record.levelno != logging.WARNING:
            return True
        is_new = text not in self._told
        self._told.add(text)
        return is_new


class TerminalLog(logging.StreamHandler[TextIO]):
    """Messages alone, one a line, as a terminal may get them; the same warning only once. How far a work is
    becomes a bar below them where the stream is a terminal, and is left out elsewhere."""

    def __init__(self, stream: TextIO):
        super().__init__(stream)
        self._bar = _Bar(stream)
        self.addFilter(_Once())
        self.setFormatter(_Printable("%(message)s"))

    def emit(self, record: logging.LogRecord) -> None:
        """Writes a message above the bar, or moves the bar."""
        reached = getattr(record, "progress", None)
        if isinstance(reached, Progress):
            self._bar.show(reached)
        else:
            self._bar.clear()
            super().emit(record)

    def clear(self) -> None:
        """Takes the bar away, for what is printed elsewhere."""
        self._bar.clear()


class _Bar:
    """The last line of a terminal."""

    WIDTH = 24

    def __init__(self, stream: TextIO):
        self._stream = stream
        self._shown = ""
        self._what, self._begun, self._before = "", 0.0, 0

    def show(self, progress: Progress) -> None:
        if not self._stream.isatty():
            return
        if progress.what != self._what or progress.done < self._before:
            self._what, self._begun, self._before = progress.what, time.monotonic(), progress.done
        self.clear()
        if progress.done < progress.total:
            self._shown = self._words(progress)
            self._stream.write(self._shown)
            self._stream.flush()

    def clear(self) -> None:
        if self._shown:
            self._stream.write("\r" + " " * len(self._shown) + "\r")
            self._stream.flush()
            self._shown = ""

    def _words(self, progress: Progress) -> str:
        full = self.WIDTH * progress.done // progress.total
        bar = "#" * full + "." * (self.WIDTH - full)
        made = progress.done - self._before
        left = ""
        if made:
            seconds = (time.monotonic() - self._begun) / made * (progress.total - progress.done)
            left = f", {seconds:.0f} s left" if seconds < 90 else f", {seconds / 60:.0f} min left"
        return f"[{bar}] {progress.done} of {progress.total} {progress.what}{left}"
