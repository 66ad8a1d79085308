"""Messages of ROS 2 as dictionaries, the form in which rosbridge sends and takes them.

The definitions are those of sensor_msgs, tf2_msgs, moveit_msgs and grasping_msgs (Jazzy); a test holds every
field and type against them. Bytes come and go in base64.
"""

from __future__ import annotations

import base64
import binascii
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neugrasp.data.camera_checks import check_intrinsics
from neugrasp.data.fields import Fields, is_number, shown
from neugrasp.data.photo_files import Photo, read_image
from neugrasp.exporters.ros import link_from_tcp, pose_stamped
from neugrasp.geometry.pose import Array, from_quaternion, inverse
from neugrasp.grasp import APPROACH, RETREAT, Grasp
from neugrasp.gripper import Gripper
from neugrasp.observation import Image
from neugrasp.ros.parameters import Parameters

CHANNELS = {"rgb8": (0, 1, 2), "bgr8": (2, 1, 0), "rgba8": (0, 1, 2), "bgra8": (2, 1, 0), "mono8": (0, 0, 0)}
"""Where red, green and blue lie in a pixel, by the name that ROS gives to the encoding."""
BYTES = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "mono8": 1}
LARGEST_SIDE = 20_000
FLOAT32 = 7
"""The number that sensor_msgs/PointField gives to the type."""
FARTHEST = 1e6


def photo_of(message: dict[str, Any], topic: str, is_compressed: bool) -> Image:
    """RGB (h, w, 3) of an Image or a CompressedImage. Raises `InputError` naming the topic and the field."""
    given = Fields(topic, message)
    data = given.get("data")
    if isinstance(data, list):
        if not all(type(value) is int and 0 <= value <= 255 for value in data):
            raise given.refuse("data", "is no list of bytes, whole numbers from 0 to 255")
        content = bytes(data)
    else:
        try:
            content = base64.b64decode(given.text("data"), validate=True)
        except (ValueError, binascii.Error) as error:
            raise given.refuse("data", f"is no base64 ({error})") from error
    if is_compressed:
        return read_image(Photo(topic, content), "a message")
    encoding = given.text("encoding", tuple(CHANNELS))
    height, width = (given.whole(name, 1, LARGEST_SIDE) for name in ("height", "width"))
    step = given.whole("step", width * BYTES[encoding], LARGEST_SIDE * 8)
    if len(content) != step * height:
        raise given.refuse("data", f"has {len(content)} bytes; {height} rows of {step} have {step * height}")
    rows = np.frombuffer(content, dtype=np.uint8).reshape(height, step)
    pixels = rows[:, : width * BYTES[encoding]].reshape(height, width, BYTES[encoding])
    return np.ascontiguousarray(pixels[..., CHANNELS[encoding]])


def intrinsics_of(message: dict[str, Any], topic: str, photo: Image, is_rectified: bool) -> Array:
    """The 3x3 matrix of a photo's CameraInfo: that of P where lens distortion is taken out, else K.

    Raises `InputError` where the photo is another part or size of the sensor, or is distorted.
    """
    given = Fields(topic, message)
    height, width = photo.shape[:2]
    told = tuple(given.whole(name, 0, LARGEST_SIDE) for name in ("width", "height"))
    if told != (width, height):
        raise given.refuse("width", f"and height are {told[0]} x {told[1]}; the photo has {width} x {height}")
    for name in ("binning_x", "binning_y"):
        if given.data.get(name, 0) not in (0, 1):
            raise given.refuse(name, "is not 0: subscribe to photos of the whole size")
    if "roi" in given.data:
        part = given.inside("roi")
        for name in ("x_offset", "y_offset"):
            if part.whole(name, 0, LARGEST_SIDE):
                raise part.refuse(name, "is not 0: subscribe to photos of the whole sensor")
    if is_rectified:
        p = given.numbers("p", 12, FARTHEST, "12 numbers").reshape(3, 4)
        if np.abs(p[:, 3]).max() > 1e-6:
            raise given.refuse("p", "shifts the camera (the right one of a stereo pair): take the left one")
        if not p.any():
            raise given.refuse("p", "is all zeros: the camera is not calibrated")
        return check_intrinsics(p[:, :3].tolist(), width, height, topic)
    distortion = given.list("d")
    if not all(map(is_number, distortion)):
        raise given.refuse("d", f"is {shown(distortion)}; it must be a list of numbers")
    if any(not abs(x) <= 1e-9 for x in distortion):
        raise given.refuse(
            "d", "is not 0: photos are distorted; subscribe to those of image_proc with is_rectified"
        )
    k = given.numbers("k", 9, FARTHEST, "9 numbers").reshape(3, 3)
    return check_intrinsics(k.tolist(), width, height, topic)


class Transforms:
    """The newest transforms of /tf and /tf_static."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Array]] = {}

    def take(self, message: dict[str, Any]) -> None:
        """A tf2_msgs/TFMessage. Raises `InputError`."""
        for entry in Fields("/tf", message).each("transforms"):
            moved, turned = (entry.inside("transform").inside(key) for key in ("translation", "rotation"))
            quaternion = np.array([turned.number(axis, -1.01, 1.01) for axis in "xyzw"])
            if abs(float(np.linalg.norm(quaternion)) - 1) > 0.01:
                raise entry.refuse("transform.rotation", "is no unit quaternion")
            pose = from_quaternion(quaternion, [moved.number(axis, -FARTHEST, FARTHEST) for axis in "xyz"])
            parent = entry.inside("header").text("frame_id").lstrip("/")
            self._parents[entry.text("child_frame_id").lstrip("/")] = parent, pose

    def pose(self, target: str, source: str) -> Array | None:
        """4x4 `target_from_source`; None where the tree does not join them."""
        to_target, to_source = self._chain(target), self._chain(source)
        for frame, target_pose in to_target.items():
            if frame in to_source:
                pose: Array = inverse(target_pose) @ to_source[frame]
                return pose
        return None

    def _chain(self, frame: str) -> dict[str, Array]:
        """Every frame above one, with the pose of that one in it."""
        chain = {frame: np.eye(4)}
        while frame in self._parents and self._parents[frame][0] not in chain:
            parent, pose = self._parents[frame]
            chain[parent] = pose @ chain[frame]
            frame = parent
        return chain


def grasps_of(grasps: Sequence[Grasp], gripper: Gripper, given: Parameters) -> list[dict[str, Any]]:
    """moveit_msgs/Grasp messages: the pose is that of the parent link of the end effector.

    Before the grasp the hand goes 5 cm along its approach, afterwards it goes back, or up after a grasp from
    the side; fingers open as far as they can, then close to the grasp's width.
    """
    return [
        _grasp(
            number,
            grasp,
            grasp.pose @ inverse(link_from_tcp(gripper, given.link, grasp.width)),
            gripper,
            given,
        )
        for number, grasp in enumerate(grasps)
    ]


def _grasp(number: int, grasp: Grasp, pose: Array, gripper: Gripper, given: Parameters) -> dict[str, Any]:
    back = grasp.retreat[:3, 3] - grasp.position
    opened, closed = (
        _posture(given.finger_joints, width / 2) for width in (gripper.max_opening, grasp.width)
    )
    return {
        "id": f"grasp_{number}",
        "pre_grasp_posture": opened,
        "grasp_posture": closed,
        "grasp_pose": {**pose_stamped(pose, given.world_frame), "header": header(given.world_frame)},
        "grasp_quality": float(grasp.score),
        "pre_grasp_approach": _motion(grasp.approach, APPROACH, given.world_frame),
        "post_grasp_retreat": _motion(back / np.linalg.norm(back), RETREAT, given.world_frame),
        "post_place_retreat": _motion(-grasp.approach, RETREAT, given.world_frame),
        "max_contact_force": 0.0,
        "allowed_touch_objects": [],
    }


def _posture(joints: Sequence[str], position: float) -> dict[str, Any]:
    """A trajectory_msgs/JointTrajectory of one point."""
    point = {
        "positions": [float(position)] * len(joints),
        "velocities": [],
        "accelerations": [],
        "effort": [],
        "time_from_start": {"sec": 1, "nanosec": 0},
    }
    return {"header": header(""), "joint_names": list(joints), "points": [point]}


def _motion(direction: Array, distance: float, frame: str) -> dict[str, Any]:
    """A moveit_msgs/GripperTranslation: half the way is enough."""
    vector = {axis: float(value) for axis, value in zip("xyz", direction, strict=True)}
    return {
        "direction": {"header": header(frame), "vector": vector},
        "desired_distance": distance,
        "min_distance": distance / 2,
    }


def cloud_of(points: NDArray[np.floating[Any]], frame: str) -> dict[str, Any]:
    """A sensor_msgs/PointCloud2 of (n, 3) points, metres."""
    fields = [
        {"name": axis, "offset": 4 * i, "datatype": FLOAT32, "count": 1} for i, axis in enumerate("xyz")
    ]
    data = np.ascontiguousarray(points, dtype="<f4").tobytes()
    return {
        "header": header(frame),
        "height": 1,
        "width": len(points),
        "fields": fields,
        "is_bigendian": False,
        "point_step": 12,
        "row_step": len(data),
        "data": base64.b64encode(data).decode("ascii"),
        "is_dense": True,
    }


def header(frame: str) -> dict[str, Any]:
    """A std_msgs/Header; a time of 0 is the latest."""
    return {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": frame}
