"""Features and volumes -> signed distance and colour at any point."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from neugrasp.geometry.sampling import CameraTensors, sample_images, sample_volume
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.attention import RayTransformer, ViewTransformer
from neugrasp.model.config import ModelConfig

ORDER_DIM = 8
POSITION_FREQUENCIES = (1.0, 2.0, 4.0)


@dataclass(frozen=True)
class EncodedViews:
    """A scene as the field reads it."""

    images: Tensor
    """(n, 3, s, s) RGB, for the colours."""
    maps: Tensor
    """(n, c, h, w): scene features, then foreground features where the model has them."""
    volumes: tuple[Tensor, ...]
    """Shape prior (c, r, r, r), then the occupancy prior where the model has one."""
    cameras: CameraTensors
    workspace: Workspace


@dataclass(frozen=True)
class FieldSamples:
    """The field at points along rays."""

    sdf: Tensor
    """(r, s) signed distance in truncation units, not clipped; + outside."""
    colour: Tensor | None
    """(r, s, 3) in [0, 1], blended from the views; None where it was not asked for."""
    num_seen: Tensor
    """(r, s) how many views see the point."""


def order_encoding(num: int, like: Tensor) -> Tensor:
    """Sinusoids (num, 8) of the place of a sample on its ray: from half a wave per ray down to a sixteenth.

    The usual base of 10000 has six waves in 40 samples, and the field followed them: floating slabs with the
    slope that Eikonal asks for and the opacity that carving asks for (docs/training_log.md).
    """
    place = torch.arange(num, device=like.device, dtype=like.dtype).unsqueeze(1) / num
    rate = torch.pi / 2 ** torch.arange(ORDER_DIM // 2, device=like.device, dtype=like.dtype)
    return torch.cat([torch.sin(place * rate), torch.cos(place * rate)], dim=1)


def position_encoding(points: Tensor) -> Tensor:
    """Points (p, 3) in metres and the sines and cosines of 1, 2 and 4 times them: (p, 21)."""
    waves = [f(k * points) for k in POSITION_FREQUENCIES for f in (torch.sin, torch.cos)]
    return torch.cat([points, *waves], dim=1)


def table_distance(heights: Tensor, workspace: Workspace) -> Tensor:
    """The truncated distance to the empty table at heights above the workspace's floor, in [-1, 1].

    The network predicts what to add to it: it starts from an empty table instead of from nothing.
    """
    return ((heights - workspace.table_height) / workspace.truncation).clamp(-1, 1)


class SdfField(nn.Module):
    """Signed distance (Eqs. 5, 6, 8, 9) and blended colour."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        self.config = config
        dims = config.token_dims
        self.view_transformers = nn.ModuleList([ViewTransformer(dim, config.heads) for dim in dims])
        fused = config.fused_dim
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
        self.ray_transformer = RayTransformer(fused + ORDER_DIM, config.heads)
        self.decoder = nn.Sequential(
            nn.Linear(fused + ORDER_DIM, 32), nn.ReLU(), nn.Linear(32, 16), nn.ReLU(), nn.Linear(16, 1)
        )
        widths = (sum(dims) + 4, 64, 32, 16, 8)
        hidden = [(nn.Linear(a, b), nn.ReLU()) for a, b in itertools.pairwise(widths)]
        self.blending = nn.Sequential(*itertools.chain(*hidden), nn.Linear(widths[-1], 1))

    def forward(self, scene: EncodedViews, points: Tensor, eye: Tensor | None = None) -> FieldSamples:
        """The field at points (r, s, 3): r sequences ("rays") of s samples, ordered along the ray.

        With `eye`, the centre (3,) of the camera that looks along the rays, colours come too.
        """
        rays, samples, _ = points.shape
        flat = points.reshape(-1, 3)
        pixels, seen = scene.cameras.project(flat)
        maps = sample_images(scene.maps, pixels, scene.cameras.size) * seen.unsqueeze(1)
        volumes = [sample_volume(volume, scene.workspace.to_unit(flat)) for volume in scene.volumes]
        num_seen = seen.sum(0).reshape(rays, samples)
        unified, views = self._attend(maps, volumes, need_views=eye is not None)
        sdf = self._decode(unified, points, num_seen, scene.workspace)
        if eye is None or views is None:
            return FieldSamples(sdf, None, num_seen)
        colour = self._blend(scene, views, flat, pixels, seen, eye)
        return FieldSamples(sdf, colour.reshape(rays, samples, 3), num_seen)

    def on_grid(self, scene: EncodedViews, maps: Tensor, seen: Tensor) -> Tensor:
        """Signed distance (r, r, r) at the voxel centres, from `maps` (n, c, r^3) sampled there.

        Every column is a ray seen from straight above, so samples run from the top down.
        """
        resolution = scene.workspace.resolution
        volumes = [volume.flatten(1) for volume in scene.volumes]
        unified, _ = self._attend(maps * seen.unsqueeze(1), volumes, need_views=False)
        centres = torch.from_numpy(scene.workspace.voxel_centres()).to(maps)
        columns = centres.reshape(resolution**2, resolution, 3).flip(1)
        unified = unified.reshape(-1, resolution**2, resolution).flip(2).flatten(1)
        num_seen = seen.sum(0).reshape(resolution**2, resolution).flip(1)
        sdf = self._decode(unified, columns, num_seen, scene.workspace)
        return sdf.flip(1).reshape(resolution, resolution, resolution)

    def _attend(self, maps: Tensor, volumes: list[Tensor], need_views: bool) -> tuple[Tensor, Tensor | None]:
        """Unified features (sum of dims, p) and, if needed, view features (n, sum of dims, p)."""
        branches = maps.split(self.config.feature_dim, dim=1)
        unified, views = [], []
        for index, (transformer, branch) in enumerate(zip(self.view_transformers, branches, strict=True)):
            tokens = branch
            if index < len(volumes):
                shared = volumes[index].unsqueeze(0).expand(len(branch), -1, -1)
                tokens = torch.cat([branch, shared], dim=1)
            point, per_view = transformer(tokens, need_views)
            unified.append(point)
            views.append(per_view)
        return torch.cat(unified), torch.cat(views, dim=1) if need_views else None

    def _decode(self, unified: Tensor, points: Tensor, num_seen: Tensor, workspace: Workspace) -> Tensor:
        rays, samples, _ = points.shape
        about_centre = points.reshape(-1, 3) - torch.from_numpy(workspace.centre).to(points)
        x = self.fusion(unified.T)
        x = self.position(torch.cat([x, position_encoding(about_centre)], dim=1))
        x = x.reshape(rays, samples, -1)
        order = order_encoding(samples, x).expand(rays, -1, -1)
        x = self.ray_transformer(torch.cat([x, order], dim=-1), asks=num_seen > 1)
        sdf = self.decoder(x).squeeze(-1) + table_distance(points[..., 2], workspace)
        return torch.where(num_seen > 0, sdf, torch.ones_like(sdf))

    def _blend(
        self, scene: EncodedViews, views: Tensor, flat: Tensor, pixels: Tensor, seen: Tensor, eye: Tensor
    ) -> Tensor:
        """Colours (p, 3): a softmax over the views that see the point."""
        towards_views = F.normalize(scene.cameras.centres.unsqueeze(1) - flat, dim=-1)
        towards_eye = F.normalize(eye - flat, dim=-1)
        difference = towards_views - towards_eye
        cosine = (towards_views * towards_eye).sum(-1, keepdim=True)
        x = torch.cat([views.transpose(1, 2), difference, cosine], dim=-1)
        logits = self.blending(x).squeeze(-1).masked_fill(~seen, -1e9)
        weights = torch.softmax(logits, dim=0).unsqueeze(1)
        return (weights * sample_images(scene.images, pixels, scene.cameras.size)).sum(0).T
