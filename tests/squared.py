"""Work for workers that may be killed, importable in their processes."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from neugrasp.errors import InputError


@contextmanager
def squares(folder: Path, seconds: float = 0.0) -> Iterator[Callable[[int], tuple[int, int]]]:
    """Opens a worker, which leaves a file, and gives what squares a number: the square and the process."""
    mark = folder / f"open-{os.getpid()}"
    mark.touch()
    try:
        yield partial(_square, folder, seconds)
    finally:
        mark.unlink()


def _square(folder: Path, seconds: float, number: int) -> tuple[int, int]:
    if number == 13:
        raise InputError("13: is not squared here")
    if number == 66 or (number == 7 and not (folder / "died").exists()):
        # 7 kills its first worker, 66 kills all of them.
        (folder / "died").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(seconds)
    return number * number, os.getpid()
