"""The description of a cell: one TOML file, read strictly, before anything moves."""

from __future__ import annotations

import hashlib
import json
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, cast, get_args

import numpy as np

from neugrasp.data.camera_checks import check_intrinsics
from neugrasp.data.fields import Fields
from neugrasp.data.user_files import read_text
from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.lens import Lens
from neugrasp.geometry.pose import Array, from_quaternion
from neugrasp.geometry.view_sets import VIEW_SETS
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper
from neugrasp.importers.resampling import full_rectangle, is_inside
from neugrasp.robot.arm_model import ARMS, JOINTS, ArmModel, arm_model
from neugrasp.robot.limits import Box, Limits
from neugrasp.robot.robotiq import FORCES
from neugrasp.robot.trajectory import Pace

FORMAT, VERSION = "neugrasp-cell", 1
FAR = 10.0
"""Metres from the origin within which a cell lies."""
ON_FLANGE = 0.5
"""Metres from the flange within which a hand or a camera is mounted."""
ARM_DRIVERS = ("twin", "ur")
GRIPPER_DRIVERS = ("twin", "robotiq")
CAMERA_DRIVERS = ("twin", "realsense", "opencv")
SceneKind = Literal["packed", "pile", "single"]
Materials = Literal["transparent-specular", "diffuse", "mixed", "specular", "transparent"]
TWIN = "twin"


@dataclass(frozen=True)
class ArmPart:
    """Which arm, and where it stands."""

    driver: str
    model: ArmModel
    address: str
    """Empty in a twin."""
    world_from_base: Array


@dataclass(frozen=True)
class GripperPart:
    """Which gripper, and how it is mounted."""

    driver: str
    model: str
    gripper: Gripper
    address: str
    force: float
    """Newton with which it closes."""
    flange_from_hand: Array

    @property
    def flange_from_tcp(self) -> Array:
        """Pose of the point between the pads."""
        pose = self.flange_from_hand.copy()
        pose[:3, 3] += self.gripper.tcp_height * pose[:3, 2]
        return pose


@dataclass(frozen=True)
class CameraPart:
    """The camera on the wrist."""

    driver: str
    address: str
    """A serial number, or the number of a device; empty: the first one."""
    camera: Camera
    """Camera of its photos without distortion. Its `world_from_camera` means nothing: the camera moves."""
    lens: Lens
    """Lens of its photos as they are taken."""
    flange_from_camera: Array
    housing: Array
    """(8, 3) corners of its box in the frame of the flange, metres."""
    exposure_us: int | None = None
    """Microseconds; None: the driver's own."""


@dataclass(frozen=True)
class TwinPart:
    """What lies on a simulated table."""

    scene: SceneKind
    objects: int
    materials: Materials
    seed: int


@dataclass(frozen=True)
class CellFile:
    """Everything that a cell file says."""

    source: str
    arm: ArmPart
    gripper: GripperPart
    camera: CameraPart
    workspace: Workspace
    views: str
    """A name of `VIEW_SETS`."""
    out_of_sight: Array
    """(6,) radians: the joints at which the camera does not see the arm and the arm sees the table free."""
    drop: Array
    """(6,) radians: where what is held is let go."""
    limits: Limits
    approach_speed: float
    """m/s, on the way to a grasp and away from it."""
    twin: TwinPart | None

    @property
    def is_twin(self) -> bool:
        """Whether nothing of it is real."""
        return self.arm.driver == TWIN

    def at_speed(self, scale: float) -> CellFile:
        """The same cell whose arm moves at a share of its limits."""
        limits = replace(self.limits, pace=self.limits.pace.scaled(scale))
        return replace(self, limits=limits, approach_speed=scale * self.approach_speed)


def read_cell(path: Path) -> CellFile:
    """A cell file. Raises `InputError` naming the file, the field and what would be right."""
    try:
        text = read_text(path)
    except FileNotFoundError:
        raise InputError(
            f"{path}: missing; a cell file is needed (examples/cells/twin.toml is one)"
        ) from None
    try:
        data = tomllib.loads(text)
    except RecursionError:
        raise InputError(f"{path}: not valid TOML (lists lie too deep in each other)") from None
    except ValueError as error:
        raise InputError(f"{path}: not valid TOML ({error})") from error
    return _cell(Fields(str(path), data))


def text_hash(path: Path) -> str:
    """SHA-256 of what a cell file says, whatever its spaces and comments."""
    content = json.dumps(tomllib.loads(read_text(path)), sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()


def _cell(fields: Fields) -> CellFile:
    fields.expect(FORMAT, VERSION)
    parts = ("arm", "gripper", "camera", "workspace", "views", "places", "limits")
    fields.only(("format", "version", *parts, TWIN))
    arm = _arm(fields.inside("arm"))
    places, limits, views = (fields.inside(name) for name in ("places", "limits", "views"))
    places.only(("out_of_sight", "drop"))
    views.only(("set",))
    workspace = fields.inside("workspace")
    workspace.only(("world_from_workspace",))
    cell = CellFile(
        source=fields.source,
        arm=arm,
        gripper=_gripper(fields.inside("gripper")),
        camera=_camera(fields.inside("camera")),
        workspace=Workspace(world_from_workspace=_pose(workspace, "world_from_workspace")),
        views=views.text("set", tuple(VIEW_SETS)),
        out_of_sight=_joints(places, "out_of_sight", arm.model),
        drop=_joints(places, "drop", arm.model),
        limits=_limits(limits, arm.model),
        approach_speed=limits.number("approach_speed", 0.01, 0.5, "m/s"),
        twin=_twin(fields.inside(TWIN)) if TWIN in fields.data else None,
    )
    drivers = {cell.arm.driver, cell.gripper.driver, cell.camera.driver}
    if TWIN in drivers and drivers != {TWIN}:
        raise fields.refuse(
            "arm.driver", f"is {cell.arm.driver!r}; either all three drivers are 'twin' or none"
        )
    if cell.is_twin != (cell.twin is not None):
        raise fields.refuse(TWIN, "must be there where the drivers are 'twin', and only there")
    return cell


def _arm(fields: Fields) -> ArmPart:
    fields.only(("driver", "model", "address", "world_from_base"))
    driver = fields.text("driver", ARM_DRIVERS)
    model = arm_model(fields.text("model", tuple(ARMS)))
    return ArmPart(driver, model, _address(fields, driver, True), _pose(fields, "world_from_base"))


def _gripper(fields: Fields) -> GripperPart:
    fields.only(("driver", "model", "address", "force", "flange_from_hand"))
    driver, name = fields.text("driver", GRIPPER_DRIVERS), fields.text("model")
    beside = Path(fields.source).parent / name
    gripper = Gripper.load(beside if name.endswith(".json") else name)
    low, high = FORCES if driver == "robotiq" else (5.0, 250.0)
    force = fields.number("force", low, high, "N")
    address = _address(fields, driver, True)
    return GripperPart(driver, name, gripper, address, force, _pose(fields, "flange_from_hand", ON_FLANGE))


def _camera(fields: Fields) -> CameraPart:
    known = ("driver", "address", "width", "height", "intrinsics", "housing", "flange_from_camera")
    fields.only((*known, "exposure_us", "distortion"))
    driver = fields.text("driver", CAMERA_DRIVERS)
    width, height = fields.whole("width", 64, 8192), fields.whole("height", 64, 8192)
    given = fields.rows("intrinsics", 3, 1e5, "a 3 x 3 matrix").tolist()
    intrinsics = check_intrinsics(given, width, height, f"{fields.source}: {fields.prefix}intrinsics")
    if not (0 <= intrinsics[0, 2] <= width and 0 <= intrinsics[1, 2] <= height):
        raise fields.refuse("intrinsics", f"has its principal point outside {width} x {height} pixels")
    mounted = _pose(fields, "flange_from_camera", ON_FLANGE)
    edges = fields.numbers("housing", 3, 0.5, "[x, y, z] in metres")
    signs = np.stack(np.meshgrid((-1, 1), (-1, 1), (-1, 1)), -1).reshape(-1, 3)
    if not np.all(edges > 0):
        raise fields.refuse("housing", "must have three edges longer than 0 m")
    corners = (signs * edges / 2) @ mounted[:3, :3].T + mounted[:3, 3]
    exposure = fields.whole("exposure_us", 1, 1_000_000) if "exposure_us" in fields.data else None
    lens = _lens(fields, driver, Lens(intrinsics, width, height))
    shown = full_rectangle(is_inside(lens, lens.distorted(lens.pixel_grid()))) if lens.is_distorted else None
    camera = Camera(intrinsics, np.eye(4), width, height, shown)
    return CameraPart(driver, _address(fields, driver, False), camera, lens, mounted, corners, exposure)


def _lens(fields: Fields, driver: str, ideal: Lens) -> Lens:
    """The lens with its distortion, where the file says one."""
    if "distortion" not in fields.data:
        return ideal
    if driver == TWIN:
        raise fields.refuse("distortion", "is for hardware; the photos of a twin have none")
    values = fields.numbers("distortion", 5, 10, "[k1, k2, p1, p2, k3], as OpenCV has them")
    k1, k2, p1, p2, k3 = values.tolist()
    return replace(ideal, radial=(k1, k2, k3), tangential=(p1, p2))


def _address(fields: Fields, driver: str, needed: bool) -> str:
    if driver == TWIN:
        if "address" in fields.data:
            raise fields.refuse("address", "is for hardware; a twin has none")
        return ""
    return fields.text("address") if needed or "address" in fields.data else ""


def _pose(fields: Fields, field: str, far: float = FAR) -> Array:
    inside = fields.inside(field)
    inside.only(("position", "quaternion_xyzw"))
    position = inside.numbers("position", 3, far, f"[x, y, z] in metres, each within {far:g} of 0")
    return from_quaternion(inside.unit("quaternion_xyzw", 4), position)


def _joints(fields: Fields, field: str, model: ArmModel) -> Array:
    degrees = fields.numbers(field, JOINTS, 360, "six angles in degrees (each from -360 to 360)")
    if degrees.any() and np.abs(degrees).max() <= 2 * np.pi:
        raise fields.refuse(field, f"is {degrees.tolist()}, which looks like radians; give degrees")
    joints = np.deg2rad(degrees)
    if np.any(joints < np.array(model.low)) or np.any(joints > np.array(model.high)):
        raise fields.refuse(field, f"is {degrees.tolist()}; a joint is beyond the range of a {model.name}")
    return joints


def _limits(fields: Fields, model: ArmModel) -> Limits:
    known = ("joint_speed", "joint_acceleration", "tcp_speed", "approach_speed", "force", "lowest_tcp")
    fields.only((*known, "zone", "keep_out"))
    pace = Pace(
        fields.number("joint_speed", 0.05, min(model.speed), "rad/s"),
        fields.number("joint_acceleration", 0.1, 20, "rad/s^2"),
        fields.number("tcp_speed", 0.01, 1.5, "m/s"),
    )
    lowest = fields.number("lowest_tcp", 0.0, 0.5, "m")
    keep_out = tuple(map(_box, fields.each("keep_out")))
    force = fields.number("force", 20, 250, "N")
    return Limits(pace, _box(fields.inside("zone")), lowest, keep_out, force)


def _box(fields: Fields) -> Box:
    fields.only(("low", "high"))
    low, high = (fields.numbers(name, 3, FAR, "[x, y, z] in metres") for name in ("low", "high"))
    if not np.all(low < high):
        raise fields.refuse("low", f"is {low.tolist()}; each number must be less than that of high")
    return Box(low, high)


def _twin(fields: Fields) -> TwinPart:
    fields.only(("scene", "objects", "materials", "seed"))
    scene = cast(SceneKind, fields.text("scene", get_args(SceneKind)))
    materials = cast(Materials, fields.text("materials", get_args(Materials)))
    return TwinPart(scene, fields.whole("objects", 1, 12), materials, fields.whole("seed", 0, 2**31))
