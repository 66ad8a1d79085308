"""Buckets of object stores, by their URL (s3, gs, what else fsspec knows): the only file that imports fsspec.

There nothing is renamed and nothing is locked: what is written is whole objects, and the one by which readers
know a set of files is written last.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from neugrasp.errors import InputError, WriteError, require

URL = re.compile(r"(?P<scheme>[A-Za-z][A-Za-z0-9+.-]+):/+(?P<rest>.*)")
"""As it is after pathlib made one slash of two; a letter alone is a drive of Windows."""
LOCAL = ("file", "local")


def local_of(path: Path) -> Path:
    """The folder that a URL of this machine's files means; any other path as it is."""
    found = URL.fullmatch(str(path))
    return Path("/", found["rest"]) if found and found["scheme"].lower() in LOCAL else path


def is_url(path: Path) -> bool:
    """Whether a path is the URL of something else than a folder."""
    return URL.fullmatch(str(path)) is not None and local_of(path) == path


def url_of(path: Path) -> str:
    """The URL that a path was before pathlib made one slash of two."""
    found = URL.fullmatch(str(path))
    assert found is not None
    return f"{found['scheme']}://{found['rest']}"


@dataclass(frozen=True)
class Bucket:
    """A place in an object store."""

    url: str
    _files: Any
    _root: str

    @classmethod
    def open(cls, path: Path) -> Bucket:
        """The bucket at a URL. Raises `InputError` where it cannot be reached, or by nothing that is
        installed, `MissingExtra` without fsspec."""
        url = url_of(path)
        require("fsspec", extra="cluster")
        core = require("fsspec.core", extra="cluster")
        try:
            files, root = core.url_to_fs(url)
        except (ImportError, ValueError, OSError) as error:
            raise InputError(f"{url}: cannot be opened ({error})") from error
        return cls(url, files, root.rstrip("/"))

    def read(self, name: str) -> bytes | None:
        """An object, or None where there is none. Raises `InputError` where the store refuses."""
        try:
            content: bytes = self._files.cat_file(f"{self._root}/{name}")
        except FileNotFoundError:
            return None
        # Every store has errors of its own.
        except Exception as error:
            raise InputError(f"{self.url}/{name}: cannot be read ({error})") from error
        return content

    def folders_with(self, name: str, below: str) -> set[str]:
        """Names of the folders in `below` that hold an object of a name. Raises `InputError` where the store
        refuses."""
        try:
            self._files.invalidate_cache()
            found = self._files.find(f"{self._root}/{below}")
        except FileNotFoundError:
            return set()
        except Exception as error:
            raise InputError(f"{self.url}/{below}: cannot be read ({error})") from error
        parts = [place.split("/") for place in found]
        return {folder for *_, folder, file in parts if file == name}

    def write(self, files: Mapping[str, bytes], last: str) -> None:
        """Writes objects; `last`, one of them, once the others are there.

        Raises `WriteError` where the store refuses: then `last` was not written, or whole.
        """
        with self._writing():
            rest = {f"{self._root}/{name}": content for name, content in files.items() if name != last}
            if rest:
                self._files.pipe(rest)
        with self._writing():
            self._files.pipe_file(f"{self._root}/{last}", files[last])

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except Exception as error:
            raise WriteError(f"{self.url}: cannot be written ({error})") from error
