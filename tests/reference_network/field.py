"""Features and volumes -> signed distance and colour at any points; voxels are points like any other."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from neugrasp.geometry.sampling import CameraTensors, sample_volume
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.config import ModelConfig
from reference_network.attention import PlainEncoderLayer, PlainViewTransformer
from reference_network.images import sample_images

ORDER_DIM = 8


@dataclass(frozen=True)
class PlainScene:
    """What the field reads."""

    images: Tensor
    """(n, 3, s, s) RGB."""
    maps: Tensor
    """(n, c, h, w): scene features, then foreground features where the network has them."""
    volumes: tuple[Tensor, ...]
    """Shape prior (c, r, r, r), then the occupancy prior where the network has one."""
    cameras: CameraTensors
    workspace: Workspace


class PlainField(nn.Module):
    """Signed distance (Eqs. 5, 6, 8, 9) and blended colour."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        self.config = config
        dims, fused = config.token_dims, config.fused_dim
        self.view_transformers = nn.ModuleList(PlainViewTransformer(dim, config.heads) for dim in dims)
        self.fusion = nn.Sequential(
            nn.Linear(sum(dims), config.fusion_hidden),
            nn.ReLU(),
            nn.Linear(config.fusion_hidden, fused),
            nn.ReLU(),
        )
        self.position = nn.Sequential(
            nn.Linear(fused + 21, fused + ORDER_DIM),
            nn.ReLU(),
            nn.Linear(fused + ORDER_DIM, fused),
            nn.ReLU(),
        )
        self.ray_transformer = PlainEncoderLayer(fused + ORDER_DIM, config.heads)
        self.decoder = nn.Sequential(
            nn.Linear(fused + ORDER_DIM, 32), nn.ReLU(), nn.Linear(32, 16), nn.ReLU(), nn.Linear(16, 1)
        )
        widths = (sum(dims) + 4, 64, 32, 16, 8)
        hidden = [(nn.Linear(a, b), nn.ReLU()) for a, b in itertools.pairwise(widths)]
        self.blending = nn.Sequential(*itertools.chain(*hidden), nn.Linear(widths[-1], 1))

    def forward(
        self, scene: PlainScene, points: Tensor, eye: Tensor | None = None
    ) -> tuple[Tensor, Tensor | None]:
        """Signed distance (r, s) at points (r, s, 3) of r rays; with `eye` (3,), colours (r, s, 3) too."""
        rays, samples, _ = points.shape
        flat = points.reshape(-1, 3)
        pixels, seen = scene.cameras.project(flat)
        maps = sample_images(scene.maps, pixels, scene.cameras.size).permute(2, 0, 1) * seen.T.unsqueeze(-1)
        volumes = [sample_volume(volume, scene.workspace.to_unit(flat)).T for volume in scene.volumes]
        attended = self._attend(maps, volumes)
        num_seen = seen.sum(0).reshape(rays, samples)
        sdf = self._decode(attended[:, 0], points, num_seen, scene)
        if eye is None:
            return sdf, None
        colour = self._blend(scene, attended[:, 1:], flat, pixels, seen, eye)
        return sdf, colour.reshape(rays, samples, 3)

    def on_grid(self, scene: PlainScene) -> Tensor:
        """Signed distance (r, r, r) at the voxel centres, every column a ray from the top down."""
        resolution = scene.workspace.resolution
        centres = torch.from_numpy(scene.workspace.voxel_centres()).to(scene.maps)
        columns = centres.reshape(resolution**2, resolution, 3).flip(1)
        sdf, _ = self(scene, columns)
        grid: Tensor = sdf.flip(1).reshape(resolution, resolution, resolution)
        return grid

    def _attend(self, maps: Tensor, volumes: list[Tensor]) -> Tensor:
        """Unified feature and view features (p, 1 + n, sum of dims) of maps (p, n, c), volumes (p, c)."""
        attended = []
        branches = maps.split(self.config.feature_dim, dim=-1)
        for index, (transformer, branch) in enumerate(zip(self.view_transformers, branches, strict=True)):
            tokens = branch
            if index < len(volumes):
                shared = volumes[index].unsqueeze(1).expand(-1, branch.shape[1], -1)
                tokens = torch.cat([branch, shared], dim=-1)
            attended.append(transformer(tokens))
        return torch.cat(attended, dim=-1)

    def _decode(self, unified: Tensor, points: Tensor, num_seen: Tensor, scene: PlainScene) -> Tensor:
        rays, samples, _ = points.shape
        workspace = scene.workspace
        place = points.reshape(-1, 3) - torch.from_numpy(workspace.centre).to(points)
        waves = [f(k * place) for k in (1.0, 2.0, 4.0) for f in (torch.sin, torch.cos)]
        x = self.position(torch.cat([self.fusion(unified), place, *waves], dim=-1)).reshape(rays, samples, -1)
        order = torch.arange(samples).to(x).unsqueeze(1) / samples
        rates = torch.pi / 2 ** torch.arange(ORDER_DIM // 2).to(x)
        order = torch.cat([torch.sin(order * rates), torch.cos(order * rates)], dim=1).expand(rays, -1, -1)
        x = self.ray_transformer(torch.cat([x, order], dim=-1), asks=num_seen > 1)
        table = ((points[..., 2] - workspace.table_height) / workspace.truncation).clamp(-1, 1)
        sdf = self.decoder(x).squeeze(-1) + table
        return torch.where(num_seen > 0, sdf, torch.ones_like(sdf))

    def _blend(
        self, scene: PlainScene, views: Tensor, flat: Tensor, pixels: Tensor, seen: Tensor, eye: Tensor
    ) -> Tensor:
        """Colours (p, 3) from view features (p, n, d): a softmax over the views that see the point."""
        towards_views = F.normalize(scene.cameras.centres - flat.unsqueeze(1), dim=-1)
        towards_eye = F.normalize(eye - flat, dim=-1).unsqueeze(1)
        cosine = (towards_views * towards_eye).sum(-1, keepdim=True)
        x = torch.cat([views, towards_views - towards_eye, cosine], dim=-1)
        weights = torch.softmax(self.blending(x).masked_fill(~seen.T.unsqueeze(-1), -1e9), dim=1)
        colours = sample_images(scene.images, pixels, scene.cameras.size).permute(2, 0, 1)
        return (weights * colours).sum(1)
