"""What a node is told: one JSON file, every key of which is known."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast, get_args

from neugrasp.data.camera_checks import check_rigid
from neugrasp.data.fields import Fields, shown
from neugrasp.data.strict_json import read_json
from neugrasp.errors import InputError
from neugrasp.exporters.ros import Link
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import MAX_VIEWS
from neugrasp.output import check_file, write_text

FORMAT, VERSION = "neugrasp-ros", 1
KEYS = (
    "format",
    "version",
    "bridge",
    "namespace",
    "world_frame",
    "cameras",
    "workspace",
    "backgrounds",
    "link",
    "finger_joints",
    "oldest_s",
    "weights",
    "gripper",
    "device",
    "server",
)
ADDRESS = re.compile(r"wss?://[^\s/:?#@]+(:\d{1,5})?(/\S*)?|wss?://\[[0-9a-fA-F:.]+\](:\d{1,5})?(/\S*)?")
NAMESPACE = re.compile(r"(/[A-Za-z]\w*)+", re.ASCII)
"""As ROS resolves names: another spelling would come back as another name."""
CAMERA_KEYS = ("image", "camera_info", "frame", "is_rectified")


@dataclass(frozen=True)
class CameraTopics:
    """Where one camera that stands still is heard."""

    image: str
    """A topic of sensor_msgs/msg/Image, or of CompressedImage where it ends with /compressed."""
    camera_info: str
    frame: str
    """Frame of the optical axes: x right, y down, z forward."""
    is_rectified: bool = True
    """Whether lens distortion is taken out of the photos, as by image_proc: then P is read, else K."""

    @property
    def is_compressed(self) -> bool:
        """Which of the two messages comes."""
        return self.image.endswith("/compressed")


@dataclass(frozen=True)
class Parameters:
    """Parameters of a node."""

    cameras: tuple[CameraTopics, ...]
    workspace: Workspace
    """In the world frame."""
    backgrounds: Path
    """A folder of photos of the empty table, one for each camera: 0.png and so on."""
    bridge: str = "ws://127.0.0.1:9090"
    namespace: str = "/neugrasp"
    world_frame: str = "base_link"
    link: Link = "hand"
    """The parent link of the end effector, whose poses MoveIt wants."""
    finger_joints: tuple[str, ...] = ("panda_finger_joint1", "panda_finger_joint2")
    """Each is half as far from the middle as the pads are from each other."""
    oldest_s: float = 2.0
    """Seconds after which a photo is too old to be grasped by."""
    weights: str = "neugrasp"
    gripper: str = "panda"
    device: str = "cpu"
    server: str | None = None
    """A `neugrasp serve` that predicts in place of this machine."""


def read_parameters(file: Path) -> Parameters:
    """Raises `InputError` naming the file and the field."""
    given = Fields(str(file), read_json(file, "the parameters of `neugrasp ros`"))
    given.expect(FORMAT, VERSION)
    given.only(KEYS)
    cameras = tuple(_camera(entry) for entry in given.each("cameras"))
    if not 1 <= len(cameras) <= MAX_VIEWS:
        raise given.refuse("cameras", f"has {len(cameras)} entries; a scene has 1 to {MAX_VIEWS} views")
    pose = check_rigid(given.inside("workspace").get("world_from_workspace"), f"{file}: world_from_workspace")
    workspace = Workspace.from_dict(
        {k: v for k, v in given.inside("workspace").data.items() if k != "world_from_workspace"}, str(file)
    )
    told: dict[str, Any] = {
        name: given.text(name)
        for name in ("bridge", "namespace", "world_frame", "weights", "gripper", "device", "server")
        if given.data.get(name) is not None
    }
    if not ADDRESS.fullmatch(str(told.get("bridge", Parameters.bridge))):
        raise given.refuse("bridge", f"is {told['bridge']!r}; it must be as {Parameters.bridge}")
    if not NAMESPACE.fullmatch(str(told.get("namespace", Parameters.namespace))):
        raise given.refuse("namespace", f"is {told['namespace']!r}; it must be as {Parameters.namespace}")
    if len({camera.image for camera in cameras}) < len(cameras):
        raise given.refuse("cameras", "name one topic of photos twice; each view is of a camera of its own")
    if "link" in given.data:
        told["link"] = cast(Link, given.text("link", get_args(Link)))
    if "oldest_s" in given.data:
        told["oldest_s"] = given.number("oldest_s", 0.01, 3600, "s")
    if "finger_joints" in given.data:
        names = given.list("finger_joints")
        if not names or not all(isinstance(name, str) and name for name in names):
            raise given.refuse("finger_joints", f"is {shown(names)}; it must be a list of names")
        told["finger_joints"] = tuple(names)
    backgrounds = file.parent / given.text("backgrounds")
    return Parameters(cameras, replace(workspace, world_from_workspace=pose), backgrounds, **told)


def _camera(given: Fields) -> CameraTopics:
    given.only(CAMERA_KEYS)
    is_rectified = given.flag("is_rectified") if "is_rectified" in given.data else True
    return CameraTopics(given.text("image"), given.text("camera_info"), given.text("frame"), is_rectified)


def write_parameters(file: Path) -> None:
    """Parameters of four cameras, to be changed. Raises `InputError` where the file is there."""
    check_file(file)
    if file.exists():
        raise InputError(f"{file}: is there already; choose another name")
    cameras = [
        {
            "image": f"/camera{i}/image_rect/compressed",
            "camera_info": f"/camera{i}/camera_info",
            "frame": f"camera{i}_color_optical_frame",
            "is_rectified": True,
        }
        for i in range(4)
    ]
    place = Workspace().world_from_workspace.copy()
    place[:3, 3] = 0.4, -0.15, -0.05
    content = {
        "format": FORMAT,
        "version": VERSION,
        "bridge": Parameters.bridge,
        "namespace": Parameters.namespace,
        "world_frame": Parameters.world_frame,
        "cameras": cameras,
        "workspace": {"size": Workspace().size, "world_from_workspace": place.tolist()},
        "backgrounds": "backgrounds",
        "link": Parameters.link,
        "finger_joints": list(Parameters.finger_joints),
        "oldest_s": Parameters.oldest_s,
        "weights": Parameters.weights,
        "gripper": Parameters.gripper,
        "device": Parameters.device,
        "server": None,
    }
    write_text(file, json.dumps(content, indent=1) + "\n")
