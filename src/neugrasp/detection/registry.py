"""Detectors by name: what each may see, and how it is made.

A detector is a `DetectorSpec` in any module, and a line that names it: an entry point of the group
`neugrasp.detectors` in the package that holds it, or `--detector package.module:NAME`.
"""

from __future__ import annotations

import hashlib
import importlib
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from neugrasp.detection.contract import Detector
from neugrasp.detection.options import DetectorOptions
from neugrasp.errors import InputError
from neugrasp.observation import CHANNELS

GROUP = "neugrasp.detectors"
PHOTOS = frozenset({"image", "background"})
DEPTH = frozenset({"depth"})
TRUTH = frozenset({"truth"})
"""For measuring sticks alone: they are handed the true surface, and no observation."""


def _no_facts(_options: DetectorOptions) -> dict[str, Any]:
    return {}


@dataclass(frozen=True)
class DetectorSpec:
    """What must be known of a detector to use it. Raises `ValueError` on channels that no camera has."""

    observes: frozenset[str]
    """Pictures that each frame of its `Observation` must have, of `observation.CHANNELS`; or `TRUTH`."""
    load: Callable[[DetectorOptions], Detector[Any]]
    """Makes it ready. Raises `InputError` where an option cannot be used."""
    facts: Callable[[DetectorOptions], dict[str, Any]] = _no_facts
    """What else its answers depend on, as plain data: weights with their hash, and the like."""

    def __post_init__(self) -> None:
        if self.observes != TRUTH and not (self.observes and self.observes <= set(CHANNELS)):
            raise ValueError(f"observes {set(self.observes)}: choose of {', '.join(CHANNELS)}")


def registered() -> list[str]:
    """The names of all detectors that packages declare here, sorted."""
    return sorted({point.name for point in entry_points(group=GROUP)})


def detector_spec(name: str) -> DetectorSpec:
    """The detector of that name. Raises `InputError` where there is none."""
    installed = {point.name: point for point in entry_points(group=GROUP)}
    if name in installed:
        return _checked(_loaded(name, installed[name].load), name)
    if ":" in name:
        module, _, attribute = name.partition(":")
        return _checked(_loaded(name, lambda: getattr(importlib.import_module(module), attribute)), name)
    known = ", ".join(sorted(installed))
    raise InputError(f"--detector {name!r}; choose one of {known}, or name one as package.module:NAME")


def photo_detector(name: str, what: str) -> DetectorSpec:
    """The detector of that name. Raises `InputError` where `what` it would be shown, which holds photos of
    scene and empty table, is not enough for it."""
    spec = detector_spec(name)
    if needed := spec.observes - PHOTOS:
        raise InputError(f"--detector {name}: needs {' and '.join(sorted(needed))}, and {what} holds photos")
    return spec


def load_detector(name: str = "auto", **options: Any) -> Detector[Any]:
    """A detector by name, or shipped weights by name, or a weights file, ready to use.

    `auto` is `neugrasp-evaluator` where an evaluator knows the weights, else `neugrasp`.

    `options` are the fields of `DetectorOptions`: gripper, threshold, device and so on. Raises `InputError`
    where there is no such detector or an option cannot be used, `TypeError` on an unknown option.
    """
    installed = {point.name for point in entry_points(group=GROUP)}
    if name in installed or ":" in name:
        return detector_spec(name).load(DetectorOptions(**options))
    return detector_spec("neugrasp").load(DetectorOptions(weights=name, **options))


def _loaded(name: str, load: Callable[[], object]) -> object:
    try:
        return load()
    except (ImportError, AttributeError, ValueError) as error:
        raise InputError(f"--detector {name}: cannot be imported ({error})") from error


def _checked(found: object, name: str) -> DetectorSpec:
    if not isinstance(found, DetectorSpec):
        raise InputError(f"--detector {name}: is a {type(found).__name__}, not a DetectorSpec")
    return found


def weights_facts(path: Path, threshold: float) -> dict[str, Any]:
    """Name and hash of a file of weights, and the threshold. Raises `InputError` where it cannot be read."""
    try:
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    return {"weights": path.name, "weights_sha256": digest, "threshold": threshold}
