"""A mesh with a colour per vertex as a binary glTF file, which browsers draw."""

from __future__ import annotations

import json
import struct

import numpy as np
from numpy.typing import NDArray

from neugrasp.geometry.pose import Array
from neugrasp.geometry.surface import Surface
from neugrasp.srgb import linear

FLOAT, UNSIGNED = 5126, 5125
"""Numbers that glTF gives to types."""
ROUGHNESS = 0.85


def glb(surface: Surface, colours: NDArray[np.uint8]) -> bytes:
    """The file; `colours` (n, 3) are those of the vertices, as on a screen."""
    arrays = [
        surface.vertices.astype("<f4"),
        vertex_normals(surface).astype("<f4"),
        linear(colours / 255).astype("<f4"),
        surface.faces.reshape(-1).astype("<u4"),
    ]
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    starts = np.cumsum([0, *(array.nbytes for array in arrays)]).tolist()
    accessors = [
        {
            "bufferView": i,
            "componentType": UNSIGNED if array.ndim == 1 else FLOAT,
            "count": len(array),
            "type": "SCALAR" if array.ndim == 1 else "VEC3",
        }
        for i, array in enumerate(arrays)
    ]
    accessors[0] |= {"min": low.tolist(), "max": high.tolist()}
    primitive = {"attributes": {"POSITION": 0, "NORMAL": 1, "COLOR_0": 2}, "indices": 3, "material": 0}
    head = {
        "asset": {"version": "2.0", "generator": "neugrasp"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [
            {
                "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": ROUGHNESS},
                "doubleSided": True,
            }
        ],
        "accessors": accessors,
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": array.nbytes}
            for start, array in zip(starts, arrays, strict=False)
        ],
        "buffers": [{"byteLength": starts[-1]}],
    }
    text = json.dumps(head).encode()
    text += b" " * (-len(text) % 4)
    body = b"".join(array.tobytes() for array in arrays)
    chunks = (
        struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(body), 0x004E4942) + body
    )
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def vertex_normals(surface: Surface) -> Array:
    """(n, 3) unit: the mean of the faces around each vertex, by area."""
    corners = surface.vertices[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.zeros_like(surface.vertices)
    for corner in range(3):
        np.add.at(total, surface.faces[:, corner], normals)
    length = np.linalg.norm(total, axis=-1, keepdims=True)
    return np.where(length > 0, total / np.maximum(length, 1e-30), (0.0, 0.0, 1.0))
