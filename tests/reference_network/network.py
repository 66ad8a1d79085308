"""The whole network as one would first write it, at the weights of a `NeuGrasp`.

Float32 throughout, backgrounds encoded every time, every token of every point attended to, maps read again
for each use. Shared with the product, because there is only one way to write them: the features of the
change, reading volumes (PyTorch's own `grid_sample`), placing samples on rays and adding up what
they weigh.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from neugrasp.geometry.sampling import sample_volume
from neugrasp.model.config import ModelConfig
from neugrasp.model.features import ImageDifference
from neugrasp.model.grasp_head import GraspVolume
from neugrasp.model.inputs import ViewTensors
from neugrasp.model.network import GRID_SAMPLES, NeuGrasp
from neugrasp.model.rendering import (
    Rays,
    Rendered,
    composite,
    importance_samples,
    ray_weights,
    stratified_samples,
)
from reference_network.features import PlainFeatures, PlainResidual
from reference_network.field import PlainField, PlainScene
from reference_network.images import sample_images
from reference_network.volumes import PlainVolumes

NAMES = ((".expand.", ".mlp.0."), (".contract.", ".mlp.2."))
"""Layers that have another name in the product's view transformers."""


@dataclass(frozen=True)
class PlainReconstruction:
    """A scene, its signed distance on the grid (r, r, r), not clipped, and which voxels any view sees."""

    scene: PlainScene
    sdf: Tensor
    seen: Tensor


class PlainHead(nn.Module):
    """VGN's convolutional network: grids (b, r, r, r) to grasps at every voxel."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        a, b, c = config.head_channels
        layers = [(1, a, 5, 2), (a, b, 3, 2), (b, c, 3, 2)]
        self.encoder = nn.ModuleList(nn.Conv3d(i, o, k, s, k // 2) for i, o, k, s in layers)
        layers = [(c, c, 3, 1), (c, b, 3, 1), (b, a, 5, 1)]
        self.decoder = nn.ModuleList(nn.Conv3d(i, o, k, s, k // 2) for i, o, k, s in layers)
        self.quality = nn.Conv3d(a, 1, 5, 1, 2)
        self.rotation = nn.Conv3d(a, 4, 5, 1, 2)
        self.width = nn.Conv3d(a, 1, 5, 1, 2)

    def forward(self, tsdf: Tensor) -> GraspVolume:
        resolution = tsdf.shape[-1]
        x = tsdf.unsqueeze(1)
        for convolution in self.encoder:
            x = F.relu(convolution(x))
        for convolution, size in zip(
            self.decoder, (resolution // 4, resolution // 2, resolution), strict=True
        ):
            x = F.interpolate(F.relu(convolution(x)), size=size, mode="nearest")
        logits = self.quality(x).squeeze(1)
        rotation = F.normalize(self.rotation(x), dim=1)
        return GraspVolume(torch.sigmoid(logits), rotation, self.width(x).squeeze(1), logits)


class ReferenceNetwork(nn.Module):
    """The mathematics of `NeuGrasp`, without its economies."""

    def __init__(self, model: NeuGrasp):
        super().__init__()
        config = model.config
        self.config, self.workspace = config, model.workspace
        self.features = PlainFeatures(config)
        uses_attention = config.use_backgrounds and config.use_residual_attention
        self.residual = PlainResidual(config.feature_dim) if uses_attention else None
        uses_change = config.use_backgrounds and config.use_change
        self.change = ImageDifference(config.feature_dim) if uses_change else None
        self.volumes = PlainVolumes(config)
        self.field = PlainField(config)
        self.head = PlainHead(config)
        if config.learned_sharpness:
            self.log_sharpness = nn.Parameter(torch.zeros(()))
        self.load_state_dict({renamed(name): tensor for name, tensor in model.state_dict().items()})
        self.to(next(model.parameters()).device).train(model.training)

    def encode(self, images: Tensor) -> Tensor:
        """Feature maps (n, d, s / 4, s / 4) of images (n, 3, s, s)."""
        maps: Tensor = self.features(images)
        return maps

    def encode_backgrounds(self, views: ViewTensors) -> Tensor | None:
        """Feature maps of the backgrounds, if the network looks at them."""
        return self.encode(views.backgrounds) if self.config.use_backgrounds else None

    def reconstruct(
        self, scene: Tensor, background: Tensor | None, views: ViewTensors
    ) -> PlainReconstruction:
        """The field and its values on the grid."""
        centres = torch.from_numpy(self.workspace.voxel_centres()).to(scene).reshape(-1, 3)
        pixels, seen = views.cameras.project(centres)
        volumes = [self._volume(scene, pixels, seen, views)]
        maps = scene
        if background is not None:
            change = 0 if self.change is None else self.change(views.images, views.backgrounds)
            attended = scene if self.residual is None else self.residual(scene, background) + change
            maps = torch.cat([scene, attended], dim=1)
            if self.config.use_occupancy_prior:
                volumes.append(self._volume(scene - background + change, pixels, seen, views))
        encoded = PlainScene(views.images, maps, tuple(volumes), views.cameras, self.workspace)
        sdf = self.field.on_grid(encoded)
        return PlainReconstruction(encoded, sdf, seen.any(0).reshape(sdf.shape))

    def render(
        self, scene: PlainScene, rays: Rays, sharpness: Tensor, generator: torch.Generator | None = None
    ) -> tuple[Rendered, Rendered]:
        """Coarse and fine renderings of rays of one camera."""
        at = stratified_samples(rays, self.config.coarse_samples, generator)
        coarse = self._render_at(scene, rays, at, sharpness)
        at = importance_samples(at, coarse.weights, self.config.fine_samples, generator)
        return coarse, self._render_at(scene, rays, at, sharpness)

    def weights_on_grid(
        self,
        seen: PlainReconstruction,
        rays: Rays,
        sharpness: Tensor,
        generator: torch.Generator | None = None,
    ) -> tuple[Tensor, Tensor]:
        """Weights (r, s - 1) of intervals on rays through the grid's distances, and their midpoints."""
        at = stratified_samples(rays, GRID_SAMPLES, generator)
        points = self.workspace.to_unit(rays.points(at).reshape(-1, 3))
        sdf = sample_volume(seen.sdf.unsqueeze(0), points).reshape(at.shape)
        return ray_weights(sdf * self.workspace.truncation, sharpness), (at[:, 1:] + at[:, :-1]) / 2

    def sharpness(self, scheduled: float) -> Tensor:
        """NeuS sharpness in 1 / metre."""
        if self.config.learned_sharpness:
            return torch.exp(10 * self.log_sharpness).clamp(1e-6, 1e6)
        return next(self.parameters()).new_tensor(scheduled)

    def _volume(self, maps: Tensor, pixels: Tensor, seen: Tensor, views: ViewTensors) -> Tensor:
        sampled = sample_images(maps, pixels, views.cameras.size).transpose(1, 2)
        volume: Tensor = self.volumes(sampled, seen.to(sampled))
        return volume

    def _render_at(self, scene: PlainScene, rays: Rays, distances: Tensor, sharpness: Tensor) -> Rendered:
        sdf, colour = self.field(scene, rays.points(distances), eye=rays.origins[0])
        return composite(sdf * self.workspace.truncation, colour, distances, sharpness)


def renamed(name: str) -> str:
    """What a parameter of `NeuGrasp` is called here."""
    if "view_transformers" in name:
        for theirs, ours in NAMES:
            name = name.replace(theirs, ours)
    return name
