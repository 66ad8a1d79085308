"""NeuGrasp: surfaces and 6-DoF grasps from a few RGB photos of a table.

    import neugrasp as ng

    detector = ng.load_detector("neugrasp", gripper="panda")
    detection = detector.detect(ng.read_scene("my_scene"))
    detection.grasps.poses  # (k, 4, 4), best first, in your world
    detection.surface()  # the mesh
    detection.save("out")

Everything in `__all__` is public and loaded when it is first used; other modules may change between versions.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

_HOMES = {
    "Camera": "geometry.camera",
    "Compute": "model.compute",
    "DataError": "errors",
    "Detection": "detection.contract",
    "Detector": "detection.contract",
    "DetectorOptions": "detection.options",
    "DetectorSpec": "detection.registry",
    "Frame": "observation",
    "Grasp": "grasp",
    "Grasps": "grasp",
    "Gripper": "gripper",
    "GripperFileError": "errors",
    "InputError": "errors",
    "NeuGraspDetector": "detection.detector",
    "NeuGraspError": "errors",
    "ObjectError": "errors",
    "Observation": "observation",
    "SceneError": "errors",
    "Steering": "detection.options",
    "Surface": "geometry.surface",
    "View": "observation",
    "Views": "observation",
    "WeightsError": "errors",
    "Workspace": "geometry.workspace",
    "WriteError": "errors",
    "demo_scenes": "demo.bundled",
    "load_detector": "detection.registry",
    "read_scene": "data.scene_folder",
    "steered": "detection.steering",
    "write_scene": "data.scene_folder",
}
"""Public names and the modules that hold them."""

if TYPE_CHECKING:
    from neugrasp.data.scene_folder import read_scene, write_scene
    from neugrasp.demo.bundled import demo_scenes
    from neugrasp.detection.contract import Detection, Detector
    from neugrasp.detection.detector import NeuGraspDetector
    from neugrasp.detection.options import DetectorOptions, Steering
    from neugrasp.detection.registry import DetectorSpec, load_detector
    from neugrasp.detection.steering import steered
    from neugrasp.errors import (
        DataError,
        GripperFileError,
        InputError,
        NeuGraspError,
        ObjectError,
        SceneError,
        WeightsError,
        WriteError,
    )
    from neugrasp.geometry.camera import Camera
    from neugrasp.geometry.surface import Surface
    from neugrasp.geometry.workspace import Workspace
    from neugrasp.grasp import Grasp, Grasps
    from neugrasp.gripper import Gripper
    from neugrasp.model.compute import Compute
    from neugrasp.observation import Frame, Observation, View, Views

__all__ = [
    "Camera",
    "Compute",
    "DataError",
    "Detection",
    "Detector",
    "DetectorOptions",
    "DetectorSpec",
    "Frame",
    "Grasp",
    "Grasps",
    "Gripper",
    "GripperFileError",
    "InputError",
    "NeuGraspDetector",
    "NeuGraspError",
    "ObjectError",
    "Observation",
    "SceneError",
    "Steering",
    "Surface",
    "View",
    "Views",
    "WeightsError",
    "Workspace",
    "WriteError",
    "demo_scenes",
    "load_detector",
    "read_scene",
    "steered",
    "write_scene",
]


def __getattr__(name: str) -> Any:
    """A public name, or `__version__`, loaded when it is asked for."""
    if name == "__version__":
        metadata = importlib.import_module("importlib.metadata")
        return metadata.version("neugrasp")
    if name in _HOMES:
        return getattr(importlib.import_module(f"neugrasp.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'neugrasp' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
