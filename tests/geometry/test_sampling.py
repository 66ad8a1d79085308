"""Pixels and voxels are read where they are; the released code's three mistakes are impossible here."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.sampling import (
    CameraTensors,
    LookupTable,
    sample_volume,
    volume_interpolation,
)
from neugrasp.geometry.workspace import Workspace
from reference_network.images import sample_images


@pytest.mark.parametrize("factor", [1, 4])
def test_every_pixel_reads_back_its_own_column(cameras: list[Camera], factor: int):
    """Also from maps of a lower resolution, which the encoder makes."""
    tensors = CameraTensors.of(cameras)
    columns = (torch.arange(640 // factor).float() + 0.5) * factor - 0.5
    maps = columns.expand(len(cameras), 1, 360 // factor, -1)
    pixels = torch.tensor([[10.0, 20.0], [319.5, 100.0], [600.0, 350.0], [77.25, 5.0]])
    seen_at = []
    for camera in cameras:
        points = torch.from_numpy(camera.unproject(pixels.numpy(), np.full(4, 0.5))).float()
        seen_at.append(points)
    for view, points in enumerate(seen_at):
        projected, seen = tensors.project(points)
        assert seen[view].all()
        torch.testing.assert_close(projected[view], pixels, atol=1e-2, rtol=0)
        read = sample_images(maps, projected, tensors.size)
        torch.testing.assert_close(read[view, 0], pixels[:, 0], atol=1e-2, rtol=0)


def test_tensors_project_as_the_camera_does(cameras: list[Camera], workspace: Workspace):
    points = workspace.voxel_centres()[::7, ::7, ::7].reshape(-1, 3)
    pixels, _ = CameraTensors.of(cameras).project(torch.from_numpy(points).float())
    for view, camera in enumerate(cameras):
        np.testing.assert_allclose(pixels[view].numpy(), camera.project(points)[0], atol=5e-3)


def test_what_falls_into_padding_or_behind_the_camera_is_not_seen(cameras: list[Camera]):
    crop = cameras[0].cropped_and_resized((-320.5, -0.5, 319.5, 359.5), 640, 360)
    tensors = CameraTensors.of([crop])
    pixels = np.array([[319.0, 100.0], [321.0, 100.0]])
    points = crop.unproject(pixels, np.array([0.5, 0.5]))
    behind = crop.unproject(pixels[1:], np.array([-0.5]))
    _, seen = tensors.project(torch.from_numpy(np.concatenate([points, behind])).float())
    assert seen[0].tolist() == [False, True, False]


def test_rays_pass_through_their_pixels(cameras: list[Camera]):
    tensors = CameraTensors.of(cameras)
    pixels = torch.tensor([[0.0, 0.0], [639.0, 359.0], [100.5, 200.25]])
    origins, directions = tensors.rays(2, pixels)
    torch.testing.assert_close(directions.norm(dim=1), torch.ones(3))
    projected, _ = tensors.project(origins + 0.4 * directions)
    torch.testing.assert_close(projected[2], pixels, atol=1e-2, rtol=0)


def test_a_linear_volume_is_read_back_exactly_anywhere_between_the_voxel_centres(workspace: Workspace):
    slope = np.array([1.0, -2.0, 3.0])
    volume = torch.from_numpy(workspace.voxel_centres() @ slope).float().unsqueeze(0)
    half = workspace.voxel_size / 2
    points = np.random.default_rng(0).uniform(half, workspace.size - half, size=(500, 3))
    read = sample_volume(volume, workspace.to_unit(torch.from_numpy(points).float()))
    np.testing.assert_allclose(read[0].numpy(), points @ slope, atol=1e-5)


def test_beyond_the_outermost_voxel_centres_the_border_is_repeated(workspace: Workspace):
    volume = torch.rand(2, 40, 40, 40, generator=torch.Generator().manual_seed(0))
    read = sample_volume(volume, torch.tensor([[-1.0, -1.0, -1.0], [5.0, 5.0, 5.0]]))
    torch.testing.assert_close(read[:, 0], volume[:, 0, 0, 0])
    torch.testing.assert_close(read[:, 1], volume[:, -1, -1, -1])


def test_tables_are_read_as_images_are_and_so_are_their_gradients(cameras: list[Camera]):
    torch.manual_seed(0)
    tensors = CameraTensors.of(cameras)
    maps = torch.randn(len(cameras), 3, 9, 16, requires_grad=True)
    pixels = torch.rand(len(cameras), 50, 2) * 700 - 20
    read = tensors.interpolation(pixels, maps.shape).read(LookupTable.of_maps(maps))
    expected = sample_images(maps, pixels, tensors.size).transpose(1, 2)
    torch.testing.assert_close(read, expected, atol=1e-4, rtol=1e-4)
    pull = torch.randn_like(read)
    ours, theirs = (torch.autograd.grad((one * pull).sum(), maps)[0] for one in (read, expected))
    torch.testing.assert_close(ours, theirs, atol=1e-3, rtol=1e-3)


def test_tables_are_read_as_volumes_are():
    volume = torch.rand(2, 6, 6, 6, generator=torch.Generator().manual_seed(0))
    unit = torch.rand(40, 3, generator=torch.Generator().manual_seed(1)) * 2.4 - 1.2
    read = volume_interpolation(unit, 6).read(LookupTable.of(volume.flatten(1).T.contiguous()))
    torch.testing.assert_close(read.T, sample_volume(volume, unit))


def test_autocast_leaves_geometry_alone(cameras: list[Camera], workspace: Workspace):
    tensors = CameraTensors.of(cameras)
    points = torch.from_numpy(workspace.voxel_centres()[::9, ::9, ::9].reshape(-1, 3)).float()
    exact = tensors.project(points)[0]
    with torch.autocast("cpu", torch.bfloat16):
        torch.testing.assert_close(tensors.project(points)[0], exact)
        assert tensors.rays(0, exact[0])[1].dtype == torch.float32
