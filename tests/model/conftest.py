"""A tiny network and photos of random colours, which is enough for what must hold for any photo."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from neugrasp.geometry.sampling import CameraTensors
from neugrasp.geometry.view_sets import view_set
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.inputs import ViewTensors
from neugrasp.model.network import NeuGrasp
from neugrasp.training.recipes import tiny


@pytest.fixture
def views() -> ViewTensors:
    """Four 64 x 64 views from the released arc."""
    workspace = Workspace()
    cameras = [
        camera.cropped_and_resized(workspace.photo_box(camera), 64, 64)
        for camera in view_set("released", workspace, np.random.default_rng(0))
    ]
    generator = torch.Generator().manual_seed(0)
    images, backgrounds = torch.rand((2, 4, 3, 64, 64), generator=generator)
    return ViewTensors(images, backgrounds, CameraTensors.of(cameras))


@pytest.fixture
def model() -> NeuGrasp:
    """The network of the tiny recipe."""
    torch.manual_seed(0)
    return NeuGrasp(tiny().model).eval()
