"""What runs of hours share: one process holds a folder, a run goes on only as it was begun, workers do not
outlive it, and what comes out names the commit."""

from __future__ import annotations

import importlib.util
import json
import logging
import os
import subprocess
import threading
import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from neugrasp.data.strict_json import read_json
from neugrasp.errors import InputError, WriteError
from neugrasp.output import naming, sweep, write_text

# Windows has none.
fcntl: Any = importlib.import_module("fcntl") if importlib.util.find_spec("fcntl") else None

log = logging.getLogger(__name__)

CONTENTS = ("gripper_sha256", "objects_content_sha256")
"""Hashes of what the files hold that a run depends on, which older runs did not write down."""
LOOK_EVERY = 0.3
"""Seconds between two looks at whether the parent is still there."""


@contextmanager
def lock_folder(out: Path, command: str) -> Iterator[None]:
    """Makes the folder and holds it for this process, whatever kills it; what killed ones left half goes.

    Raises `InputError` where another process holds it, `WriteError` where it cannot be written.
    """
    with naming(out):
        out.mkdir(parents=True, exist_ok=True)
        file = (out / ".lock").open("w", encoding="utf-8")
    with file:
        try:
            lock(file)
        except BlockingIOError as error:
            raise InputError(f"{out}: another neugrasp {command} is writing here; wait for it") from error
        try:
            sweep(out)
            yield
        except OSError as error:
            # Whatever has a name is named by it; it may lie elsewhere, in the cache for one.
            if error.filename is not None:
                raise
            raise WriteError(f"{out}: cannot be written ({error.strerror or error})") from error


def lock(file: IO[str], shared: bool = False, waits: bool = False) -> None:
    """Holds a file until it is closed, alone or with others that share it; nothing on a system that has no
    such locks (Windows), which is said.

    Raises `BlockingIOError` where another process holds it, unless it `waits`.
    """
    if fcntl is None:
        log.warning("%s: this system has no locks; let one run at a time write here", file.name)
        return
    kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
    fcntl.flock(file, kind if waits else kind | fcntl.LOCK_NB)


def unlock(file: IO[str]) -> None:
    """Lets go of what `lock` holds."""
    if fcntl is not None:
        fcntl.flock(file, fcntl.LOCK_UN)


def check_run_config(path: Path, facts: Mapping[str, Any], what: str, young: Collection[str] = ()) -> None:
    """Writes how a run was begun, or checks that the file that is there says the same.

    `young` are facts that older files do not have. Raises `InputError` where the file says something else or
    cannot be read; `what` names what the run makes.
    """
    if not path.exists():
        write_text(path, json.dumps(facts, indent=1) + "\n")
        return
    check_same(read_json(path, f"the description of the {what}"), path, facts, what, young)


def check_same(
    found: Any, path: Path | str, facts: Mapping[str, Any], what: str, young: Collection[str] = ()
) -> None:
    """Raises `InputError` where what was `found` at `path` does not say that a run was begun with these
    facts."""
    if not isinstance(found, dict):
        raise InputError(f"{path}: is not a JSON object; choose another --out")
    for key in {**facts, **found}:
        if key in young and key not in found:
            continue
        if found.get(key) != facts.get(key):
            raise InputError(
                f"{path}: this {what} was made with {key} = {found.get(key)!r}, not {facts.get(key)!r}; "
                "give the same options to go on with it, or another --out"
            )


def exit_with_parent(parent: int) -> None:
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
