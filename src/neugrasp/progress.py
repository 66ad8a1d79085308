"""How far a long work is, told to whoever listens: the program draws a bar of it on a terminal."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Sized
from dataclasses import dataclass
from typing import TypeVar

log = logging.getLogger(__name__)

T = TypeVar("T")


@dataclass(frozen=True)
class Progress:
    """What a record of the log says in its field `progress`."""

    what: str
    """What is counted, in the plural."""
    done: int
    total: int


def reached(what: str, done: int, total: int) -> None:
    """Says that so many of all are done."""
    log.debug("%d of %d %s", done, total, what, extra={"progress": Progress(what, done, total)})


def counted(things: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
    """The things, one after the other, each counted when the next one is asked for."""
    if total is None:
        assert isinstance(things, Sized)
        total = len(things)
    reached(what, 0, total)
    for done, thing in enumerate(things, 1):
        yield thing
        reached(what, done, total)
