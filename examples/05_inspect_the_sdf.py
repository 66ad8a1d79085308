"""The signed distance field behind a prediction: numbers, cuts and pictures.

    python examples/05_inspect_the_sdf.py
    python examples/05_inspect_the_sdf.py --scene data/few/scenes/packed-0-000000

The network gives every point of the workspace its signed distance to the nearest surface, in units of the
truncation (3 cm): 0 on the surface, positive outside, negative inside. A perfect field changes by one
centimetre per centimetre, so the length of its gradient near the surface, printed below, should be 1. The
cuts run through the middle of the matter, blue outside, red inside, the black line at zero.

Where the scene has a true surface beside it (truth.npz, which the generator writes), it is shown below the
predicted one, and the error is printed beside the errors of three predictors that know nothing.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
import tyro

from neugrasp.data.scene_folder import read_scene
from neugrasp.demo.bundled import demo_scenes
from neugrasp.metrics import CONSTANTS, l1_by_mask
from neugrasp.model.checkpoint import load_checkpoint
from neugrasp.model.inputs import prepare
from neugrasp.pictures import Tile, contact_sheet, slice_picture, surface_sheet, write_picture
from neugrasp.pictures.slices import busiest_slice


@torch.no_grad()
def main(scene: Path | None = None, weights: str = "neugrasp", out: Path = Path("outputs/sdf")) -> None:
    """Draws the field of one scene."""
    folder = scene or demo_scenes()[0].folder
    views = read_scene(folder)
    model = load_checkpoint(weights).model()
    reconstruction, _ = model(prepare(views, model.config.image_size))
    sdf, tsdf = reconstruction.sdf.numpy(), reconstruction.tsdf.numpy()

    workspace = views.workspace
    slope = np.linalg.norm(np.gradient(sdf * workspace.truncation, workspace.voxel_size), axis=0)
    near = np.abs(tsdf) < 0.5
    print(f"values from {sdf.min():.2f} to {sdf.max():.2f}; {np.mean(tsdf < 0):.0%} of the cube is inside")
    if near.any():
        print(f"length of the gradient near the surface: {slope[near].mean():.2f} +- {slope[near].std():.2f}")

    truth = None
    if (folder / "truth.npz").exists():
        truth = np.load(folder / "truth.npz")["tsdf"].astype(np.float32)
        print(f"L1 {l1_by_mask(tsdf, truth)['0.3']:.3f} where -0.3 < truth < 0.1")
        for constant in CONSTANTS:
            print(f"   {l1_by_mask(constant, truth)['0.3']:.3f} for always {constant:+.0f}")

    out.mkdir(parents=True, exist_ok=True)
    known = tsdf if truth is None else truth
    cuts = []
    for what, grid in (("predicted", tsdf), ("true", truth)):
        for axis, name in enumerate("xyz" if grid is not None else ""):
            index = busiest_slice(known, workspace, axis)
            cut = slice_picture(grid, workspace, axis, index, size=320)
            cuts.append(Tile(cut, f"{what}, seen along {name}"))
    write_picture(out / "cuts.png", contact_sheet(cuts, columns=3))
    write_picture(out / "surface.png", surface_sheet(views, tsdf, truth))
    print(f"{out / 'cuts.png'}\n{out / 'surface.png'}")


if __name__ == "__main__":
    tyro.cli(main)
