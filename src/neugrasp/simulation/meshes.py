"""Triangle meshes as arrays: reading OBJ and STL, writing OBJ, volume, and whether a surface is closed."""

from __future__ import annotations

import re
import stat
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array, apply
from neugrasp.output import write_text

Faces = NDArray[np.int64]
LARGEST = 100_000_000
"""Bytes that a mesh may have."""
FARTHEST = 1e9
"""Largest coordinate, whatever its unit."""
BYTE_ORDER_MARK = b"\xef\xbb\xbf"
STL_HEADER = 84
STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh; several closed parts may share it."""

    vertices: Array
    """(v, 3), metres."""
    faces: Faces
    """(f, 3) indices, anticlockwise seen from outside."""

    @property
    def extents(self) -> Array:
        """Edge lengths (3,) of the axis-aligned bounding box."""
        extents: Array = np.ptp(self.vertices, axis=0)
        return extents

    @property
    def middle(self) -> Array:
        """Centre (3,) of the axis-aligned bounding box: scenes put it half a height above the table."""
        middle: Array = (self.vertices.min(axis=0) + self.vertices.max(axis=0)) / 2
        return middle

    def volume_and_centroid(self) -> tuple[float, Array]:
        """Signed volume and centre of mass of the solid inside; parts that overlap count twice."""
        middle = self.vertices.mean(axis=0)
        a, b, c = np.moveaxis(self.vertices[self.faces] - middle, 1, 0)
        volumes = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
        total = float(volumes.sum())
        if abs(total) < 1e-15:
            return 0.0, middle
        return total, middle + (volumes[:, None] * (a + b + c) / 4).sum(axis=0) / total

    def is_closed(self) -> bool:
        """Whether every edge belongs to an even number of faces, seams of equal vertices welded."""
        first, second = self._welded_edges()
        low, high = np.minimum(first, second), np.maximum(first, second)
        _, counts = np.unique(low * (int(high.max(initial=0)) + 1) + high, return_counts=True)
        return bool(np.all(counts % 2 == 0))

    def turned_share(self) -> float:
        """Share of the edges that are not run through as often one way as the other: 0 where all faces of a
        closed surface agree which side is out."""
        first, second = self._welded_edges()
        low, high = np.minimum(first, second), np.maximum(first, second)
        edges, index = np.unique(low * (int(high.max(initial=0)) + 1) + high, return_inverse=True)
        balance = np.bincount(index, weights=np.sign(second - first))
        return float(np.mean(balance != 0)) if len(edges) else 0.0

    def _welded_edges(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Both ends of every side of every face, equal vertices being one."""
        _, welded = np.unique(np.round(self.vertices, 7), axis=0, return_inverse=True)
        faces = welded.reshape(-1)[self.faces]
        first, second = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
        proper = first != second
        return first[proper], second[proper]

    def transformed(self, scale: float, offset: Array) -> Mesh:
        """Vertices times `scale`, then moved by `offset`."""
        return Mesh(self.vertices * scale + offset, self.faces)

    def placed(self, scale: Array, link_from_mesh: Array) -> Mesh:
        """Scaled along each axis (3,), then moved; right side out where the scale mirrors."""
        faces = self.faces[:, ::-1] if np.prod(scale) < 0 else self.faces
        return Mesh(apply(link_from_mesh, self.vertices * scale), faces)


def read_mesh(path: Path) -> tuple[Mesh, ...]:
    """The parts of an OBJ or STL file. Raises `InputError` naming the file."""
    suffix = path.suffix.lower()
    if suffix not in (".obj", ".stl"):
        raise InputError(f"{path}: only OBJ and STL meshes are read, not {suffix or 'others'}")
    return read_stl(path) if suffix == ".stl" else read_obj(path)


def read_obj(path: Path) -> tuple[Mesh, ...]:
    """The parts ("o" or "g" groups) of an OBJ file, polygons split into fans; textures and normals are left
    out.

    Raises `InputError` naming the file where it is missing, damaged or empty.
    """
    vertices: list[list[float]] = []
    parts: list[list[tuple[int, int, int]]] = [[]]
    try:
        for line in _lines(_bytes_of(path)):
            words = line.split()
            if not words:
                continue
            if words[0] == "v":
                x, y, z = words[1:4]
                vertices.append([float(x), float(y), float(z)])
            elif words[0] in ("o", "g"):
                parts.append([])
            elif words[0] == "f":
                corners = [_vertex_index(word, len(vertices)) for word in words[1:]]
                parts[-1] += [(corners[0], b, c) for b, c in pairwise(corners[1:])]
        points = np.array(vertices, dtype=np.float64).reshape(-1, 3)
        meshes = tuple(_compacted(points, np.array(part, dtype=np.int64), path) for part in parts if part)
    except (ValueError, IndexError, OverflowError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: not a mesh in OBJ format ({error})") from error
    return _not_empty(meshes, path)


def read_stl(path: Path) -> tuple[Mesh, ...]:
    """The parts of an STL file, equal corners being one vertex: the solids of a text, or the one of a binary.

    Raises `InputError` naming the file where it is missing, damaged or empty.
    """
    data = _bytes_of(path)
    try:
        if is_binary_stl(data):
            solids = [np.frombuffer(data, STL_FACET, offset=STL_HEADER)["corners"].reshape(-1, 3)]
        elif data.removeprefix(BYTE_ORDER_MARK).lstrip()[:5].lower() == b"solid":
            solids = _solids([line.lower().split() for line in _lines(data)])
        else:
            raise ValueError(f"{len(data)} bytes do not hold the {_facets(data)} facets that it names")
        if not all(np.all(np.isfinite(corners)) for corners in solids):
            raise ValueError("a vertex is not a finite number")
        meshes = []
        for corners in filter(len, solids):
            points, index = np.unique(corners.astype(np.float64), axis=0, return_inverse=True)
            meshes.append(_compacted(points, index.reshape(-1, 3).astype(np.int64), path))
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: not a mesh in STL format ({error})") from error
    return _not_empty(tuple(meshes), path)


def is_binary_stl(data: bytes) -> bool:
    """Whether the bytes of an STL file are binary, whatever their header says."""
    return len(data) == STL_HEADER + STL_FACET.itemsize * _facets(data)


def is_for_engine(path: Path) -> bool:
    """Whether the physics engine reads a mesh as it is read here. It reads no STL text, and of OBJ, silently,
    another mesh where there is a mark of byte order, a line that goes on behind a backslash, or one that ends
    in a carriage return alone."""
    data = _bytes_of(path)
    if path.suffix.lower() == ".stl":
        return is_binary_stl(data)
    return not (data.startswith(BYTE_ORDER_MARK) or re.search(rb"\r(?!\n)|\\\r?\n", data))


def _facets(data: bytes) -> int:
    return int.from_bytes(data[80:84], "little")


def _solids(lines: list[list[str]]) -> list[Array]:
    """The corners (3 f, 3) of every solid of an STL text, in lower case. Raises `ValueError`."""
    solids: list[list[list[float]]] = []
    is_open = False
    for words in filter(None, lines):
        if words[0].startswith("solid"):
            solids.append([])
            is_open = True
        elif words[0] == "endsolid":
            is_open = False
        elif words[0] == "vertex":
            if len(words) != 4:
                raise ValueError("a vertex without three numbers")
            solids[-1].append([float(word) for word in words[1:]])
        elif words[0] == "endfacet" and len(solids[-1]) % 3:
            raise ValueError("a facet without three corners")
    if is_open:
        raise ValueError("it ends without 'endsolid'; was it cut off?")
    return [np.array(corners).reshape(-1, 3) for corners in solids]


def _lines(data: bytes) -> list[str]:
    """The lines of a mesh in text, those that go on behind a backslash joined; nothing else breaks them."""
    text = data.removeprefix(BYTE_ORDER_MARK).decode(errors="replace")
    return text.replace("\r\n", "\n").replace("\r", "\n").replace("\\\n", " ").split("\n")


def _bytes_of(path: Path) -> bytes:
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode) or status.st_size > LARGEST:
            raise InputError(f"{path}: is no file of at most {LARGEST / 1e6:.0f} MB; simplify the mesh")
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error


def _not_empty(meshes: tuple[Mesh, ...], path: Path) -> tuple[Mesh, ...]:
    if not meshes:
        raise InputError(
            f"{path}: the mesh is empty, no face is found; a closed triangle mesh is needed, texts in UTF-8"
        )
    return meshes


def write_obj(path: Path, parts: tuple[Mesh, ...], decimals: int = 7) -> None:
    """Writes the parts as "o" groups, through a temporary file: nobody ever reads half a mesh."""
    lines, offset = [], 1
    for number, part in enumerate(parts):
        lines.append(f"o part_{number}")
        lines += [f"v {x:.{decimals}f} {y:.{decimals}f} {z:.{decimals}f}" for x, y, z in part.vertices]
        lines += [f"f {a} {b} {c}" for a, b, c in part.faces + offset]
        offset += len(part.vertices)
    write_text(path, "\n".join(lines) + "\n")


def merged(parts: tuple[Mesh, ...]) -> Mesh:
    """All parts as one mesh."""
    offsets = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    faces = [part.faces + offset for part, offset in zip(parts, offsets, strict=True)]
    return Mesh(np.concatenate([part.vertices for part in parts]), np.concatenate(faces))


def _vertex_index(word: str, count: int) -> int:
    index = int(word.split("/")[0])
    if index == 0:
        raise ValueError("vertices are counted from 1")
    return index - 1 if index > 0 else count + index


def _compacted(points: Array, faces: Faces, path: Path) -> Mesh:
    if faces.min() < 0 or faces.max() >= len(points):
        raise InputError(f"{path}: a face names a vertex that the file does not have")
    if not np.all(np.abs(points) < FARTHEST):
        raise InputError(f"{path}: a vertex is not a finite number, or beyond {FARTHEST:g}")
    used, inverse = np.unique(faces, return_inverse=True)
    return Mesh(points[used], inverse.reshape(-1, 3).astype(np.int64))
