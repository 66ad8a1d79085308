"""VGN in the project's own code: the public names, the grid, and where a voxel is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from neugrasp.baselines.depth_noise import NoisyDepth
from neugrasp.baselines.vgn import PUBLIC_NAMES, VgnDetector, VgnHead, load_vgn_head, vgn_selection
from neugrasp.detection.decode import SelectionConfig
from neugrasp.errors import InputError
from neugrasp.geometry.fusion import Tsdf
from neugrasp.geometry.pose import rigid, rotation_about, to_quaternion
from neugrasp.geometry.view_sets import view_set
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper
from neugrasp.model.config import ModelConfig
from neugrasp.model.grasp_head import GraspHead, GraspVolume
from neugrasp.observation import DepthView, DepthViews
from neugrasp.simulation.depth import plane_depth


def public_state(head: GraspHead) -> dict[str, Tensor]:
    """The weights of a head under the names of the public checkpoint."""
    own = head.state_dict()
    return {
        f"{public}.{part}": own[f"{name}.{part}"]
        for public, name in PUBLIC_NAMES.items()
        for part in ("weight", "bias")
    }


def test_a_public_checkpoint_is_read_into_the_same_network(tmp_path: Path):
    torch.manual_seed(1)
    head = GraspHead(ModelConfig())
    assert sum(p.numel() for p in head.parameters()) == 313_238
    state = public_state(head)
    assert len(state) == 18
    torch.save(state, tmp_path / "vgn.pth")
    loaded = load_vgn_head(tmp_path / "vgn.pth")
    grid = torch.rand(1, 40, 40, 40)
    with torch.no_grad():
        assert torch.equal(loaded(grid).quality, head.eval()(grid).quality)


def test_other_files_are_refused(tmp_path: Path):
    path = tmp_path / "vgn.pth"
    with pytest.raises(InputError, match="not readable"):
        load_vgn_head(path)
    path.write_bytes(b"not a checkpoint")
    with pytest.raises(InputError, match="not readable"):
        load_vgn_head(path)
    torch.save({"weight": torch.zeros(3)}, path)
    with pytest.raises(InputError, match="18 tensors"):
        load_vgn_head(path)
    state = public_state(GraspHead(ModelConfig()))
    torch.save(state | {"conv_qual.bias": torch.zeros(2)}, path)
    with pytest.raises(InputError, match=r"conv_qual\.bias"):
        load_vgn_head(path)


class OneVoxel(nn.Module):
    """A head that is sure of one voxel."""

    def __init__(self, index: tuple[int, int, int], quaternion: np.ndarray):
        super().__init__()
        self.index, self.quaternion = index, quaternion
        self.grid = torch.zeros(0)

    def forward(self, grid: Tensor) -> GraspVolume:
        self.grid = grid
        quality = torch.zeros(1, 40, 40, 40)
        i, j, k = self.index
        # As large a block as smoothing needs to leave 1 in its middle.
        quality[:, i - 4 : i + 5, j - 4 : j + 5, k - 4 : k + 5] = 0.95
        quality[:, i, j, k] = 1.0
        rotation = (
            torch.tensor(self.quaternion, dtype=torch.float32).view(1, 4, 1, 1, 1).expand(1, 4, 40, 40, 40)
        )
        return GraspVolume(quality, rotation, torch.full((1, 40, 40, 40), 5.0), quality)


def test_index_i_is_the_position_i_times_the_voxel_size(workspace: Workspace):
    """VGN's labels are stored at round(position / voxel size), without this project's half voxel."""
    down = to_quaternion(rigid(rotation_about((1, 0, 0), np.pi)))
    head = OneVoxel((18, 22, 12), down)
    height = workspace.voxel_centres()[..., 2] - workspace.table_height
    values = (height / workspace.truncation).clip(-1, 1).astype(np.float32)
    gripper = Gripper.load("panda")
    chosen, grid = vgn_selection(
        VgnHead(head, is_public=True),
        Tsdf(values, np.ones_like(values)),
        workspace,
        gripper,
        SelectionConfig(),  # type: ignore[arg-type]
    )
    best = chosen.grasps[0].advanced(-gripper.tcp_depth)
    np.testing.assert_allclose(best.position, np.array([18, 22, 12]) * workspace.voxel_size, atol=1e-9)
    np.testing.assert_allclose(best.approach, (0, 0, -1), atol=1e-6)
    assert best.width == pytest.approx(5 * workspace.voxel_size)
    assert grid.min() == -1
    assert head.grid.min() == 0
    assert head.grid.max() <= 1


def test_grasps_come_back_in_the_users_world(workspace: Workspace, rng: np.random.Generator):
    from dataclasses import replace

    cameras = view_set("hemisphere6", workspace, rng)
    depths = [plane_depth(c, workspace.centre, 1.2).astype(np.float32) for c in cameras]
    head = OneVoxel((18, 22, 10), to_quaternion(rigid(rotation_about((1, 0, 0), np.pi))))
    detector = VgnDetector(VgnHead(head, is_public=True), Gripper.load("panda"))  # type: ignore[arg-type]
    moved = rigid(rotation_about((0.2, 0.1, 1), 0.7), (1.0, -2.0, 0.3))
    elsewhere = replace(workspace, world_from_workspace=moved)
    here = DepthViews(tuple(DepthView(c, depth=d) for d, c in zip(depths, cameras, strict=True)), workspace)
    there = DepthViews(
        tuple(DepthView(c.moved(moved), depth=d) for d, c in zip(depths, cameras, strict=True)), elsewhere
    )
    first, second = detector.detect(here), detector.detect(there)
    assert len(first.grasps) == len(second.grasps) > 0
    for a, b in zip(first.grasps, second.grasps, strict=True):
        np.testing.assert_allclose(a.moved(moved).pose, b.pose, atol=1e-9)
    np.testing.assert_allclose(first.tsdf, second.tsdf, atol=1e-5)


def test_noise_has_the_stated_size_and_belongs_to_the_image():
    depth = np.full((120, 160), 0.5, dtype=np.float32)
    depth[:10] = 0
    images = [NoisyDepth(seed)(depth) for seed in range(200)]
    assert np.array_equal(images[3], NoisyDepth(3)(depth))
    assert not np.array_equal(images[3], images[4])
    assert all((image[:10] == 0).all() and (image[10:] > 0).all() for image in images)
    means = np.array([image[10:].mean() for image in images]) / 0.5
    assert means.std() == pytest.approx(1 / np.sqrt(1000), rel=0.25)
    assert means.mean() == pytest.approx(1, abs=0.01)
    spreads = np.array([image[10:].std() for image in images])
    assert 0.35 < np.mean(spreads > 1e-3) < 0.65
    assert spreads.max() < 0.006
