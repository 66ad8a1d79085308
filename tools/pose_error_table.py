"""What wrong cameras cost: grasps executed in simulation, over the size of the error.

    python tools/pose_error_table.py OUT.jsonl --rounds 10

Each round is photographed once, on a patterned and on a plain table. The detector then gets the photos with
cameras or a cube that are wrong by so much, and its best grasps are executed in the true world, each with all
objects at their places. Lines are appended to OUT.jsonl as they are done; what is there is not done again.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.evaluation.protocols import protocol_of
from neugrasp.evaluation.rounds import Round, Rounds
from neugrasp.geometry.pose import Array, rigid, rotation_about
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper
from neugrasp.metrics import wilson_interval
from neugrasp.observation import View, Views
from neugrasp.robot.pick import pick
from neugrasp.robot.simulated import SimulatedRobot
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.simulation.physics import World
from neugrasp.simulation.renderer import Renderer, RenderSettings
from neugrasp.simulation.textures import sample_texture

MARGIN, SIZE = 1.3, 333
"""Photos show more than the network's crop, which wrong cameras move: 1.3 times as much."""
PATTERNS = {"patterned": ("wood", "tiles", "checker", "marble", "speckled", "cells"), "plain": ("plain",)}


@dataclass(frozen=True)
class Error:
    """What is wrong with what the detector is told."""

    deg: float = 0.0
    """Of the hand-eye rotation, about an axis that is drawn for each round."""
    mm: float = 0.0
    """Of the hand-eye translation, in a direction that is drawn for each round."""
    height_mm: float = 0.0
    """By which the cube stands too high."""
    focal: float = 1.0
    """By which the focal length is multiplied."""

    @property
    def name(self) -> str:
        """For people."""
        parts = {
            "deg": f"{self.deg:g} deg",
            "mm": f"{self.mm:g} mm",
            "height_mm": f"height {self.height_mm:g} mm",
            "focal": f"focal length x {self.focal:g}",
        }
        return (
            ", ".join(text for key, text in parts.items() if getattr(self, key) != getattr(Error, key))
            or "none"
        )

    def applied(self, views: Views, rng: np.random.Generator) -> Views:
        """The same photos with what a user would say of them."""
        axis, way = rng.normal(size=(2, 3))
        wrong = rigid(rotation_about(axis, np.deg2rad(self.deg)), self.mm / 1000 * way / np.linalg.norm(way))
        scale = np.diag([self.focal, self.focal, 1.0])

        def told(view: View) -> View:
            camera = view.camera
            intrinsics = camera.intrinsics.copy()
            intrinsics[:2, :2] = (scale @ intrinsics)[:2, :2]
            pose = camera.world_from_camera @ wrong
            return replace(view, camera=replace(camera, intrinsics=intrinsics, world_from_camera=pose))

        up = rigid(translation=(0, 0, self.height_mm / 1000))
        workspace = replace(views.workspace, world_from_workspace=up @ views.workspace.world_from_workspace)
        return Views(tuple(told(view) for view in views.frames), workspace)


ERRORS = (
    Error(),
    *(Error(deg=deg) for deg in (0.2, 0.5, 1, 2, 4)),
    *(Error(mm=mm) for mm in (2, 5, 10)),
    *(Error(height_mm=mm) for mm in (5, 10, 20)),
    *(Error(focal=focal) for focal in (1.02, 1.05, 1.1, 2.0)),
    Error(deg=0.2, mm=1),
    Error(deg=0.5, mm=2),
)


@dataclass(frozen=True)
class Play:
    """What all rounds share."""

    rounds: Rounds
    world: World
    detector: NeuGraspDetector
    renderer: Renderer
    library: ObjectLibrary
    grasps: int

    def lines(self, index: int, table: str, errors: list[Error]) -> Iterator[dict[str, Any]]:
        """What came of a round on a table, under each of the errors."""
        played = self.rounds.make(index, self.world)
        views = self._photographed(played, table, index)
        for error in errors:
            told = error.applied(views, np.random.default_rng([index, 31]))
            grasps = self.detector.detect(told).grasps
            picks = [self._reason(played, grasp) for grasp in grasps[: self.grasps]]
            yield {
                "round": index,
                "table": table,
                "error": error.name,
                "found": len(grasps),
                "reasons": picks,
            }

    def _photographed(self, played: Round, table: str, index: int) -> Views:
        workspace = self.world.workspace
        cameras = tuple(
            c.cropped_and_resized(_widened(workspace.photo_box(c)), SIZE, SIZE) for c in played.sensors
        )
        texture = sample_texture(np.random.default_rng([index, 32]), PATTERNS[table], flat=True)
        cell = replace(played.cell, cameras=cameras, table={**played.cell.table, "texture": texture})
        numbers = range(len(cameras))
        photos = [self.renderer.render(cell, scene, self.library, numbers) for scene in (played.scene, None)]
        views = tuple(
            View(c, a, b, name=f"view {i}") for i, a, b, c in zip(numbers, *photos, cameras, strict=True)
        )
        return Views(views, workspace)

    def _reason(self, played: Round, grasp: Grasp) -> str:
        robot = SimulatedRobot(self.world, played.scene)
        opening = protocol_of("paper").min_opening * robot.max_opening
        return pick(robot, robot, grasp, opening, np.array([0.0, 0.0, 1.0])).reason


def _widened(box: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    corners: Array = np.array(box).reshape(2, 2)
    middle = corners.mean(axis=0)
    left, top, right, bottom = (middle + MARGIN * (corners - middle)).ravel().tolist()
    return left, top, right, bottom


def table_of(lines: list[dict[str, Any]]) -> str:
    """SR in percent, its 95 % interval, how often it was tried, and the rounds without a grasp."""
    cells: dict[tuple[str, str], list[dict[str, Any]]] = defaultdict(list)
    for line in lines:
        cells[line["error"], line["table"]].append(line)
        cells[line["error"], "both"].append(line)
    tables = (*PATTERNS, "both")
    rows = ["| error | " + " | ".join(tables) + " |", "|---" * (len(tables) + 1) + "|"]
    for name in dict.fromkeys(line["error"] for line in lines):
        rows.append(f"| {name} | " + " | ".join(_cell(cells[name, table]) for table in tables) + " |")
    return "\n".join(rows)


def _cell(lines: list[dict[str, Any]]) -> str:
    reasons = [reason for line in lines for reason in line["reasons"]]
    if not reasons:
        return f"no grasp in {len(lines)} rounds"
    held = reasons.count("success")
    low, high = wilson_interval(held, len(reasons))
    silent = sum(not line["found"] for line in lines)
    text = f"{100 * held / len(reasons):.0f} ({100 * low:.0f} to {100 * high:.0f}), {held} of {len(reasons)}"
    return text + (f"; {silent} of {len(lines)} rounds without a grasp" if silent else "")


def main() -> None:
    """Plays what is missing and prints the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--rounds", type=int, default=10, help="0 prints the table of what is there")
    parser.add_argument("--kind", default="packed", choices=("packed", "pile"))
    parser.add_argument("--grasps", type=int, default=3, help="executed of each detection, best first")
    parser.add_argument("--weights", default="neugrasp")
    parser.add_argument("--samples", type=int, default=4)
    args = parser.parse_args()
    lines = [json.loads(line) for line in args.out.read_text().splitlines()] if args.out.exists() else []
    done = {(line["round"], line["table"], line["error"]) for line in lines}
    library = ObjectLibrary.open(("pybullet", "glassware"))
    rounds = Rounds(args.kind, 0, library, "transparent-specular", "released")
    detector = NeuGraspDetector.load(args.weights)
    settings = RenderSettings(samples=args.samples)
    with World(Workspace(), library, Gripper.load("panda")) as world, Renderer(1, settings) as renderer:
        play = Play(rounds, world, detector, renderer, library, args.grasps)
        for index in range(args.rounds):
            for table in PATTERNS:
                missing = [error for error in ERRORS if (index, table, error.name) not in done]
                for line in play.lines(index, table, missing) if missing else ():
                    lines.append(line)
                    with args.out.open("a") as file:
                        file.write(json.dumps(line) + "\n")
    print(table_of(lines))


if __name__ == "__main__":
    main()
