"""The whole network: photos -> features -> volumes -> signed distance -> TSDF -> grasps."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from einops import rearrange
from torch import Tensor, nn

from neugrasp.geometry.sampling import sample_volume
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.config import ModelConfig
from neugrasp.model.features import ChangeFeatures, FeatureNet, ResidualAttention
from neugrasp.model.grasp_head import GraspHead, GraspVolume
from neugrasp.model.inputs import ViewTensors
from neugrasp.model.rendering import Rays, Rendered, composite, concentrate, ray_weights, spread
from neugrasp.model.sdf import EncodedViews, FieldSamples, SdfField
from neugrasp.model.volumes import VolumeNet

GRID_SAMPLES = 64
"""Samples on a ray through the grid: about one for every voxel that it meets."""


Maps = tuple[Tensor, ...]


@dataclass(frozen=True)
class Reconstruction:
    """A scene, its signed distance on the grid, and where it was seen."""

    scene: EncodedViews
    sdf: Tensor
    """(r, r, r), truncation units, not clipped."""
    seen: Tensor
    """(r, r, r) bool: whether any view sees the voxel."""

    @property
    def tsdf(self) -> Tensor:
        """The truncated signed distance, in [-1, 1]."""
        return self.sdf.clamp(-1, 1)


class NeuGrasp(nn.Module):
    """The network of the paper; `config` switches its ablations."""

    def __init__(self, config: ModelConfig, workspace: Workspace | None = None):
        super().__init__()
        self.config = config
        self.workspace = workspace or Workspace()
        self.features = FeatureNet(config)
        uses_attention = config.use_backgrounds and config.use_residual_attention
        self.residual = ResidualAttention(config.feature_dim) if uses_attention else None
        uses_change = config.use_backgrounds and config.use_change
        self.change = ChangeFeatures(config.feature_dim) if uses_change else None
        self.volumes = VolumeNet(config)
        self.field = SdfField(config)
        self.head = GraspHead(config)
        if config.learned_sharpness:
            # exp(10 v) = 100 per metre at the start (method.md J2).
            self.log_sharpness = nn.Parameter(torch.tensor(0.46))

    def forward(self, views: ViewTensors) -> tuple[Reconstruction, GraspVolume]:
        """Surface and grasps from photos."""
        reconstruction = self.reconstruct(self.encode(views.images), self.encode_backgrounds(views), views)
        return reconstruction, self.head(reconstruction.tsdf.unsqueeze(0))

    def encode(self, images: Tensor) -> Tensor:
        """Feature maps (n, d, s / 4, s / 4) of images (n, 3, s, s)."""
        maps: Tensor = self.features(images)
        return maps.float()

    def encode_backgrounds(self, views: ViewTensors) -> Tensor | None:
        """Feature maps of the backgrounds, which may be kept for as long as the cell stays as it is."""
        return self.encode(views.backgrounds) if self.config.use_backgrounds else None

    def reconstruct(self, scene: Tensor, background: Tensor | None, views: ViewTensors) -> Reconstruction:
        """The field and its values on the grid, from the feature maps of photos and backgrounds."""
        maps, priors = self._field_maps(scene, background, views)
        centres = torch.from_numpy(self.workspace.voxel_centres()).to(scene)
        pixels, seen = views.cameras.project(centres.reshape(-1, 3))
        voxels = views.cameras.corners(pixels, scene.shape).where(seen)
        volumes = rearrange(self.volumes(priors, voxels, seen), "k c x y z -> x y z (k c)").float()
        encoded = EncodedViews(views.images, maps, volumes, views.cameras, self.workspace)
        sdf = self.field.on_grid(encoded, voxels, seen)
        return Reconstruction(encoded, sdf, seen.any(0).reshape(sdf.shape))

    def _field_maps(self, scene: Tensor, background: Tensor | None, views: ViewTensors) -> tuple[Maps, Maps]:
        """What the view transformers read, and what the prior volumes are made from."""
        if background is None:
            return (scene,), (scene,)
        attended = scene if self.residual is None else self.residual(scene, background).float()
        residue = scene - background
        if self.change is not None:
            change = self.change(views.images, views.backgrounds).float()
            residue = residue + change
            attended = attended if self.residual is None else attended + change
        priors = (scene, residue) if self.config.use_occupancy_prior else (scene,)
        return (scene, attended), priors

    def sharpness(self, scheduled: float) -> Tensor:
        """NeuS sharpness in 1 / metre: learned if the model learns it, else the schedule's value."""
        if self.config.learned_sharpness:
            return torch.exp(10 * self.log_sharpness).clamp(1e-6, 1e6)
        return next(self.parameters()).new_tensor(scheduled)

    def render(
        self,
        scene: EncodedViews,
        rays: Rays,
        sharpness: Tensor,
        generator: torch.Generator | None = None,
    ) -> tuple[Rendered, Rendered]:
        """Coarse and fine renderings of rays of one camera; with a generator, samples are jittered."""
        coarse_at = spread(rays, self.config.coarse_samples, generator)
        coarse = self._render_at(scene, rays, coarse_at, sharpness)
        fine_at = concentrate(coarse_at, coarse.weights, self.config.fine_samples, generator)
        return coarse, self._render_at(scene, rays, fine_at, sharpness)

    def weights_on_grid(
        self,
        reconstruction: Reconstruction,
        rays: Rays,
        sharpness: Tensor,
        generator: torch.Generator | None = None,
    ) -> tuple[Tensor, Tensor]:
        """Weights (r, s - 1) of intervals on rays through the grid's distances, and their middles."""
        distances = spread(rays, GRID_SAMPLES, generator)
        points = self.workspace.to_unit(rays.points(distances).reshape(-1, 3))
        sdf = sample_volume(reconstruction.sdf.unsqueeze(0), points).reshape(distances.shape)
        weights = ray_weights(sdf * self.workspace.truncation, sharpness)
        return weights, (distances[:, 1:] + distances[:, :-1]) / 2

    def _render_at(self, scene: EncodedViews, rays: Rays, distances: Tensor, sharpness: Tensor) -> Rendered:
        samples: FieldSamples = self.field(scene, rays.points(distances), eye=rays.origins[0])
        if samples.colour is None:
            raise AssertionError("colours were asked for")
        metres = samples.sdf * self.workspace.truncation
        return composite(metres, samples.colour, distances, sharpness)
