"""What is written is whole, or is not there; and nothing is written over what was read."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

from neugrasp.errors import InputError, WriteError


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Whatever the disk refuses becomes a `WriteError` that names `path`."""
    try:
        yield
    except OSError as error:
        raise WriteError(f"{path}: cannot be written ({error.strerror or error})") from error


@contextmanager
def parents_of(path: Path) -> Iterator[None]:
    """Makes the folders above `path`; those that were new and stay empty vanish where something fails.

    Raises `WriteError` where they cannot be made.
    """
    new = [folder for folder in path.parents if not os.path.lexists(folder)]
    try:
        with naming(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        for folder in new:
            try:
                folder.rmdir()
            except OSError:
                break
        raise


@contextmanager
def whole_file(path: Path, inputs: Iterable[Path] = ()) -> Iterator[Path]:
    """A file to write to, of the same suffix, that becomes `path` at the end, or vanishes where something
    fails.

    What can be known before is known before the body runs. Raises `InputError` where `path` is a folder or
    one of the `inputs`, `WriteError` where the disk refuses.
    """
    check_file(path, inputs)
    with parents_of(path):
        suffix = path.suffix[:20]
        part = path.with_name(f".{path.stem[:40]}{suffix}.part-{uuid4().hex[:12]}{suffix}")
        try:
            with naming(path):
                part.touch()
            yield part
            with naming(path):
                part.replace(path)
        except OSError as error:
            # A disk that is full says so without naming a file; what the body read has its own name.
            if error.filename is not None and Path(os.fsdecode(error.filename)) != part:
                raise
            raise WriteError(f"{path}: cannot be written ({error.strerror or error})") from error
        finally:
            part.unlink(missing_ok=True)


def check_file(path: Path, inputs: Iterable[Path] = ()) -> None:
    """Raises `InputError` where a file may not be written as `path`: a folder, or one of the `inputs`."""
    with naming(path):
        try:
            path.lstat()
        except (FileNotFoundError, NotADirectoryError):
            return
    if path.is_dir():
        raise InputError(f"{path}: is a folder; a file is written under this name")
    if path.exists() and not os.access(path, os.W_OK):
        raise WriteError(f"{path}: cannot be written ({os.strerror(errno.EACCES)})")
    for file in inputs:
        if file.exists() and path.exists() and path.samefile(file):
            raise InputError(f"{path}: is read by this command ({file}); choose another name to write to")


def sweep(folder: Path) -> None:
    """Removes what processes that were killed left half-written in a folder and in those in it; only for who
    alone writes there."""
    for leftover in [*folder.glob(".*part-*"), *folder.glob("*/.*part-*")]:
        if leftover.is_dir():
            shutil.rmtree(leftover, ignore_errors=True)
        else:
            leftover.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Writes the file in UTF-8, whole or not at all. Raises as `whole_file` does."""
    with whole_file(path) as part:
        part.write_text(text, encoding="utf-8")
