"""A training step as one would first write it: the same terms, rays and samples, in float32."""

from __future__ import annotations

import torch
from torch import Tensor

from neugrasp.bench.reference.network import PlainReconstruction, ReferenceNetwork
from neugrasp.geometry.sampling import CameraTensors
from neugrasp.model.rendering import Rays, cut_to_workspace
from neugrasp.training.config import TrainConfig
from neugrasp.training.losses import carving_loss, eikonal_loss, grasp_loss, photometric_loss, tsdf_loss
from neugrasp.training.samples import Photos, Sample


class ReferenceTrainer:
    """The plain network with Adam and a moving average of its weights."""

    def __init__(self, network: ReferenceNetwork, config: TrainConfig):
        self.network = network.train()
        self.config = config
        self.optimizer = torch.optim.Adam(network.parameters(), lr=config.learning_rate)
        self.average = [parameter.detach().clone() for parameter in network.parameters()]

    def loss(self, sample: Sample, generator: torch.Generator) -> Tensor:
        """The weighted sum of all terms that have a weight."""
        network, weights = self.network, self.config.weights
        views = sample.inputs.views
        maps, empty = network.encode(views.images), network.encode_backgrounds(views)
        seen = network.reconstruct(maps, empty, views)
        tsdf = seen.sdf.clamp(-1, 1)
        terms = [weights.grasp * grasp_loss(network.head(tsdf.unsqueeze(0)), [sample.truth.labels])]
        if weights.eikonal:
            terms.append(weights.eikonal * eikonal_loss(seen.sdf, seen.seen, network.workspace))
        if weights.tsdf:
            terms.append(weights.tsdf * tsdf_loss(seen.sdf, sample.truth.tsdf, sample.truth.observed))
        sharpness = network.sharpness(self.config.sharpness_at(self.config.steps))
        terms.append(self._rendered(seen, sample.targets, sharpness, generator))
        if weights.grid_carving:
            terms.append(self._carved(seen, (sample.inputs, sample.targets), sharpness, generator))
        return torch.stack(terms).sum()

    def update(self) -> None:
        """What follows the backward pass."""
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), self.config.gradient_clip)
        self.optimizer.step()
        self.optimizer.zero_grad(set_to_none=True)
        with torch.no_grad():
            for average, now in zip(self.average, self.network.parameters(), strict=True):
                average.lerp_(now, 1 - self.config.average)

    def _rendered(
        self, seen: PlainReconstruction, targets: Photos, sharpness: Tensor, generator: torch.Generator
    ) -> Tensor:
        rays, row, column = _random_rays(self.network, targets.views.cameras, 0, self.config.rays, generator)
        renderings = self.network.render(seen.scene, rays, sharpness, generator)
        colour = targets.views.images[0, :, row, column].T
        behind = targets.views.backgrounds[0, :, row, column].T
        labels = targets.changes[0, row, column]
        weights, workspace = self.config.weights, self.network.workspace
        loss = weights.photometric * sum(photometric_loss(one, colour, behind) for one in renderings)
        if weights.carving:
            carved = [carving_loss(one.weights, one.middles, rays, labels, workspace) for one in renderings]
            loss = loss + weights.carving * torch.stack(carved).mean()
        return torch.as_tensor(loss)

    def _carved(
        self,
        seen: PlainReconstruction,
        photos: tuple[Photos, ...],
        sharpness: Tensor,
        generator: torch.Generator,
    ) -> Tensor:
        network, losses = self.network, []
        for group in photos:
            for view in range(len(group.changes)):
                rays, row, column = _random_rays(
                    network, group.views.cameras, view, self.config.carving_rays, generator
                )
                weights, middles = network.weights_on_grid(seen, rays, sharpness, generator)
                labels = group.changes[view, row, column]
                losses.append(carving_loss(weights, middles, rays, labels, network.workspace))
        return self.config.weights.grid_carving * torch.stack(losses).mean()


def _random_rays(
    network: ReferenceNetwork, cameras: CameraTensors, view: int, num: int, generator: torch.Generator
) -> tuple[Rays, Tensor, Tensor]:
    """Up to `num` rays of a view through the workspace, with their rows and columns."""
    width, height = cameras.size
    pixels = torch.randint(width * height, (4 * num,), generator=generator).to(cameras.centres.device)
    row, column = pixels // width, pixels % width
    origins, directions = cameras.rays(view, torch.stack([column, row], dim=1).to(cameras.centres))
    rays = cut_to_workspace(origins, directions, network.workspace)
    chosen = torch.nonzero(rays.far > rays.near + 1e-3).squeeze(1)[:num]
    return rays.select(chosen), row[chosen], column[chosen]
