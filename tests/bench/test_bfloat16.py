"""What bfloat16 does to the answer."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from neugrasp.bench.agreement import Found, agreement
from neugrasp.data.scene_folder import read_scene
from neugrasp.demo import demo_scenes
from neugrasp.detection.detector import NeuGraspDetector

FIRST, *OTHERS = [scene.name for scene in demo_scenes()]


@pytest.mark.parametrize("name", [FIRST, *(pytest.param(name, marks=pytest.mark.slow) for name in OTHERS)])
def test_the_best_grasp_of_a_bundled_scene_is_the_same_in_bfloat16(name: str):
    """The best is identical; of the others, the odd one moves to the next voxel or crosses the threshold."""
    (scene,) = [scene for scene in demo_scenes() if scene.name == name]
    detector, views = NeuGraspDetector.load(), read_scene(scene.folder)
    exact = detector.detect(views)
    with torch.autocast("cpu", torch.bfloat16):
        rough = detector.detect(views)
    same = agreement(
        Found(rough.tsdf, rough.grasps), Found(exact.tsdf, exact.grasps), views.workspace, detector.gripper
    )
    assert same.leading >= 1
    assert same.shared >= 0.5 * same.reference_grasps
    best, truth = rough.grasps[0], exact.grasps[0]
    assert abs(best.score - truth.score) < 0.01
    assert abs(best.width - truth.width) < 0.002
    turn = np.trace(best.pose[:3, :3].T @ truth.pose[:3, :3])
    assert np.degrees(np.arccos(min(1.0, (turn - 1) / 2))) < 2
