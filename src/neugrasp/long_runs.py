"""What runs of hours share: one process holds a folder, a run goes on only as it was begun, workers do not
outlive it, and what comes out names the commit."""

from __future__ import annotations

import fcntl
import json
import os
import subprocess
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from neugrasp.errors import InputError, NeuGraspError

LOOK_EVERY = 0.3
"""Seconds between two looks at whether the parent is still there."""


@contextmanager
def held(out: Path, command: str) -> Iterator[None]:
    """Makes the folder and holds it for this process, whatever kills it.

    Raises `InputError` where another process holds it, `NeuGraspError` where it cannot be written.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        with (out / ".lock").open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise InputError(f"{out}: another neugrasp {command} is writing here; wait for it") from error
            yield
    except OSError as error:
        raise NeuGraspError(f"{out}: cannot be written ({error.strerror})") from error


def begun_as(path: Path, facts: Mapping[str, Any], what: str) -> None:
    """Writes how a run was begun, or checks that the file that is there says the same.

    Raises `InputError` where it says something else or cannot be read; `what` names what the run makes.
    """
    if not path.exists():
        temporary = path.with_name(f".{path.name}.tmp")
        temporary.write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
        temporary.replace(path)
        return
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: not valid JSON ({error}); choose another --out") from error
    for key in {**facts, **found}:
        if found.get(key) != facts.get(key):
            raise InputError(
                f"{path}: this {what} was made with {key} = {found.get(key)!r}, not {facts.get(key)!r}; "
                "give the same options to go on with it, or another --out"
            )


def end_with(parent: int) -> None:
    """Ends this process soon after its parent has gone, be it by SIGKILL."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(LOOK_EVERY)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def source_commit() -> str:
    """The commit of the source tree this runs from, or "unknown" outside of one."""
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
