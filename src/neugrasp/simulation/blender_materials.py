"""Node trees of Blender from plain material and texture data. Receives Blender's objects, imports none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

Parameters = dict[str, Any]
Socket = Any
"""An output of a shader node."""

INPUTS = {
    "base_color": "Base Color",
    "metallic": "Metallic",
    "roughness": "Roughness",
    "ior": "IOR",
    "specular": "Specular IOR Level",
    "anisotropic": "Anisotropic",
    "anisotropic_rotation": "Anisotropic Rotation",
    "coat": "Coat Weight",
    "coat_roughness": "Coat Roughness",
    "sheen": "Sheen Weight",
}
"""Our short names -> inputs of the Principled BSDF of Blender 4."""


class NodeTree:
    """A small language for shader nodes: each method adds a node and gives back its output."""

    def __init__(self, tree: Any):
        tree.nodes.clear()
        self._nodes, self._links = tree.nodes, tree.links

    def add(self, kind: str, inputs: Mapping[Any, Any] | None = None, **attributes: Any) -> Any:
        """A node; `inputs` holds sockets to link or values to set."""
        node = self._nodes.new(kind)
        for name, value in attributes.items():
            setattr(node, name, value)
        for key, value in (inputs or {}).items():
            if hasattr(value, "is_linked"):
                self._links.new(value, node.inputs[key])
            else:
                node.inputs[key].default_value = value
        return node

    def math(self, operation: str, a: Socket | float, b: Socket | float = 0.0) -> Socket:
        """`a operation b` of two scalars."""
        return self.add("ShaderNodeMath", {0: a, 1: b}, operation=operation).outputs[0]

    def ramp(
        self, factor: Socket, stops: Sequence[tuple[float, Sequence[float]]], kind: str = "LINEAR"
    ) -> Socket:
        """Colours at positions 0..1, read at `factor`."""
        node = self.add("ShaderNodeValToRGB", {"Fac": factor})
        node.color_ramp.interpolation = kind
        elements = node.color_ramp.elements
        while len(elements) < len(stops):
            elements.new(0.5)
        for element, (position, rgb) in zip(elements, stops, strict=True):
            element.position, element.color = position, (*rgb, 1.0)
        return node.outputs["Color"]

    def mix(self, factor: Socket | float, a: Any, b: Any) -> Socket:
        """The colours `a` (factor 0) to `b` (factor 1)."""
        node = self.add("ShaderNodeMix", {0: factor, 6: a, 7: b}, data_type="RGBA")
        return node.outputs[2]

    def output(self, shader: Socket, kind: str = "ShaderNodeOutputMaterial") -> None:
        """Ends the tree."""
        self.add(kind, {"Surface": shader})


def material_nodes(tree: Any, parameters: Parameters, scale: float) -> None:
    """Fills a material's node tree; `scale` is the object's, so that textures are measured in metres."""
    nodes = NodeTree(tree)
    if parameters.get("transmission", 0) > 0:
        nodes.output(_glass(nodes, parameters))
    else:
        nodes.output(_opaque(nodes, parameters, scale))


def surface_nodes(tree: Any, texture: Parameters, roughness: float, specular: float) -> None:
    """A table, floor or wall: its texture on a dielectric."""
    parameters = {
        "base_color": texture["colours"][0],
        "roughness": roughness,
        "specular": specular,
        "texture": texture,
        "texture_mix": 1.0,
    }
    material_nodes(tree, parameters, 1.0)


def world_nodes(tree: Any, image: Any, rotation: float, strength: float) -> None:
    """A panorama turned about z by `rotation` radians.

    The texture turns itself: its own mapping is a matrix, where a mapping node would compute sines and
    cosines for every ray.
    """
    nodes = NodeTree(tree)
    panorama = nodes.add("ShaderNodeTexEnvironment", image=image)
    panorama.texture_mapping.rotation = (0, 0, rotation)
    inputs = {"Color": panorama.outputs[0], "Strength": strength}
    shader = nodes.add("ShaderNodeBackground", inputs).outputs[0]
    nodes.output(shader, "ShaderNodeOutputWorld")


def _opaque(nodes: NodeTree, parameters: Parameters, scale: float) -> Socket:
    inputs: dict[str, Any] = {INPUTS[k]: v for k, v in parameters.items() if k in INPUTS}
    base = (*parameters["base_color"], 1.0)
    inputs["Base Color"] = base
    if parameters.get("texture"):
        colour = texture_colour(nodes, parameters["texture"], scale)
        inputs["Base Color"] = nodes.mix(parameters["texture_mix"], base, colour)
    if parameters.get("anisotropic", 0) > 0:
        tangent = nodes.add("ShaderNodeTangent", direction_type="RADIAL", axis="Z").outputs[0]
        inputs["Tangent"] = tangent
    if parameters.get("bump", 0) > 0:
        coordinates = nodes.add("ShaderNodeTexCoord").outputs["Object"]
        height = nodes.add("ShaderNodeTexNoise", {"Vector": coordinates, "Scale": 400.0 * scale}).outputs[0]
        bump = {"Strength": parameters["bump"], "Distance": 0.001, "Height": height}
        inputs["Normal"] = nodes.add("ShaderNodeBump", bump).outputs[0]
    return nodes.add("ShaderNodeBsdfPrincipled", inputs).outputs[0]


def _glass(nodes: NodeTree, parameters: Parameters) -> Socket:
    """Glass to the eye; a thin tint, darker at grazing angles, to light that falls through it.

    Without caustics a refracting body would cast a black shadow; light that reaches the table through it
    is let through straight instead, as renderers commonly do.
    """
    colour = (*parameters["base_color"], 1.0)
    glass = {"Color": colour, "Roughness": parameters["roughness"], "IOR": parameters["ior"]}
    seen = nodes.add("ShaderNodeBsdfGlass", glass).outputs[0]
    facing = nodes.add("ShaderNodeLayerWeight", {"Blend": 0.35}).outputs["Facing"]
    tint = [c * parameters.get("shadow_tint", 0.85) for c in parameters["base_color"]]
    passed = nodes.ramp(facing, [(0.0, tint), (1.0, [0.35 * c for c in tint])])
    through = nodes.add("ShaderNodeBsdfTransparent", {"Color": passed}).outputs[0]
    path = nodes.add("ShaderNodeLightPath")
    falls = nodes.math("MAXIMUM", path.outputs["Is Shadow Ray"], path.outputs["Is Diffuse Ray"])
    return nodes.add("ShaderNodeMixShader", {0: falls, 1: seen, 2: through}).outputs[0]


def texture_colour(nodes: NodeTree, texture: Parameters, scale: float) -> Socket:
    """The colour of a procedural texture at the shaded point, in object coordinates."""
    place = {
        "Vector": nodes.add("ShaderNodeTexCoord").outputs["Object"],
        "Location": texture["offset"],
        "Rotation": texture["rotation"],
        "Scale": [texture["scale"] * scale] * 3,
    }
    where = nodes.add("ShaderNodeMapping", place).outputs[0]
    return PATTERNS[texture["pattern"]](nodes, where, texture)


def _noise(
    nodes: NodeTree, where: Socket, detail: float = 3.0, distortion: float = 0.0, scale: float = 1.0
) -> Socket:
    inputs = {"Vector": where, "Scale": scale, "Detail": detail, "Distortion": distortion}
    return nodes.add("ShaderNodeTexNoise", inputs).outputs["Fac"]


def _stops(texture: Parameters) -> list[tuple[float, list[float]]]:
    """The three colours about the middle of noise's range; low contrast blends, high contrast separates."""
    half = 0.30 - 0.2 * texture["contrast"]
    first, second, third = texture["colours"]
    return [(0.5 - half, first), (0.5, second), (0.5 + half, third)]


def _clouds(nodes: NodeTree, where: Socket, texture: Parameters) -> Socket:
    return nodes.ramp(_noise(nodes, where, 3.0, texture["distortion"]), _stops(texture))


def _marble(nodes: NodeTree, where: Socket, texture: Parameters) -> Socket:
    return nodes.ramp(_noise(nodes, where, 5.0, 1.0 + 3 * texture["distortion"]), _stops(texture))


def _wood(nodes: NodeTree, where: Socket, texture: Parameters) -> Socket:
    """Rings cut lengthwise: stripes along x that meander slowly, with fine fibres."""
    long = nodes.add("ShaderNodeMapping", {"Vector": where, "Scale": (0.2, 1.0, 1.0)}).outputs[0]
    meander = nodes.math("MULTIPLY", _noise(nodes, long, 2.0), 4 + 6 * texture["distortion"])
    across = nodes.add("ShaderNodeSeparateXYZ", {0: where}).outputs[1]
    rings = nodes.math("FRACT", nodes.math("ADD", meander, across))
    fibre = nodes.add("ShaderNodeMapping", {"Vector": where, "Scale": (1.0, 40.0, 40.0)}).outputs[0]
    grain = nodes.math("MULTIPLY", nodes.math("SUBTRACT", _noise(nodes, fibre, 2.0), 0.5), 1.2)
    light, middle, dark = texture["colours"]
    return nodes.ramp(nodes.math("ADD", rings, grain), [(0.0, light), (0.6, middle), (1.0, dark)])


def _plain(nodes: NodeTree, where: Socket, texture: Parameters) -> Socket:
    base = texture["colours"][0]
    shade = [c * (1 - 0.3 * texture["contrast"]) for c in base]
    return nodes.ramp(_noise(nodes, where, 4.0), [(0.35, base), (0.65, shade)])


def _bricks(nodes: NodeTree, where: Socket, texture: Parameters, offset: float, width: float) -> Socket:
    first, second, third = ((*c, 1.0) for c in texture["colours"])
    inputs = {
        "Vector": where,
        "Color1": first,
        "Color2": second,
        "Mortar": third,
        "Scale": 1.0,
        "Mortar Size": 0.01 + 0.02 * texture["distortion"],
        "Brick Width": width,
        "Row Height": 1.0,
    }
    colour = nodes.add("ShaderNodeTexBrick", inputs, offset=offset).outputs["Color"]
    dirt = nodes.ramp(_noise(nodes, where, 4.0, 0.0, 6.0), [(0.3, [0.75] * 3), (0.7, [1.0] * 3)])
    node = nodes.add("ShaderNodeMix", {0: 1.0, 6: colour, 7: dirt}, data_type="RGBA", blend_type="MULTIPLY")
    return node.outputs[2]


def _tiles(nodes: NodeTree, where: Socket, texture: Parameters) -> Socket:
    return _bricks(nodes, where, texture, 0.0, 1.0)


def _planks(nodes: NodeTree, where: Socket, texture: Parameters) -> Socket:
    return _bricks(nodes, where, texture, 0.5, 4.0)


def _checker(nodes: NodeTree, where: Socket, texture: Parameters) -> Socket:
    first, second, _ = ((*c, 1.0) for c in texture["colours"])
    inputs = {"Vector": where, "Color1": first, "Color2": second, "Scale": 1.0}
    return nodes.add("ShaderNodeTexChecker", inputs).outputs["Color"]


def _speckled(nodes: NodeTree, where: Socket, texture: Parameters) -> Socket:
    first, second, third = texture["colours"]
    edge = 0.22 + 0.2 * texture["contrast"]
    spots = _noise(nodes, where, 1.0)
    return nodes.ramp(spots, [(0.0, second), (edge, first), (1 - edge, third)], "CONSTANT")


def _fabric(nodes: NodeTree, where: Socket, texture: Parameters) -> Socket:
    waves = [
        nodes.add(
            "ShaderNodeTexWave",
            {"Vector": where, "Scale": 0.3, "Distortion": 1.0, "Detail": 1.0},
            bands_direction=axis,
        ).outputs["Fac"]
        for axis in ("X", "Y")
    ]
    weave = nodes.math("MULTIPLY", *waves)
    first, second, third = texture["colours"]
    patches = nodes.ramp(_noise(nodes, where, 2.0, 0.0, 0.02), [(0.4, second), (0.6, third)])
    return nodes.mix(weave, (*first, 1.0), patches)


def _cells(nodes: NodeTree, where: Socket, texture: Parameters) -> Socket:
    voronoi = nodes.add("ShaderNodeTexVoronoi", {"Vector": where, "Scale": 1.0})
    first, second, third = texture["colours"]
    if texture["distortion"] < 0.5:
        return nodes.ramp(voronoi.outputs["Distance"], [(0.1, first), (0.5, second), (0.9, third)])
    shade = nodes.add("ShaderNodeSeparateColor", {0: voronoi.outputs["Color"]}).outputs[0]
    return nodes.ramp(shade, [(0.0, first), (0.33, second), (0.66, third)], "CONSTANT")


def _bands(nodes: NodeTree, where: Socket, texture: Parameters) -> Socket:
    inputs = {"Vector": where, "Scale": 0.3, "Distortion": 3 * texture["distortion"], "Detail": 1.0}
    wave = nodes.add("ShaderNodeTexWave", inputs).outputs["Fac"]
    return nodes.ramp(wave, _stops(texture), "LINEAR" if texture["contrast"] < 0.5 else "CONSTANT")


def _magic(nodes: NodeTree, where: Socket, texture: Parameters) -> Socket:
    inputs = {"Vector": where, "Scale": 0.4, "Distortion": 1 + 2 * texture["distortion"]}
    return nodes.ramp(nodes.add("ShaderNodeTexMagic", inputs).outputs["Fac"], _stops(texture))


def _label(nodes: NodeTree, where: Socket, texture: Parameters) -> Socket:
    """Something like a printed package: fields of flat colour with small blocks as of lettering."""
    first, second, third = texture["colours"]
    field = nodes.ramp(_noise(nodes, where, 0.0), [(0.0, first), (0.5, second)], "CONSTANT")
    squeezed = nodes.add("ShaderNodeMapping", {"Vector": where, "Scale": (6.0, 6.0, 14.0)}).outputs[0]
    letters = nodes.add("ShaderNodeTexVoronoi", {"Vector": squeezed, "Scale": 1.0}, distance="CHEBYCHEV")
    ink = nodes.math("LESS_THAN", letters.outputs["Distance"], 0.15 + 0.2 * texture["contrast"])
    return nodes.mix(ink, field, (*third, 1.0))


PATTERNS = {
    "noise": _clouds,
    "marble": _marble,
    "wood": _wood,
    "plain": _plain,
    "tiles": _tiles,
    "planks": _planks,
    "checker": _checker,
    "speckled": _speckled,
    "fabric": _fabric,
    "cells": _cells,
    "bands": _bands,
    "magic": _magic,
    "label": _label,
}
