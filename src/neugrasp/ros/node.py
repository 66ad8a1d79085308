"""What happens with messages: the newest photos are kept, and grasps are found when somebody asks."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image as Picture

from neugrasp.data.camera_checks import check_scene
from neugrasp.data.photo_files import read_image
from neugrasp.data.whole_or_nothing import whole_or_nothing
from neugrasp.detection.contract import Detection
from neugrasp.detection.explanation import explain
from neugrasp.errors import InputError, NeuGraspError
from neugrasp.geometry.camera import Camera
from neugrasp.gripper import Gripper
from neugrasp.observation import Image, View, Views
from neugrasp.ros.bridge import Bridge, Message
from neugrasp.ros.messages import Transforms, cloud_of, grasps_of, header, intrinsics_of, photo_of
from neugrasp.ros.parameters import CameraTopics, Parameters

log = logging.getLogger(__name__)

SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
"""Values of action_msgs/msg/GoalStatus."""
NOTHING = np.empty((0, 3))
QUIET_MS = 200
"""Milliseconds between photos of a camera: only the newest one counts."""


class Node:
    """Services, an action and topics under one namespace."""

    def __init__(self, given: Parameters, gripper: Gripper, detect: Callable[[Views], Detection]):
        """`detect` is called in a thread, once at a time."""
        self.given, self._gripper, self._detect = given, gripper, detect
        self._transforms = Transforms()
        self._newest: dict[str, tuple[Message, float]] = {}
        """By topic: the newest message, and when it came."""
        self._busy = asyncio.Lock()
        self._cancelled: set[str] = set()
        handlers = {
            "publish": self._published,
            "call_service": self._called,
            "send_action_goal": self._asked,
            "cancel_action_goal": self._cancel,
        }
        self.bridge = Bridge(given.bridge, self._greeting(), handlers)

    def _name(self, name: str) -> str:
        return f"{self.given.namespace}/{name}"

    def _greeting(self) -> list[Message]:
        """What is listened to, and what is offered."""
        topics = [("/tf", "tf2_msgs/msg/TFMessage"), ("/tf_static", "tf2_msgs/msg/TFMessage")]
        for camera in self.given.cameras:
            kind = "CompressedImage" if camera.is_compressed else "Image"
            topics += [(camera.image, f"sensor_msgs/msg/{kind}")]
            topics += [(camera.camera_info, "sensor_msgs/msg/CameraInfo")]
        listened = [
            {"op": "subscribe", "topic": topic, "type": kind, "queue_length": 1}
            | ({"throttle_rate": QUIET_MS} if topic not in ("/tf", "/tf_static") else {"queue_length": 100})
            for topic, kind in dict(topics).items()
        ]
        service = {"op": "advertise_service", "type": "std_srvs/srv/Trigger"}
        action = {"op": "advertise_action", "type": "grasping_msgs/action/GraspPlanning"}
        told = {"grasps": "grasping_msgs/msg/GraspableObject", "surface": "sensor_msgs/msg/PointCloud2"}
        return [
            *listened,
            *({**service, "service": self._name(name)} for name in ("plan", "take_backgrounds")),
            {**action, "action": self._name("plan_grasps")},
            *({"op": "advertise", "topic": self._name(name), "type": kind} for name, kind in told.items()),
        ]

    async def _published(self, message: Message) -> None:
        topic, content = message.get("topic"), message.get("msg")
        if not isinstance(topic, str) or not isinstance(content, dict):
            return
        if topic in ("/tf", "/tf_static"):
            self._transforms.take(content)
        else:
            self._newest[topic] = content, time.monotonic()

    async def _called(self, message: Message) -> None:
        """The two services: plan, and take the photos of now for those of the empty table."""
        name = str(message.get("service", ""))
        try:
            if name == self._name("plan"):
                detection = await self._found()
                said = f"{len(detection.grasps)} grasps ({explain(detection)})"
            elif name == self._name("take_backgrounds"):
                await asyncio.to_thread(self._keep_backgrounds)
                said = f"{len(self.given.cameras)} photos of the empty table in {self.given.backgrounds}"
            else:
                raise InputError(f"there is no service {name!r}")
            values = {"success": True, "message": said}
        except Exception as error:
            values = {"success": False, "message": _reason(error)}
        answer = {"op": "service_response", "service": name, "values": values, "result": True}
        await self.bridge.send({**answer, **({"id": message["id"]} if "id" in message else {})})

    async def _asked(self, message: Message) -> None:
        """The action: feedback when the grasps are there, then the result."""
        goal = {"action": message.get("action"), "id": message.get("id")}
        try:
            detection = await self._found()
            grasps = grasps_of(detection.grasps, self._gripper, self.given)
            status = CANCELED if str(goal["id"]) in self._cancelled else SUCCEEDED
        except Exception as error:
            log.warning("no grasps: %s", _reason(error))
            grasps, status = [], ABORTED
        self._cancelled.discard(str(goal["id"]))
        if status == SUCCEEDED:
            await self.bridge.send({"op": "action_feedback", **goal, "values": {"grasps": grasps}})
        values = {"grasps": grasps if status == SUCCEEDED else []}
        done = {"op": "action_result", **goal, "values": values, "status": status}
        await self.bridge.send({**done, "result": status == SUCCEEDED})

    async def _cancel(self, message: Message) -> None:
        """A detection that has begun ends; its result is not given out."""
        self._cancelled.add(str(message.get("id")))

    async def _found(self) -> Detection:
        """Grasps of the newest photos, which are published, too. Raises `NeuGraspError`."""
        async with self._busy:
            detection = await asyncio.to_thread(lambda: self._detect(self._views()))
        log.info("%s", explain(detection))
        grasps = grasps_of(detection.grasps, self._gripper, self.given)
        thing = {"object": _nameless(self.given.world_frame), "grasps": grasps}
        await self.bridge.send({"op": "publish", "topic": self._name("grasps"), "msg": thing})
        if detection.tsdf is not None:
            cloud = cloud_of(detection.surface().vertices, self.given.world_frame)
            await self.bridge.send({"op": "publish", "topic": self._name("surface"), "msg": cloud})
        return detection

    def _views(self) -> Views:
        """The newest photos with their cameras, and the empty table. Raises `InputError`."""
        views = []
        for number, camera in enumerate(self.given.cameras):
            file = self.given.backgrounds / f"{number}.png"
            if not file.is_file():
                raise InputError(
                    f"{file}: missing; clear the table and call {self._name('take_backgrounds')} once"
                )
            photo, background = self._photo(camera), read_image(file, camera.image)
            if photo.shape != background.shape:
                height, width = background.shape[:2]
                raise InputError(
                    f"{file}: {width} x {height} pixels, {camera.image} has {photo.shape[1]} x "
                    f"{photo.shape[0]}; clear the table and call {self._name('take_backgrounds')} again"
                )
            views.append(View(self._camera(camera, photo), photo, background, name=camera.image))
        scene = Views(tuple(views), self.given.workspace)
        check_scene(scene, "the cameras")
        return scene

    def _photo(self, camera: CameraTopics) -> Image:
        message = self._recent(camera.image)
        head = message.get("header")
        told = str(head.get("frame_id") or "").lstrip("/") if isinstance(head, dict) else ""
        if told not in ("", camera.frame):
            log.warning("%s: says that its frame is %s, not %s as given", camera.image, told, camera.frame)
        return photo_of(message, camera.image, camera.is_compressed)

    def _camera(self, camera: CameraTopics, photo: Image) -> Camera:
        world_from_camera = self._transforms.pose(self.given.world_frame, camera.frame)
        if world_from_camera is None:
            raise InputError(f"/tf does not join {self.given.world_frame} and {camera.frame}")
        message, _ = self._heard(camera.camera_info)
        matrix = intrinsics_of(message, camera.camera_info, photo, camera.is_rectified)
        return Camera(matrix, world_from_camera, photo.shape[1], photo.shape[0])

    def _heard(self, topic: str) -> tuple[Message, float]:
        if topic not in self._newest:
            raise InputError(f"{topic}: nothing came yet")
        return self._newest[topic]

    def _recent(self, topic: str) -> Message:
        message, came = self._heard(topic)
        if (age := time.monotonic() - came) > self.given.oldest_s:
            raise InputError(f"{topic}: the newest photo is {age:.1f} s old; at most {self.given.oldest_s:g}")
        return message

    def _keep_backgrounds(self) -> None:
        """The photos of now, as files, all of them or none. Raises `NeuGraspError`."""
        photos = [self._photo(camera) for camera in self.given.cameras]
        names = [f"{number}.png" for number in range(len(photos))]
        with whole_or_nothing(self.given.backgrounds, names) as part:
            for name, photo in zip(names, photos, strict=True):
                Picture.fromarray(photo).save(Path(part) / name, compress_level=4)


def _reason(error: Exception) -> str:
    """What a caller is told; of a mistake of ours the log says more."""
    if isinstance(error, NeuGraspError):
        return str(error)
    log.error("a request could not be answered", exc_info=error)
    return f"a mistake of the node ({type(error).__name__}); its log says more"


def _nameless(frame: str) -> dict[str, Any]:
    """A grasping_msgs/Object of which nothing is known but its frame."""
    return {
        "header": header(frame),
        "name": "",
        "support_surface": "",
        "properties": [],
        "point_cluster": cloud_of_nothing(frame),
        "primitives": [],
        "primitive_poses": [],
        "meshes": [],
        "mesh_poses": [],
        "surface": {"coef": [0.0, 0.0, 0.0, 0.0]},
    }


def cloud_of_nothing(frame: str) -> dict[str, Any]:
    """A sensor_msgs/PointCloud2 without points."""
    return {**cloud_of(NOTHING, frame), "fields": []}
