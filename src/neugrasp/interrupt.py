"""Ctrl-C while modules load: Python may lose it in one of the callbacks of an import, and go on."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

CODE = 130
"""With which a program ends that was interrupted."""


@contextmanager
def ends_at_once() -> Iterator[None]:
    """In which Ctrl-C ends the process there and then. For imports alone: nothing is tidied up."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, lambda *_: os._exit(CODE))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
