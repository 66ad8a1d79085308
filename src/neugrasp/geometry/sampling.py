"""Reading images and volumes at continuous places, for every view at once: the only `grid_sample` here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import inverse


@dataclass(frozen=True)
class CameraTensors:
    """Cameras of n equally large images as float32 tensors, in the workspace frame."""

    intrinsics: Tensor
    """(n, 3, 3), pixels."""
    camera_from_workspace: Tensor
    """(n, 4, 4)."""
    centres: Tensor
    """(n, 3) optical centres, metres."""
    bounds: Tensor
    """(n, 4): left, top, right, bottom edges of the measured pixels."""
    size: tuple[int, int]
    """Width and height of the images."""

    @classmethod
    def of(cls, cameras: tuple[Camera, ...] | list[Camera]) -> CameraTensors:
        """From cameras already expressed in the workspace frame; raises ValueError on unequal sizes."""
        sizes = {(camera.width, camera.height) for camera in cameras}
        if len(sizes) != 1:
            raise ValueError(f"cameras of one batch must have one image size, got {sorted(sizes)}")

        def stack(arrays: list[np.ndarray]) -> Tensor:
            return torch.from_numpy(np.stack(arrays)).float()

        return cls(
            stack([camera.intrinsics for camera in cameras]),
            stack([inverse(camera.world_from_camera) for camera in cameras]),
            stack([camera.centre for camera in cameras]),
            stack([np.array(camera.bounds) for camera in cameras]),
            sizes.pop(),
        )

    def to(self, device: torch.device | str) -> CameraTensors:
        """The same cameras on another device."""
        return CameraTensors(
            self.intrinsics.to(device),
            self.camera_from_workspace.to(device),
            self.centres.to(device),
            self.bounds.to(device),
            self.size,
        )

    def select(self, views: list[int]) -> CameraTensors:
        """Some of the cameras, in the given order."""
        return CameraTensors(
            self.intrinsics[views],
            self.camera_from_workspace[views],
            self.centres[views],
            self.bounds[views],
            self.size,
        )

    def project(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Pixels (n, p, 2) of workspace points (p, 3), and whether each was seen (n, p)."""
        rotation, translation = self.camera_from_workspace[:, :3, :3], self.camera_from_workspace[:, :3, 3:]
        projection = self.intrinsics @ rotation
        homogeneous = projection @ points.T + self.intrinsics @ translation
        depth = homogeneous[:, 2]
        pixels = homogeneous[:, :2] / depth.clamp(min=1e-6).unsqueeze(1)
        u, v = pixels[:, 0], pixels[:, 1]
        left, top, right, bottom = (edge.unsqueeze(1) for edge in self.bounds.unbind(1))
        seen = (depth > 1e-3) & (u >= left) & (u < right) & (v >= top) & (v < bottom)
        return pixels.transpose(1, 2), seen

    def rays(self, view: int, pixels: Tensor) -> tuple[Tensor, Tensor]:
        """Origins (p, 3) and unit directions (p, 3) of the rays through pixels (p, 2) of one view."""
        ones = torch.ones_like(pixels[:, :1])
        in_camera = torch.cat([pixels, ones], dim=1) @ torch.linalg.inv(self.intrinsics[view]).T
        directions = in_camera @ self.camera_from_workspace[view, :3, :3]
        directions = directions / directions.norm(dim=1, keepdim=True)
        return self.centres[view].expand_as(directions), directions


def sample_images(maps: Tensor, pixels: Tensor, size: tuple[int, int]) -> Tensor:
    """Bilinear values (n, c, p) of maps (n, c, h, w) at image pixels (n, p, 2).

    A map of any resolution spans the same area as the image of `size` (width, height); pixels are those of
    the image, centres at integers. Outside, the border is repeated.
    """
    extent = pixels.new_tensor(size)
    unit = (2 * pixels + 1) / extent - 1
    return F.grid_sample(
        maps, unit.unsqueeze(1), mode="bilinear", padding_mode="border", align_corners=False
    ).squeeze(2)


def sample_volume(volume: Tensor, unit: Tensor) -> Tensor:
    """Trilinear values (c, p) of a volume (c, x, y, z) at points (p, 3) of the [-1, 1] cube.

    Voxel i of r has its centre at (2 i + 1) / r - 1 (see `Workspace.to_unit`); the border is repeated.
    """
    # grid_sample wants the coordinate of the last axis first.
    grid = unit.flip(-1).reshape(1, 1, 1, -1, 3)
    values = F.grid_sample(
        volume.unsqueeze(0), grid, mode="bilinear", padding_mode="border", align_corners=False
    )
    return values.reshape(volume.shape[0], -1)
