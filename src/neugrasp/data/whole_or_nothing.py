"""A set of files that is written whole or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from neugrasp.errors import InputError, WriteError
from neugrasp.output import check_file, naming, parents_of


@contextmanager
def whole_or_nothing(out: Path, names: Sequence[str] = ()) -> Iterator[Path]:
    """A folder to write into whose files all move to `out` at the end, or vanish where something fails.

    `names` are all files that the program may write: those of an earlier run that this one does not write
    are removed, the first goes first and comes last, so that whoever finds it finds its companions. What
    else `out` holds stays. What can be known before is known before the body runs. Raises `InputError`
    where a folder has the name of a file, `WriteError` where the disk refuses.
    """
    with parents_of(out):
        is_new = not os.path.lexists(out)
        with naming(out):
            if not is_new and not out.is_dir():
                raise InputError(f"{out}: is a file; files are written into a folder of this name")
            out.mkdir(exist_ok=True)
            for name in names:
                check_file(out / name)
            part = Path(tempfile.mkdtemp(prefix=".part-", dir=out))
        try:
            yield part
            _exchange(part, out, names)
        except OSError as error:
            # A disk that is full says so without naming a file; what the body read has its own name.
            if error.filename is not None and part not in Path(os.fsdecode(error.filename)).parents:
                raise
            file = out if error.filename is None else out / Path(os.fsdecode(error.filename)).name
            raise WriteError(f"{file}: cannot be written ({error.strerror or error})") from error
        finally:
            shutil.rmtree(part, ignore_errors=True)
            if is_new and out.is_dir() and not any(out.iterdir()):
                out.rmdir()


@contextmanager
def whole_folder(folder: Path) -> Iterator[Path]:
    """A new folder to write into that becomes `folder` at the end, or vanishes where something fails.

    One that is there by then stays, and the new one goes. Raises `WriteError` where the disk refuses.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        part = Path(tempfile.mkdtemp(prefix=f".tmp-{folder.name}-", dir=folder.parent))
        try:
            part.chmod(0o755)
            yield part
            if not folder.exists():
                _rename(part, folder)
        finally:
            shutil.rmtree(part, ignore_errors=True)
    except OSError as error:
        raise WriteError(f"{folder}: cannot be written ({error.strerror or error})") from error


def _rename(part: Path, folder: Path) -> None:
    """Another process may have been first."""
    try:
        part.rename(folder)
    except OSError:
        if not folder.is_dir():
            raise


def _exchange(part: Path, out: Path, names: Sequence[str]) -> None:
    """The old files go before the new ones come: nobody ever finds some of both. All as before on failure."""
    new = sorted((file.name for file in part.iterdir()), key=lambda name: (name in names[:1], name))
    for name in new:
        check_file(out / name)
    old = Path(tempfile.mkdtemp(prefix=".old-", dir=part))
    gone, come = [], []
    try:
        for name in dict.fromkeys([*names, *new]):
            if os.path.lexists(out / name):
                with naming(out / name):
                    (out / name).rename(old / name)
                gone.append(name)
        for name in new:
            with naming(out / name):
                (part / name).rename(out / name)
            come.append(name)
    except BaseException:
        for name in come:
            (out / name).rename(part / name)
        for name in gone:
            (old / name).rename(out / name)
        raise
