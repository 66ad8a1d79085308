"""What bfloat16 does to the answer."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from agreement import Found, agreement
from neugrasp.data.scene_folder import read_scene
from neugrasp.demo.bundled import demo_scenes
from neugrasp.detection.detector import NeuGraspDetector

NAMES = [scene.name for scene in demo_scenes()]
VOXEL = 0.0075


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_the_best_grasp_of_a_bundled_scene_is_found_in_bfloat16_too(name: str):
    """It keeps its place, turn and width; scores move by less than 0.01, so equals may change places."""
    (scene,) = [scene for scene in demo_scenes() if scene.name == name]
    detector, views = NeuGraspDetector.load(), read_scene(scene.folder)
    exact = detector.detect(views)
    with torch.autocast("cpu", torch.bfloat16):
        rough = detector.detect(views)
    best = exact.grasps[0]
    same = min(rough.grasps, key=lambda grasp: float(np.linalg.norm(grasp.position - best.position)))
    assert np.linalg.norm(same.position - best.position) < VOXEL
    assert np.degrees(np.arccos(min(1.0, (np.trace(same.pose[:3, :3].T @ best.pose[:3, :3]) - 1) / 2))) < 3
    assert abs(same.width - best.width) < 0.002
    assert rough.grasps[0].score - same.score < 0.01
    found = agreement(
        Found(rough.tsdf, rough.grasps), Found(exact.tsdf, exact.grasps), views.workspace, detector.gripper
    )
    assert found.shared >= 0.5 * found.reference_grasps
