"""The detectors by name, and what each of them is allowed to see."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from neugrasp.baselines.vgn import VgnDetector, load_vgn_head
from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.detection.hand_check import HandCheck
from neugrasp.errors import InputError
from neugrasp.evaluation.commands import Evaluate
from neugrasp.evaluation.declutter import Finder
from neugrasp.evaluation.measuring_sticks import Antipodal, Oracle
from neugrasp.evaluation.protocols import protocol_of
from neugrasp.gripper import Gripper
from neugrasp.model.checkpoint import find_weights, load_checkpoint

PHOTOS, DEPTH, TRUTH = "photos", "depth", "truth"
SEES = {"neugrasp": PHOTOS, "vgn": DEPTH, "oracle": TRUTH, "antipodal": TRUTH}
"""What the camera of each detector delivers: `Views`, `DepthViews`, or, for measuring sticks, `Truth`."""


@dataclass(frozen=True)
class Contestant:
    """A detector that is ready to play."""

    name: str
    detector: Finder[Any]

    @property
    def sees(self) -> str:
        """One of PHOTOS, DEPTH and TRUTH."""
        return SEES[self.name]


def load_contestant(config: Evaluate) -> Contestant:
    """The detector of an evaluation. Raises `InputError` where its weights cannot be used."""
    gripper = Gripper.load(config.gripper)
    return Contestant(config.detector, _detector(config, gripper, threshold_of(config)))


def _detector(config: Evaluate, gripper: Gripper, threshold: float) -> Finder[Any]:
    if config.detector == "neugrasp":
        return NeuGraspDetector.load(
            config.weights, config.gripper, threshold=threshold, hand_check=config.hand_check
        )
    if config.detector == "vgn":
        return VgnDetector(load_vgn_head(_vgn_file(config.weights)), gripper, threshold)
    if config.detector == "oracle":
        if _is_vgn(config.weights):
            return Oracle(load_vgn_head(Path(config.weights)), gripper, threshold, is_vgn=True)
        head = load_checkpoint(config.weights).model().head
        return Oracle(
            head, gripper, threshold, is_vgn=False, hand=HandCheck(gripper) if config.hand_check else None
        )
    return Antipodal(gripper, config.seed)


def threshold_of(config: Evaluate) -> float:
    """Smoothed quality from which a grasp is one: what the user says, else the weights, else the protocol."""
    if config.threshold is not None:
        return config.threshold
    usual = protocol_of(config.protocol).threshold
    if config.detector == "antipodal" or _has_vgn_head(config):
        return usual
    return float(load_checkpoint(config.weights).about.get("threshold", usual))


def weights_facts(config: Evaluate) -> dict[str, Any]:
    """Name, hash and threshold of the weights that an evaluation depends on, how they were trained as far as
    they know, and whether the hand was checked; nothing where there are none."""
    if config.detector == "antipodal":
        return {}
    is_vgn = _has_vgn_head(config)
    path = _vgn_file(config.weights) if is_vgn else find_weights(config.weights)
    try:
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    facts = {"weights": path.name, "weights_sha256": digest, "threshold": threshold_of(config)}
    if is_vgn:
        return facts
    about = load_checkpoint(config.weights).about
    trained = {name: about[name] for name in ("recipe", "steps", "scenes") if name in about}
    return {**facts, "trained": trained, "hand_check": config.hand_check}


def _has_vgn_head(config: Evaluate) -> bool:
    return config.detector == "vgn" or _is_vgn(config.weights)


def _is_vgn(weights: str) -> bool:
    return Path(weights).suffix == ".pth"


def _vgn_file(weights: str) -> Path:
    if not _is_vgn(weights):
        raise InputError(
            f"--weights {weights}: vgn needs the public checkpoint vgn_conv.pth of github.com/ethz-asl/vgn"
        )
    return Path(weights)
