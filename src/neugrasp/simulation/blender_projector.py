"""A projector of dots for Blender: the pattern, and a lamp's node tree. Receives Blender's objects only."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from neugrasp.simulation.blender_materials import NodeTree

HALF_FIELD = 0.75
"""Tangent of half the angle of the projected square."""
TEXELS_PER_DOT = 6
"""Texels between neighbouring dots, on average."""
SEED = 20250


def dot_pattern(dot_spacing: float) -> NDArray[np.float32]:
    """Brightness (n, n) of dots at random places, `dot_spacing` apart on average in tangents of the angle."""
    count = int(np.ceil(2 * HALF_FIELD / dot_spacing))
    size = count * TEXELS_PER_DOT
    rng = np.random.default_rng(SEED)
    cells = np.stack(np.meshgrid(np.arange(count), np.arange(count), indexing="ij"), -1).reshape(-1, 2)
    centres = (cells + rng.uniform(0.1, 0.9, cells.shape)) * TEXELS_PER_DOT
    bright = rng.uniform(0.3, 1.0, len(centres)) * (rng.random(len(centres)) < 0.85)
    pattern = np.zeros((size, size))
    reach = np.arange(-3, 4)
    for offset in np.stack(np.meshgrid(reach, reach, indexing="ij"), -1).reshape(-1, 2):
        texel = np.floor(centres).astype(np.int64) + offset
        inside = np.all((texel >= 0) & (texel < size), axis=1)
        distance = np.linalg.norm(texel + 0.5 - centres, axis=1)
        glow = bright * np.exp(-0.5 * (distance / 1.1) ** 2)
        np.maximum.at(pattern, tuple(texel[inside].T), glow[inside])
    return pattern.astype(np.float32)


def pattern_image(images: Any, dot_spacing: float) -> Any:
    """The pattern as one of Blender's images, made once."""
    name = f"dots {dot_spacing:.6f}"
    found = images.get(name)
    if found is not None:
        return found
    pattern = dot_pattern(dot_spacing)
    image = images.new(name, *pattern.shape, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    pixels = np.ones((*pattern.shape, 4), dtype=np.float32)
    pixels[..., :3] = pattern[..., None]
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    return image


def projector_nodes(tree: Any, image: Any) -> None:
    """Light goes out along -z of the lamp, brighter where the image is; none beside its square."""
    nodes = NodeTree(tree)
    direction = nodes.add("ShaderNodeTexCoord").outputs["Normal"]
    x, y, z = nodes.add("ShaderNodeSeparateXYZ", {0: direction}).outputs
    ahead = nodes.math("ABSOLUTE", z)
    u, v = (
        nodes.math("ADD", nodes.math("DIVIDE", nodes.math("DIVIDE", axis, ahead), 2 * HALF_FIELD), 0.5)
        for axis in (x, y)
    )
    where = nodes.add("ShaderNodeCombineXYZ", {0: u, 1: v}).outputs[0]
    colour = nodes.add(
        "ShaderNodeTexImage", {"Vector": where}, image=image, extension="CLIP", interpolation="Linear"
    ).outputs["Color"]
    shader = nodes.add("ShaderNodeEmission", {"Color": colour, "Strength": 1.0}).outputs[0]
    nodes.output(shader, "ShaderNodeOutputLight")
