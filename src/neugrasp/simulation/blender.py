"""The Blender process: builds cells and scenes in Cycles and renders their photos.

Run by `renderer.Renderer` as `python -m neugrasp.simulation.blender`. Requests come as lines of JSON on the
standard input, replies go as lines of JSON to the file descriptor given; Blender prints to standard output.
The only module that imports bpy. Blender's world is the workspace frame.
"""

from __future__ import annotations

import json
import os
import sys
import time
import traceback
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.data.world import camera_from_dict
from neugrasp.errors import require
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array, from_quaternion, rigid
from neugrasp.simulation.blender_frames import (
    OPENCV_FROM_OPENGL,
    SENSOR_WIDTH,
    facing,
    lens_of,
    pixels_inside,
    upright,
)
from neugrasp.simulation.blender_materials import material_nodes, surface_nodes, world_nodes
from neugrasp.simulation.blender_projector import pattern_image, projector_nodes
from neugrasp.simulation.meshes import merged, read_obj

SHARP_EDGE = np.deg2rad(40)
"""Edges sharper than this stay edges; flatter ones are shaded smooth."""
MESH_CACHE = 400
MARGIN = 3
"""Pixels rendered around what is wanted: the denoiser is less sure of itself at the edge of a picture."""


class Stage:
    """Blender's one scene, in which cells and arrangements are swapped."""

    def __init__(self, settings: dict[str, Any]):
        self._bpy: Any = require("bpy", "render")
        self._bpy.ops.wm.read_factory_settings(use_empty=True)
        self._scene = self._bpy.context.scene
        self._meshes: dict[str, Any] = {}
        self._cell: dict[str, Any] | None = None
        self._bodies: list[dict[str, Any]] | None = None
        self._configure(settings)
        data = self._bpy.data.cameras.new("camera")
        self._camera = self._bpy.data.objects.new("camera", data)
        self._scene.collection.objects.link(self._camera)
        self._scene.camera = self._camera
        self._scene.world = self._bpy.data.worlds.new("world")
        self._scene.world.use_nodes = True
        self._static: list[Any] = []
        self._moving: list[Any] = []

    def _configure(self, settings: dict[str, Any]) -> None:
        """Few samples, guided denoising, just enough bounces for glass."""
        render, cycles = self._scene.render, self._scene.cycles
        render.engine = "CYCLES"
        render.use_persistent_data = True
        render.threads_mode = "FIXED"
        render.threads = settings["threads"]
        render.use_compositing = render.use_sequencer = False
        render.dither_intensity = 0.0
        render.image_settings.file_format = "PNG"
        render.image_settings.color_mode = "RGB"
        render.image_settings.compression = 0
        render.resolution_percentage = 100
        self._scene.display_settings.display_device = "sRGB"
        self._scene.view_settings.view_transform = settings["view_transform"]
        cycles.device = "CPU"
        cycles.samples = settings["samples"]
        cycles.use_adaptive_sampling = False
        cycles.use_denoising = settings["denoise"] != "OFF"
        cycles.denoiser = "OPENIMAGEDENOISE"
        cycles.denoising_input_passes = "RGB_ALBEDO_NORMAL"
        cycles.denoising_prefilter = settings["prefilter"]
        if cycles.use_denoising:
            cycles.denoising_quality = settings["denoise"]
        cycles.max_bounces = 10
        cycles.diffuse_bounces = 1
        cycles.glossy_bounces = 3
        cycles.transmission_bounces = 8
        cycles.transparent_max_bounces = 8
        cycles.volume_bounces = 0
        cycles.caustics_reflective = cycles.caustics_refractive = False
        cycles.blur_glossy = 0.5
        cycles.sample_clamp_direct = 0.0
        cycles.sample_clamp_indirect = 4.0
        cycles.use_light_tree = False
        cycles.use_auto_tile = False
        for name, value in settings.get("cycles", {}).items():
            setattr(cycles, name, value)

    def render(self, request: dict[str, Any]) -> list[dict[str, Any]]:
        """Files and borders of the photos of a cell with bodies, one for each camera asked for."""
        self._enter(request["cell"])
        self._lay(request["bodies"])
        return [self._photo(index, Path(request["folder"])) for index in request["cameras"]]

    def _photo(self, index: int, folder: Path) -> dict[str, Any]:
        """One photo, written as PNG; only the part of the image inside `bounds` of the camera is rendered.

        The noise depends on the cell and the camera alone, so that a background has the noise of its scene.
        """
        assert self._cell is not None
        started = time.perf_counter()
        border = self._aim(camera_from_dict(self._cell["cameras"][index]))
        self._scene.cycles.seed = (self._cell["seed"] * 7919 + index * 104729) % 2**31
        path = folder / f"{index}.png"
        self._scene.render.filepath = str(path)
        self._bpy.ops.render.render(write_still=True)
        seconds = time.perf_counter() - started
        return {"file": str(path), "border": border, "margin": MARGIN, "seconds": seconds}

    def _aim(self, camera: Camera) -> tuple[int, int, int, int]:
        """Places the camera; gives back the pixels (left, top, right, bottom; end exclusive) to be seen.

        `MARGIN` more are rendered on every side.
        """
        left, top, right, bottom = pixels_inside(camera.bounds)
        width, height = camera.width + 2 * MARGIN, camera.height + 2 * MARGIN
        wider = (-0.5 - MARGIN, -0.5 - MARGIN, camera.width - 0.5 + MARGIN, camera.height - 0.5 + MARGIN)
        lens, blender = lens_of(camera.cropped_and_resized(wider, width, height)), self._camera.data
        blender.sensor_fit, blender.sensor_width = "HORIZONTAL", SENSOR_WIDTH
        blender.lens, (blender.shift_x, blender.shift_y) = lens.focal, lens.shift
        blender.clip_start, blender.clip_end = 0.01, 50.0
        self._camera.matrix_world = lens.world_from_camera.T.tolist()
        render = self._scene.render
        render.resolution_x, render.resolution_y = width, height
        render.pixel_aspect_x, render.pixel_aspect_y = lens.pixel_aspect
        render.use_border = render.use_crop_to_border = True
        # A thousandth of a pixel keeps the truncation to whole pixels on the right side.
        render.border_min_x, render.border_max_x = (left + 1e-3) / width, (right + 2 * MARGIN + 1e-3) / width
        render.border_min_y = (camera.height - bottom + 1e-3) / height
        render.border_max_y = (camera.height - top + 2 * MARGIN + 1e-3) / height
        return left, top, right, bottom

    def _enter(self, cell: dict[str, Any]) -> None:
        """Builds light, table and surroundings unless they stand already."""
        if (
            self._cell is not None
            and self._cell["light"] == cell["light"]
            and self._cell["table"] == cell["table"]
        ):
            self._cell = cell
            return
        self._cell = None
        self._forget()
        self._remove(self._static)
        light, table = cell["light"], cell["table"]
        image = self._bpy.data.images.load(str(self._panorama(light["hdri"])), check_existing=True)
        world_nodes(self._scene.world.node_tree, image, light["rotation"], light["strength"])
        self._scene.world.cycles.sampling_method = "MANUAL"
        self._scene.world.cycles.sample_map_resolution = 512
        self._scene.view_settings.exposure = light["exposure"]
        for lamp in light["lamps"]:
            self._add_lamp(lamp)
        if "projector" in light:
            self._add_projector(light["projector"])
        self._add_plane("table", rigid(None, table["centre"]), table["size"], table["texture"], table)
        x, y, _ = table["centre"]
        floor = table["floor"]
        self._add_plane("floor", rigid(None, (x, y, floor["height"])), (6.0, 6.0), floor["texture"], table)
        if table["wall"]:
            place = upright((x, y, floor["height"]), table["wall"]["azimuth"], table["wall"]["distance"])
            self._add_plane("wall", place, (6.0, 5.0), table["wall"]["texture"], table)
        self._cell = cell

    def _forget(self) -> None:
        """Drops what Cycles keeps: the order of its lights, and with it the noise, depends on the past."""
        self._scene.render.use_persistent_data = False
        self._scene.render.use_persistent_data = True

    def _panorama(self, name: str) -> Path:
        folder = self._bpy.utils.system_resource("DATAFILES", path="studiolights")
        return Path(folder) / "world" / f"{name}.exr"

    def _add_lamp(self, lamp: dict[str, Any]) -> None:
        """A square lamp; a radiant flux P at distance d gives the table about P / (pi d^2) watts per m^2."""
        data = self._bpy.data.lights.new("lamp", "AREA")
        offset = np.array(lamp["position"]) - np.array(lamp["target"])
        distance = float(np.linalg.norm(offset))
        cosine = offset[2] / distance
        data.energy = lamp["irradiance"] * np.pi * np.pi * distance**2 / cosine
        data.size, data.color = lamp["size"], lamp["colour"]
        place = facing(lamp["position"], lamp["target"])
        self._static.append(self._linked("lamp", data, place))

    def _add_projector(self, projector: dict[str, Any]) -> None:
        """A lamp without size that throws dots along the line of sight of an OpenCV camera."""
        data = self._bpy.data.lights.new("projector", "POINT")
        data.energy, data.shadow_soft_size, data.use_nodes = projector["energy"], 0.0, True
        projector_nodes(data.node_tree, pattern_image(self._bpy.data.images, projector["dot_spacing"]))
        place = np.array(projector["world_from_camera"]) @ OPENCV_FROM_OPENGL
        self._static.append(self._linked("projector", data, place))

    def _add_plane(self, name: str, place: Array, size: Any, texture: Any, finish: dict[str, Any]) -> None:
        mesh = self._bpy.data.meshes.new(name)
        x, y = size[0] / 2, size[1] / 2
        mesh.from_pydata([(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)], [], [(0, 1, 2, 3)])
        material = self._bpy.data.materials.new(name)
        material.use_nodes = True
        surface_nodes(material.node_tree, texture, finish["roughness"], finish["specular"])
        mesh.materials.append(material)
        self._static.append(self._linked(name, mesh, place))

    def _lay(self, bodies: list[dict[str, Any]]) -> None:
        """Swaps in the bodies of a scene unless they lie there already."""
        if bodies == self._bodies:
            return
        self._bodies = None
        self._remove(self._moving)
        for number, body in enumerate(bodies):
            place = from_quaternion(body["quaternion_xyzw"], body["position"])
            place[:3, :3] *= body["scale"]
            material = self._bpy.data.materials.new(f"body{number}")
            material.use_nodes = True
            material_nodes(material.node_tree, body["parameters"], body["scale"])
            item = self._linked(f"body{number}", self._mesh(body["mesh"]), place)
            item.material_slots[0].link = "OBJECT"
            item.material_slots[0].material = material
            self._moving.append(item)
        self._bodies = bodies

    def _mesh(self, path: str) -> Any:
        """The mesh of a file with smooth normals, from the cache where it was used before."""
        if path in self._meshes:
            return self._meshes[path]
        source = merged(read_obj(Path(path)))
        welded, index = np.unique(np.round(source.vertices, 7), axis=0, return_inverse=True)
        faces = index.reshape(-1)[source.faces]
        faces = faces[[len(set(face)) == 3 for face in faces.tolist()]]
        mesh = self._bpy.data.meshes.new(Path(path).stem)
        mesh.from_pydata(welded.tolist(), [], faces.tolist())
        mesh.shade_smooth()
        mesh.set_sharp_from_angle(angle=SHARP_EDGE)
        mesh.materials.append(None)
        mesh.use_fake_user = True
        if len(self._meshes) >= MESH_CACHE:
            self._bpy.data.meshes.remove(self._meshes.pop(next(iter(self._meshes))))
        self._meshes[path] = mesh
        return mesh

    def _linked(self, name: str, data: Any, place: Array) -> Any:
        item = self._bpy.data.objects.new(name, data)
        item.matrix_world = place.T.tolist()
        self._scene.collection.objects.link(item)
        return item

    def _remove(self, items: list[Any]) -> None:
        """Deletes objects, their materials, and the data that no cache keeps."""
        for item in items:
            data = item.data
            materials = [slot.material for slot in getattr(item, "material_slots", ())]
            self._bpy.data.objects.remove(item)
            for material in materials:
                self._bpy.data.materials.remove(material)
            if not data.use_fake_user:
                owner = self._bpy.data.lights if hasattr(data, "energy") else self._bpy.data.meshes
                owner.remove(data)
        items.clear()


def serve(settings: dict[str, Any], reply_descriptor: int) -> None:
    """Answers requests until the standard input ends."""
    with os.fdopen(reply_descriptor, "w") as replies:
        stage = Stage(settings)
        replies.write(json.dumps({"ready": True}) + "\n")
        replies.flush()
        for line in sys.stdin:
            try:
                reply: dict[str, Any] = {"photos": stage.render(json.loads(line))}
            except Exception as error:
                reply = {
                    "kind": type(error).__name__,
                    "error": str(error),
                    "details": traceback.format_exc(),
                }
            replies.write(json.dumps(reply) + "\n")
            replies.flush()


if __name__ == "__main__":
    serve(json.loads(sys.argv[1]), int(sys.argv[2]))
