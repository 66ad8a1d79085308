"""Nothing is left behind on the CPU: PyTorch's meta device refuses whatever mixes devices.

It computes nothing, so what depends on values (which rays are drawn) is tested on CUDA alone (`tests/gpu`).
"""

from __future__ import annotations

import pytest
import torch

from neugrasp.geometry.workspace import Workspace
from neugrasp.model.config import ModelConfig
from neugrasp.model.inputs import ViewTensors
from neugrasp.model.network import NeuGrasp
from neugrasp.model.rendering import cut_to_workspace
from neugrasp.training.config import LossWeights
from neugrasp.training.losses import (
    distance_loss,
    eikonal_loss,
    grasp_loss,
    occupancy_loss,
    photometric_loss,
    tsdf_loss,
)
from neugrasp.training.recipes import RECIPES, tiny
from neugrasp.training.samples import LabelTensors

pytestmark = pytest.mark.slow

META = torch.device("meta")
MODELS = {name: make().model for name, make in RECIPES.items()} | {"tiny": tiny().model}


@pytest.mark.parametrize("name", ["tiny", "small", "paper", "without-attention", "without-occupancy"])
def test_photos_to_grasps_and_renderings(views: ViewTensors, name: str):
    config: ModelConfig = MODELS[name]
    model = NeuGrasp(config).to(META)
    there = views.to(META)
    reconstruction, volume = model(there)
    assert reconstruction.sdf.device == volume.quality.device == META
    rays = cut_to_workspace(*there.cameras.rays(0, torch.ones(5, 2, device=META)), model.workspace)
    coarse, fine = model.render(reconstruction.scene, rays, model.sharpness(100.0))
    weights, midpoints = model.weights_on_grid(reconstruction, rays, model.sharpness(100.0))
    assert {coarse.colour.device, fine.depth.device, weights.device, midpoints.device} == {META}


def test_every_term_of_the_loss(views: ViewTensors):
    model, workspace = NeuGrasp(tiny().model).to(META), Workspace()
    there = views.to(META)
    reconstruction, volume = model(there)
    rays = cut_to_workspace(*there.cameras.rays(0, torch.ones(5, 2, device=META)), workspace)
    rendered, _ = model.render(reconstruction.scene, rays, model.sharpness(100.0))
    grid = torch.ones(40, 40, 40, device=META)
    index = torch.zeros(7, 3, dtype=torch.long, device=META)
    quaternions, widths = torch.ones(7, 4, device=META), torch.ones(7, device=META)
    success = torch.ones(7, dtype=torch.bool, device=META)
    heights = reconstruction.scene.centres[:40, 2]
    columns = model.sdf_columns(reconstruction.scene, torch.zeros(9, dtype=torch.long, device=META))
    terms = {
        "photometric": photometric_loss(rendered, rendered.colour, rendered.colour),
        "eikonal": eikonal_loss(reconstruction.sdf, reconstruction.seen, workspace),
        "tsdf": tsdf_loss(reconstruction.sdf, grid, grid.bool()),
        "grasp": grasp_loss(volume, [LabelTensors(index, quaternions, widths, success)]),
        "distance": distance_loss(columns, columns, heights, workspace),
        "occupancy": occupancy_loss(columns, columns, heights, workspace),
    }
    assert {term.device for term in terms.values()} == {META}
    assert terms.keys() <= set(LossWeights.__dataclass_fields__)
