"""Photos of glass: a work cell, objects and materials in, ray-traced pictures out.

    python examples/03_render_glass.py --materials transparent

A work cell is drawn from a seed: four cameras on an arc, a panorama for light, a table. Blender renders it
with the objects and once more empty. The result is a scene folder like one that you would photograph, so the
whole pipeline runs on it:

    neugrasp predict outputs/glass --out outputs/glass/prediction

Blender runs as a process of its own, which starts with the first photo and ends with the `with` statement.
Needs `pip install 'neugrasp[sim,render]'`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import tyro

from neugrasp.data.scene_folder import write_scene
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import View, Views
from neugrasp.pictures import Tile, contact_sheet, write_picture
from neugrasp.simulation.arrange import arrange
from neugrasp.simulation.cell import sample_cell
from neugrasp.simulation.materials import sample_materials
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.simulation.physics import World
from neugrasp.simulation.renderer import Renderer


def main(
    materials: Literal["transparent", "specular", "diffuse", "transparent-specular", "mixed"] = "transparent",
    seed: int = 1,
    size: int = 256,
    out: Path = Path("outputs/glass"),
) -> None:
    """Renders the photos of one scene and of its empty table."""
    workspace = Workspace()
    library = ObjectLibrary.open(["glassware"])
    with World(workspace, library) as world:
        hollow = [c for c in library.choices("test", "packed") if not c[1].startswith(("box", "can"))]
        scene = arrange("packed", seed, world, hollow, num_objects=4)
    scene = sample_materials(scene, materials, np.random.default_rng(seed))
    for body, material in zip(scene.bodies, scene.materials, strict=True):
        print(f"{body.name}: {material.preset}")

    cell = sample_cell(workspace, "released", seed, "test", size=size)
    inputs = range(cell.num_inputs)
    with Renderer() as renderer:
        empty = renderer.render(cell, None, library, inputs)
        photos = renderer.render(cell, scene, library, inputs)

    triples = zip(photos, empty, cell.cameras[: cell.num_inputs], strict=True)
    write_scene(out, Views(tuple(View(camera, *pair) for *pair, camera in triples), workspace))
    tiles = [Tile(photo, f"view {i}") for i, photo in enumerate(photos)]
    tiles += [Tile(photo, f"view {i}, empty") for i, photo in enumerate(empty)]
    write_picture(out / "photos.png", contact_sheet(tiles, columns=cell.num_inputs))
    print(out / "photos.png")


if __name__ == "__main__":
    tyro.cli(main)
