"""From a grasps.json to a file of another program's format."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from neugrasp.data.whole_or_nothing import whole_or_nothing
from neugrasp.errors import InputError
from neugrasp.export import read_grasps
from neugrasp.exporters import graspnet, ros, vgn
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper, bundled

Format = Literal["graspnet", "vgn", "ros"]
SUFFIXES: dict[Format, tuple[str, ...]] = {
    "graspnet": (".npy",),
    "vgn": (".csv",),
    "ros": (".json", ".yaml", ".yml"),
}


def export_file(grasps: Path, out: Path, name: Format, gripper: str | None, stamp: ros.Stamp) -> int:
    """Writes the grasps of a grasps.json into `out`, whole or not at all; how many. Raises `InputError`.

    Without the name of a gripper, or its file, it is the one that the grasps were predicted for.
    """
    if out.suffix.lower() not in SUFFIXES[name]:
        raise InputError(f"{out}: {name} grasps are written as {' or '.join(SUFFIXES[name])}")
    if out.is_dir():
        raise InputError(f"{out}: is a folder; name a file")
    read = read_grasps(grasps)
    hand = Gripper.load(gripper or _predicted_for(grasps))
    with whole_or_nothing(out.parent) as part:
        export_grasps(part / out.name, read, name, hand, stamp)
    return len(read)


def _predicted_for(grasps: Path) -> str:
    """The name of the gripper in a grasps.json. Raises `InputError` where it has none, or an unknown one."""
    name = json.loads(grasps.read_text(encoding="utf-8")).get("gripper")
    if name not in bundled():
        what = "names no gripper" if name is None else f"is for the gripper {name!r}, which is not bundled"
        choice = " or ".join(bundled())
        raise InputError(f"{grasps}: {what}; name the gripper's file, or {choice}, with --gripper")
    return str(name)


def export_grasps(
    file: Path, grasps: Sequence[Grasp], name: Format, gripper: Gripper, stamp: ros.Stamp
) -> None:
    """Writes grasps in the format of a name; `stamp` is for ROS alone."""
    if name == "graspnet":
        graspnet.write(file, grasps, gripper)
    elif name == "vgn":
        vgn.write(file, grasps, gripper)
    else:
        ros.write(file, grasps, gripper, stamp)
