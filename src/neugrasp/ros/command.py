"""`neugrasp ros` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar


@dataclass(frozen=True)
class Ros:
    """Offers grasps to ROS 2 through a rosbridge, without ROS on this machine (docs/ros.md).

    Needs the extra `ros`: pip install 'neugrasp[ros]'.
    """

    doing: ClassVar[str] = "reading the parameters"

    parameters: Path
    """A JSON file: the bridge, cameras with their topics, the workspace, the link of the grasps."""
    write: bool = False
    """Write that file with the parameters of four cameras, to be changed, and end."""
