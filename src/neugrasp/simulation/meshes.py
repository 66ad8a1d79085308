"""Triangle meshes as arrays: reading and writing OBJ, volume, and whether a surface is closed."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array
from neugrasp.output import write_text

Faces = NDArray[np.int64]


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
        _, welded = np.unique(np.round(self.vertices, 7), axis=0, return_inverse=True)
        faces = welded.reshape(-1)[self.faces]
        first, second = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
        proper = first != second
        low, high = np.minimum(first, second)[proper], np.maximum(first, second)[proper]
        _, counts = np.unique(low * (int(welded.max()) + 1) + high, return_counts=True)
        return bool(np.all(counts % 2 == 0))

    def transformed(self, scale: float, offset: Array) -> Mesh:
        """Vertices times `scale`, then moved by `offset`."""
        return Mesh(self.vertices * scale + offset, self.faces)


def read_obj(path: Path) -> tuple[Mesh, ...]:
    """The parts ("o" groups) of an OBJ file, polygons split into fans; textures and normals are left out.

    Raises `InputError` naming the file where it is missing, damaged or empty.
    """
    vertices: list[list[float]] = []
    parts: list[list[tuple[int, int, int]]] = [[]]
    try:
        for line in path.read_text(errors="replace").splitlines():
            words = line.split()
            if not words:
                continue
            if words[0] == "v":
                vertices.append([float(word) for word in words[1:4]])
            elif words[0] == "o":
                parts.append([])
            elif words[0] == "f":
                corners = [_vertex_index(word, len(vertices)) for word in words[1:]]
                parts[-1] += [(corners[0], b, c) for b, c in pairwise(corners[1:])]
        points = np.array(vertices, dtype=np.float64).reshape(-1, 3)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise InputError(f"{path}: not a mesh in OBJ format ({error})") from error
    meshes = tuple(_compacted(points, np.array(part, dtype=np.int64), path) for part in parts if part)
    if not meshes:
        raise InputError(f"{path}: the mesh is empty; a closed triangle mesh is needed")
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
    return index - 1 if index > 0 else count + index


def _compacted(points: Array, faces: Faces, path: Path) -> Mesh:
    if faces.min() < 0 or faces.max() >= len(points):
        raise InputError(f"{path}: a face names a vertex that the file does not have")
    if not np.all(np.isfinite(points)):
        raise InputError(f"{path}: a vertex is not a finite number")
    used, inverse = np.unique(faces, return_inverse=True)
    return Mesh(points[used], inverse.reshape(-1, 3).astype(np.int64))
