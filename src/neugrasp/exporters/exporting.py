"""From a grasps.json to a file of another program's format."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from neugrasp.detection.files import FILES, read_grasp_list
from neugrasp.errors import InputError
from neugrasp.exporters import graspnet, ros, ur, vgn
from neugrasp.exporters.command import Export
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper, bundled
from neugrasp.output import whole_file

log = logging.getLogger(__name__)

Format = Literal["graspnet", "vgn", "ros", "ur"]
SUFFIXES: dict[Format, tuple[str, ...]] = {
    "graspnet": (".npy",),
    "vgn": (".csv",),
    "ros": (".json", ".yaml", ".yml"),
    "ur": (".json",),
}


def run(config: Export) -> str:
    """`neugrasp export`: how many grasps were written."""
    for option, value, formats in (
        ("--frame-id", config.frame_id, ["ros"]),
        ("--link", config.link, ["ros", "ur"]),
    ):
        if value is not None and config.format not in formats:
            wanted = " and ".join(formats)
            raise InputError(f"{option} is for --format {wanted}; {config.format} files hold no such name")
    stamp = ros.Stamp(config.frame_id or "world", config.link or "tcp")
    grasps = config.grasps / FILES[0] if config.grasps.is_dir() else config.grasps
    out = config.out or grasps.with_name(f"{grasps.stem}_{config.format}{SUFFIXES[config.format][0]}")
    count = export_file(grasps, out, config.format, config.gripper, stamp)
    return f"{count} grasps in {out}\nnext: docs/conventions.md, Grasps elsewhere, says how to read them"


def export_file(grasps: Path, out: Path, name: Format, gripper: str | None, stamp: ros.Stamp) -> int:
    """Writes the grasps of a grasps.json into `out`, whole or not at all; how many. Raises `InputError`.

    Without the name of a gripper, or its file, it is the one that the grasps were predicted for.
    """
    if out.suffix.lower() not in SUFFIXES[name]:
        raise InputError(f"{out}: {name} grasps are written as {' or '.join(SUFFIXES[name])}")
    found = read_grasp_list(grasps)
    hand = _hand(grasps, found.gripper, gripper)
    if name in ("ros", "ur") and not found.knows_up:
        log.warning(
            "%s: does not say which way is up, as an older prediction: z is taken; after grasps from the "
            "side the hand retreats along it",
            grasps,
        )
    with whole_file(out, inputs=[grasps, *([] if gripper is None else [Path(gripper)])]) as part:
        export_grasps(part, found.grasps, name, hand, stamp)
    return len(found.grasps)


def _hand(grasps: Path, found_for: str | None, given: str | None) -> Gripper:
    """The gripper of a grasps.json: as given, else the one that it names. Raises `InputError` where it names
    none that is known; says so where another one is given."""
    if given is not None:
        hand = Gripper.load(given)
        if found_for not in (None, hand.name):
            log.warning(
                "%s: its grasps were found for the gripper %r, not for %r: the TCP of either is put in "
                "the same place, but whether the other hand fits there was not looked at",
                grasps,
                found_for,
                hand.name,
            )
        return hand
    if found_for not in bundled():
        unknown = f"is for the gripper {found_for!r}, which is not bundled"
        what = "names no gripper" if found_for is None else unknown
        choice = " or ".join(bundled())
        raise InputError(f"{grasps}: {what}; name the gripper's file, or {choice}, with --gripper")
    return Gripper.load(str(found_for))


def export_grasps(
    file: Path, grasps: Sequence[Grasp], name: Format, gripper: Gripper, stamp: ros.Stamp
) -> None:
    """Writes grasps in the format of a name; `stamp` is for ROS, its link for UR, too. Raises `InputError`
    where there is no such link."""
    if name == "graspnet":
        graspnet.write(file, grasps, gripper)
    elif name == "vgn":
        vgn.write(file, grasps, gripper)
    elif name == "ur":
        if stamp.link == "panda_link8":
            raise InputError("--link panda_link8: is of the Panda; for --format ur give tcp or hand")
        ur.write(file, grasps, gripper, stamp.link)
    else:
        ros.write(file, grasps, gripper, stamp)
