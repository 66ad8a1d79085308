"""The detectors that can be evaluated, by name: what each may see, and how it is made.

Another one is a `DetectorSpec` in a module of its own: `--detector package.module:NAME`, or by its name once
the package that holds it declares an entry point of the group `neugrasp.detectors`.
"""

from __future__ import annotations

import hashlib
import importlib
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Literal

from neugrasp.baselines.vgn import VgnDetector, load_vgn_head
from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.detection.hand_check import HandCheck
from neugrasp.detection.judge import Judge
from neugrasp.errors import InputError
from neugrasp.evaluation.commands import Evaluate
from neugrasp.evaluation.declutter import Finder
from neugrasp.evaluation.measuring_sticks import Antipodal, JudgedTruth, Oracle
from neugrasp.evaluation.protocols import protocol_of
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper
from neugrasp.model.checkpoint import find_weights, load_checkpoint
from neugrasp.model.evaluator_file import find_evaluator

GROUP = "neugrasp.detectors"


@dataclass(frozen=True)
class DetectorSpec:
    """What an evaluation must know of a detector."""

    observes: Literal["photos", "depth", "truth"]
    """What its camera delivers: `Views`, `DepthViews`, or, for measuring sticks, `Truth`."""
    load: Callable[[Evaluate], Finder[Any]]
    """Makes it ready to play. Raises `InputError` where its weights cannot be used."""
    facts: Callable[[Evaluate], dict[str, Any]] = lambda _config: {}
    """What else its answers depend on, for run.json: weights with their hash, and the like."""


def detector_spec(name: str) -> DetectorSpec:
    """The detector of that name. Raises `InputError` where there is none."""
    if name in DETECTORS:
        return DETECTORS[name]
    if ":" in name:
        return _imported(name)
    installed = {point.name: point for point in entry_points(group=GROUP)}
    if name in installed:
        return _checked(installed[name].load(), name)
    known = ", ".join([*DETECTORS, *sorted(installed)])
    raise InputError(f"--detector {name!r}; choose one of {known}, or name one as package.module:NAME")


def _imported(name: str) -> DetectorSpec:
    module, _, attribute = name.partition(":")
    try:
        return _checked(getattr(importlib.import_module(module), attribute), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise InputError(f"--detector {name}: cannot be imported ({error})") from error


def _checked(found: object, name: str) -> DetectorSpec:
    if not isinstance(found, DetectorSpec):
        raise InputError(f"--detector {name}: is a {type(found).__name__}, not a DetectorSpec")
    return found


def threshold_of(config: Evaluate) -> float:
    """Smoothed quality from which a grasp is one: what the user says, else the weights, else the protocol."""
    if config.threshold is not None:
        return config.threshold
    usual = protocol_of(config.protocol).threshold
    if _is_vgn(config.weights):
        return usual
    return float(load_checkpoint(config.weights).about.get("threshold", usual))


def _neugrasp(config: Evaluate) -> Finder[Any]:
    return NeuGraspDetector.load(
        config.weights, config.gripper, threshold=threshold_of(config), hand_check=config.hand_check
    )


def _vgn(config: Evaluate) -> Finder[Any]:
    head = load_vgn_head(_vgn_file(config.weights))
    return VgnDetector(head, Gripper.load(config.gripper), threshold_of(config))


def _oracle(config: Evaluate) -> Finder[Any]:
    gripper, threshold = Gripper.load(config.gripper), threshold_of(config)
    if _is_vgn(config.weights):
        return Oracle(load_vgn_head(Path(config.weights)), gripper, threshold, is_vgn=True)
    head = load_checkpoint(config.weights).model().head
    hand = HandCheck(gripper) if config.hand_check else None
    return Oracle(head, gripper, threshold, is_vgn=False, hand=hand)


def _judged_truth(config: Evaluate) -> Finder[Any]:
    return JudgedTruth(_judge(config))


def _judge(config: Evaluate) -> Judge:
    return Judge.load(config.evaluator, config.gripper, Workspace(), config.threshold)


def _evaluator(config: Evaluate) -> Finder[Any]:
    return NeuGraspDetector.load(
        config.weights, config.gripper, threshold=config.threshold, evaluator=config.evaluator
    )


def _antipodal(config: Evaluate) -> Finder[Any]:
    return Antipodal(Gripper.load(config.gripper), config.seed)


def _weights_facts(config: Evaluate) -> dict[str, Any]:
    """Name, hash and threshold of the weights, how they were trained as far as they know, and whether the
    hand was checked."""
    if _is_vgn(config.weights):
        return _file_facts(Path(config.weights), config)
    about = load_checkpoint(config.weights).about
    trained = {name: about[name] for name in ("recipe", "steps", "scenes") if name in about}
    facts = _file_facts(find_weights(config.weights), config)
    return {**facts, "trained": trained, "hand_check": config.hand_check}


def _vgn_facts(config: Evaluate) -> dict[str, Any]:
    return _file_facts(_vgn_file(config.weights), config)


def _file_facts(path: Path, config: Evaluate) -> dict[str, Any]:
    try:
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    return {"weights": path.name, "weights_sha256": digest, "threshold": threshold_of(config)}


def _is_vgn(weights: str) -> bool:
    return Path(weights).suffix == ".pth"


def _vgn_file(weights: str) -> Path:
    if not _is_vgn(weights):
        raise InputError(
            f"--weights {weights}: vgn needs the public checkpoint vgn_conv.pth of github.com/ethz-asl/vgn"
        )
    return Path(weights)


def _evaluator_facts(config: Evaluate) -> dict[str, Any]:
    """Name, hash and settings of the evaluator."""
    path = find_evaluator(config.evaluator)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    judge = asdict(_judge(config).config)
    return {
        "evaluator": path.name, "evaluator_sha256": digest, "judge": judge, "threshold": judge["threshold"]
    }  # fmt: skip


DETECTORS = {
    "neugrasp": DetectorSpec("photos", _neugrasp, _weights_facts),
    "neugrasp-evaluator": DetectorSpec(
        "photos", _evaluator, lambda config: {**_weights_facts(config), **_evaluator_facts(config)}
    ),
    "vgn": DetectorSpec("depth", _vgn, _vgn_facts),
    "oracle": DetectorSpec("truth", _oracle, _weights_facts),
    "oracle-evaluator": DetectorSpec("truth", _judged_truth, _evaluator_facts),
    "antipodal": DetectorSpec("truth", _antipodal),
}
"""Those that come with the package."""
