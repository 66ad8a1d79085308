"""The command of the node."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from neugrasp.client import Client
from neugrasp.detection.contract import Detection
from neugrasp.detection.registry import load_detector
from neugrasp.doctor.examination import examine_read
from neugrasp.doctor.findings import Level
from neugrasp.errors import InputError, require
from neugrasp.gripper import Gripper
from neugrasp.observation import Views
from neugrasp.ros.command import Ros
from neugrasp.ros.node import Node
from neugrasp.ros.parameters import Parameters, read_parameters, write_parameters
from neugrasp.terminal import next_step

log = logging.getLogger(__name__)


def run(config: Ros) -> str | None:
    """`neugrasp ros`: serves until Ctrl-C, or writes parameters to begin with."""
    if config.write:
        write_parameters(config.parameters)
        return f"{config.parameters}\n{next_step('ros', config.parameters, why='when it says what you have')}"
    given = read_parameters(config.parameters)
    require("websockets", extra="ros")
    gripper = Gripper.load(given.gripper)
    node = Node(given, gripper, detecting(given))
    log.info("listening to %d cameras through %s", len(given.cameras), given.bridge)
    asyncio.run(node.bridge.run())
    return None


def detecting(given: Parameters) -> Callable[[Views], Detection]:
    """What finds grasps, with the doctor's quick look before; here, or on a server."""
    if given.server is None:
        local = load_detector(weights=given.weights, gripper=given.gripper, device=given.device)
        return examined(local.detect)
    client = Client(given.server)
    return examined(client.detect)


def examined(detect: Callable[[Views], Detection]) -> Callable[[Views], Detection]:
    """The same, refusing where the doctor says red."""

    def careful(views: Views) -> Detection:
        diagnosis = examine_read(views, tags=())
        if diagnosis.level == Level.RED:
            raise InputError("\n".join(["the doctor says red", *diagnosis.lines(Level.RED)]))
        for line in diagnosis.lines(Level.YELLOW):
            log.warning("%s", line)
        return detect(views)

    return careful
