"""A folder, and a file, that is written whole or not at all."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from neugrasp.errors import NeuGraspError


@contextmanager
def whole_or_nothing(out: Path) -> Iterator[Path]:
    """A folder to write into whose files all move to `out` at the end, or vanish where something fails.

    Files that `out` holds already stay, unless one of the same name replaces them.
    """
    is_new = not out.exists()
    out.mkdir(parents=True, exist_ok=True)
    part = Path(tempfile.mkdtemp(prefix=".part-", dir=out))
    try:
        yield part
        for file in sorted(part.iterdir()):
            file.replace(out / file.name)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        if is_new and not any(out.iterdir()):
            out.rmdir()
        raise
    part.rmdir()


def replace_file(path: Path, data: bytes) -> None:
    """Writes a file in the place of the one that may be there: whoever reads it finds the old or the new one.

    Raises `NeuGraspError` where the disk refuses; the old file stays.
    """
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        temporary.write_bytes(data)
        temporary.replace(path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise NeuGraspError(f"{path}: cannot be written ({error.strerror}); it stays as it was") from error
