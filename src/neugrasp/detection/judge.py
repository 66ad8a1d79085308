"""Grasps found by drawing candidates from a surface and asking an evaluator which of them hold."""

from __future__ import annotations

import zlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Float32

from neugrasp.detection.candidates import Candidates
from neugrasp.detection.decode import Selection
from neugrasp.detection.options import DetectorOptions
from neugrasp.detection.registry import weights_facts
from neugrasp.errors import InputError
from neugrasp.geometry.fusion import Grid
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper
from neugrasp.model.evaluator_file import find_evaluator, load_evaluator
from neugrasp.model.grasp_evaluator import FineGrid, GraspEvaluator, Hand, boxes, numbers

OPENING_DEPTHS = (-0.012, -0.004, 0.004)
"""Metres along the approach from the TCP at which it is looked how wide something is: where the pads are."""
OPENING_POINTS = 33
"""Places along the closing direction at each of them."""


@dataclass(frozen=True)
class JudgeConfig:
    """How the judge seeks."""

    threshold: float = 0.7
    """Probability below which nothing is a grasp."""
    margin: float = 0.04
    """By how much less sure than the best one a grasp may be that is carried out."""
    draws: int = 1000
    """Candidates that are drawn from the surface."""
    refined: int = 40
    """The best of so many places are tried a little beside themselves."""
    each: int = 8
    """Places beside, in each of `rounds` rounds."""
    rounds: int = 2
    apart: float = 0.02
    """Metres between the TCPs of two grasps that are told."""
    most: int = 24
    """Grasps that are told."""


class Judge:
    """Candidates of a gripper and the network that judges them."""

    def __init__(self, network: GraspEvaluator, gripper: Gripper, config: JudgeConfig | None = None):
        self.network = network.eval()
        self.gripper, self.hand = gripper, Hand.of(gripper)
        self.config = config or JudgeConfig()
        self.candidates = Candidates(gripper)

    @classmethod
    def load(
        cls, name: str | Path, gripper: str | Path, workspace: Workspace, threshold: float | None = None
    ) -> Judge:
        """From a shipped evaluator by name, or a file; without a `threshold`, the one noted there.

        Raises `InputError` where it reads another cube, or the gripper cannot be read.
        """
        found = load_evaluator(name)
        if found.workspace.cube != workspace.cube:
            raise InputError(
                f"the evaluator {name} reads {found.workspace.describe()}, not {workspace.describe()}"
            )
        noted = found.about.get("threshold", JudgeConfig.threshold)
        config = JudgeConfig(threshold=float(noted if threshold is None else threshold))
        return cls(found.model(), Gripper.load(gripper), config)

    def find(
        self, tsdf: Grid, workspace: Workspace, others: Float[np.ndarray, "n 4 4"] | None = None
    ) -> Selection:
        """Grasps in the workspace frame, best first; the same grid gives the same. `others` are poses to
        be judged besides, such as the peaks of the grasp head."""
        config, rng = self.config, np.random.default_rng(zlib.crc32(np.ascontiguousarray(tsdf).tobytes()))
        fine = FineGrid.of(torch.from_numpy(np.asarray(tsdf, np.float32)), workspace)
        poses = self.candidates.draw(tsdf, workspace, rng, config.draws)
        if others is not None:
            poses = np.concatenate([poses, others])
        said = self.probabilities(fine, workspace, poses)
        for _ in range(config.rounds if len(poses) else 0):
            best = apart(poses, said, config.apart, config.refined)
            near = self.candidates.around(poses[best], rng, config.each)
            near = near[self.candidates.comes_through(tsdf, workspace, near)]
            poses = np.concatenate([poses, near])
            said = np.concatenate([said, self.probabilities(fine, workspace, near)])
        places = apart(poses, said, config.apart, 2 * config.most)
        said = self.probabilities(fine, workspace, poses[places], symmetric=True)
        good = np.count_nonzero(said >= config.threshold)
        order = np.argsort(-said, kind="stable")[:good][: config.most]
        chosen = poses[places][order]
        widths = self.widths(tsdf, workspace, chosen)
        told = zip(chosen[widths > 0], widths[widths > 0], said[order][widths > 0], strict=True)
        rejected = {
            "not_the_best_nearby": len(poses) - len(places),
            "quality_below_threshold": len(places) - len(order),
            "nothing_between_the_fingers": int(np.count_nonzero(widths == 0)),
        }
        grasps = tuple(Grasp(pose, float(width), float(score)) for pose, width, score in told)
        return Selection(grasps, rejected, float(said.max(initial=0.0)), config.margin)

    @torch.no_grad()
    def probabilities(
        self,
        fine: FineGrid,
        workspace: Workspace,
        poses: Float[np.ndarray, "k 4 4"],
        symmetric: bool = False,
    ) -> Float32[np.ndarray, " k"]:
        """What the network says of TCP poses; `symmetric` is the mean over mirror images."""
        told = torch.from_numpy(poses.astype(np.float32))
        ask = self.network.symmetric if symmetric else self.network
        said: np.ndarray = (
            ask(boxes(fine, told), numbers(told, workspace), self.hand).sigmoid().numpy()
            if len(poses)
            else np.zeros(0, np.float32)
        )
        return said

    def widths(
        self, tsdf: Grid, workspace: Workspace, poses: Float[np.ndarray, "k 4 4"]
    ) -> Float[np.ndarray, " k"]:
        """How wide, metres, what lies between the pads is: from before the first place inside to after
        the last; 0 where nothing lies there."""
        half = self.gripper.max_opening / 2
        y = np.linspace(-half, half, OPENING_POINTS)
        lines = np.stack([np.stack([0 * y, y, 0 * y + z], axis=-1) for z in OPENING_DEPTHS])
        places = np.einsum("kij,dpj->kdpi", poses[:, :3, :3], lines) + poses[:, None, None, :3, 3]
        index = np.clip(workspace.index_of(places), 0, workspace.resolution - 1)
        inside = np.any(tsdf[index[..., 0], index[..., 1], index[..., 2]] < 0, axis=1)
        first, last = inside.argmax(axis=1), len(y) - 1 - inside[:, ::-1].argmax(axis=1)
        found: np.ndarray = np.where(inside.any(axis=1), y[last] - y[first] + y[1] - y[0], 0.0)
        return found


def judge_facts(options: DetectorOptions, workspace: Workspace) -> dict[str, Any]:
    """Name, hash and settings of the evaluator that options name."""
    path = find_evaluator(options.evaluator)
    facts = weights_facts(path, 0.0)
    judge = asdict(Judge.load(path, options.gripper, workspace, options.threshold).config)
    told = {"evaluator": facts["weights"], "evaluator_sha256": facts["weights_sha256"]}
    return {**told, "judge": judge, "threshold": judge["threshold"]}


def apart(
    poses: Float[np.ndarray, "k 4 4"], said: Float[np.ndarray, " k"], distance: float, most: int
) -> list[int]:
    """Numbers of at most so many poses, best first, no two TCPs nearer than `distance` metres.

    Those that were given 0 are left out.
    """
    kept: list[int] = []
    left = np.where(said > 0, said, -np.inf)
    while len(kept) < most and len(left) and np.isfinite(left[best := int(left.argmax())]):
        kept.append(best)
        left[np.linalg.norm(poses[:, :3, 3] - poses[best, :3, 3], axis=1) < distance] = -np.inf
        left[best] = -np.inf
    return kept
