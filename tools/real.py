"""Scores on real photographs of measured objects: surfaces in millimetres, grasps executed on the meshes.

    python tools/real.py DIR --vgn vgn_conv.pth --json real.json --pictures pictures

DIR holds scene folders; beside scene.json each has ground_truth.json ("objects": a list of "id" and
"world_from_object"), and DIR/objects/ID.obj are the meshes in metres. With depth/0.png, ... (millimetres,
pixel for pixel those of the photos) VGN plays, too.

Columns: from points of the surface found to the visible measured one and back, above the table (median / 90 %
in mm); how much higher the upper ends of round objects were found (mm); how far from its axis the TCP of the
best grasp of each round object lies, and all grasps along the closing of the fingers (mm); widths (mm); SR.
An evaluator's grasps count where a robot would carry them out, at most its margin below the best.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from PIL import Image as Picture
from PIL import ImageDraw
from scipy.spatial import cKDTree

from judge import NUM_POINTS, Judge
from measured import Meshes, RealScene, Thing
from neugrasp.baselines.vgn import VgnDetector, VgnHead
from neugrasp.detection.contract import Detection
from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.errors import InputError
from neugrasp.geometry.fusion import fuse
from neugrasp.geometry.pose import Array, inverse
from neugrasp.geometry.surface import Surface, surface_of
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper
from neugrasp.metrics import wilson_interval
from neugrasp.observation import DepthViews
from neugrasp.pictures import draw_grasps, photo_of_workspace
from neugrasp.pictures.shading import free_where_unseen
from neugrasp.run_folder import source_commit

FORMATTER = argparse.RawDescriptionHelpFormatter
ABOVE_TABLE = 0.0075
"""Metres from which on a surface is an object's: a voxel."""


def fused_surface(depths: DepthViews) -> Surface:
    """What a depth camera measured, workspace frame."""
    workspace_from_world = inverse(depths.workspace.world_from_workspace)
    cameras = [view.camera.moved(workspace_from_world) for view in depths.frames]
    tsdf = fuse([view.depth for view in depths.frames], cameras, depths.workspace)
    return surface_of(free_where_unseen(tsdf.values), depths.workspace)


def sampled(surface: Surface, rng: np.random.Generator, count: int) -> Array:
    """Points (count, 3) drawn uniformly by area; none of an empty surface."""
    corners = surface.vertices[surface.faces]
    if not len(corners):
        return np.zeros((0, 3))
    a, b, c = np.moveaxis(corners, 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = rng.choice(len(area), size=count, p=area / area.sum())
    u, v = rng.random((2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return np.asarray(a[chosen] + u * (b - a)[chosen] + v * (c - a)[chosen])


def surface_errors(found: Array, truth: Array, scene: RealScene) -> dict[str, Any]:
    """Millimetres between points of the surface found and of the visible measured one, above the table."""
    lowest = scene.views.workspace.table_height + ABOVE_TABLE
    found_above, truth_above = found[found[:, 2] > lowest], truth[truth[:, 2] > lowest]
    if not len(found_above):
        return {"found_to_mesh": None, "mesh_to_found": None, "height": [], "points": 0}
    return {
        "found_to_mesh": _millimetres(cKDTree(truth).query(found_above)[0]),
        "mesh_to_found": _millimetres(cKDTree(found).query(truth_above)[0]),
        "height": [_height_error(thing, found_above, truth_above) for thing in scene.things if thing.axis],
        "points": len(found_above),
    }


def _millimetres(distances: Array) -> dict[str, float]:
    return {"median": 1000 * float(np.median(distances)), "p90": 1000 * float(np.quantile(distances, 0.9))}


def _height_error(thing: Thing, found: Array, truth: Array) -> float | None:
    """Of the middle of its upper end, millimetres, positive where found too high; None where not found."""
    # The highest points but for outliers: glass may have more than one surface below.
    near = 0.25 * float(np.sort(thing.mesh.extents)[0])
    tops = []
    for points in (found, truth):
        inside = points[np.linalg.norm(thing.from_axis(points), axis=1) < near]
        tops.append(float(np.quantile(inside[:, 2], 0.98)) if len(inside) else None)
    return None if tops[0] is None or tops[1] is None else 1000 * (tops[0] - tops[1])


def judged(judge: Judge, surface: Surface, detection: Detection) -> dict[str, Any]:
    """Everything about one detector in one scene; `surface` is in the workspace frame."""
    found = sampled(surface, np.random.default_rng(0), NUM_POINTS)
    workspace_from_world = inverse(judge.scene.views.workspace.world_from_workspace)
    margin = 1 if detection.margin is None else detection.margin
    least = detection.grasps[0].score - margin if detection.grasps else 0
    grasps = [
        judge.grasp(grasp.moved(workspace_from_world)) | {"good_enough": grasp.score >= least}
        for grasp in detection.grasps
    ]
    return {"surface": surface_errors(found, judge.truth, judge.scene), "grasps": grasps}


def picture(scene: RealScene, grasps: Sequence[Grasp], gripper: Gripper) -> Picture.Image:
    """All photos with the measured meshes as dots, and the best grasps."""
    tiles = []
    for view in scene.views.frames:
        crop = photo_of_workspace(view, scene.views.workspace, 640)
        photo = Picture.fromarray(draw_grasps(crop, grasps[:3], gripper, 1))
        pen = ImageDraw.Draw(photo)
        for thing in scene.things:
            in_world = scene.views.workspace.to_world(thing.vertices[::5])
            pen.point(
                [tuple(p) for p in (crop.camera.project(in_world)[0] + 0.5).tolist()], fill=(255, 0, 255)
            )
        tiles.append(photo)
    sheet = Picture.new("RGB", (sum(t.width for t in tiles), max(t.height for t in tiles)))
    for i, tile in enumerate(tiles):
        sheet.paste(tile, (sum(t.width for t in tiles[:i]), 0))
    return sheet


def table_of(results: dict[str, dict[str, Any]]) -> str:
    """A row for each detector and scene, and one for all scenes of a detector."""
    head = (
        "detector",
        "scene",
        "found to mesh",
        "mesh to found",
        "height",
        "best off axis",
        "sideways",
        "width",
        "SR",
    )
    rows = []
    for detector, scenes in results.items():
        rows += [(detector, name, *_cells([result])) for name, result in scenes.items()]
        rows.append((detector, "all", *_cells(list(scenes.values()))))
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def _cells(results: list[dict[str, Any]]) -> tuple[str, ...]:
    surfaces = [result["surface"] for result in results if result["surface"]["points"]]
    grasps = [grasp for result in results for grasp in result["grasps"] if grasp["good_enough"]]
    heights = [h for s in surfaces for h in s["height"] if h is not None]
    held = sum(grasp["reason"] == "success" for grasp in grasps)
    low, high = wilson_interval(held, len(grasps))
    return (
        *(
            _range([(s[way]["median"], s[way]["p90"]) for s in surfaces])
            for way in ("found_to_mesh", "mesh_to_found")
        ),
        _span(heights, "+.1f"),
        _span(_best_off_axis(results), ".1f"),
        _span([g["sideways_mm"] for g in grasps if "sideways_mm" in g], ".1f"),
        _span([g["width_mm"] for g in grasps], ".0f"),
        f"{held} of {len(grasps)} ({100 * low:.0f} to {100 * high:.0f} %)" if grasps else "no grasp",
    )


def _best_off_axis(results: list[dict[str, Any]]) -> list[float]:
    """Of the best grasp of each round object, best first as grasps are."""
    best: dict[tuple[int, int], float] = {}
    for i, result in enumerate(results):
        for grasp in result["grasps"]:
            if "object" in grasp:
                best.setdefault((i, grasp["object"]), grasp["off_axis_mm"])
    return list(best.values())


def _range(values: list[tuple[float, float]]) -> str:
    return " / ".join(f"{np.mean([v[i] for v in values]):.1f}" for i in range(2)) if values else "-"


def _span(values: list[float], form: str) -> str:
    if not values:
        return "-"
    low, high = f"{min(values):{form}}", f"{max(values):{form}}"
    return low if low == high else f"{low} to {high}"


def score(args: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """Results by detector and scene."""
    folders = sorted(path.parent for path in args.dir.glob("*/ground_truth.json"))
    if not folders:
        raise InputError(f"{args.dir}: holds no folder with a ground_truth.json")
    gripper = Gripper.load("panda")
    detectors = {
        "neugrasp": NeuGraspDetector.load(args.weights),
        "neugrasp-evaluator": NeuGraspDetector.load(args.weights, evaluator=args.evaluator),
    }
    vgn = VgnDetector(VgnHead.load(str(args.vgn)), gripper) if args.vgn else None
    results: dict[str, dict[str, Any]] = defaultdict(dict)
    with TemporaryDirectory() as temporary:
        meshes = Meshes(args.dir / "objects", Path(temporary))
        for folder in folders:
            scene = RealScene.read(folder, meshes)
            judge = Judge(scene, meshes, gripper)
            physics = {"lifted_mm": judge.lifted_mm, "settled_mm": judge.settled_mm}
            for name, detector in detectors.items():
                detection = detector.detect(scene.views)
                surface = surface_of(detection.grid(), scene.views.workspace)
                results[name][scene.name] = judged(judge, surface, detection) | physics
                if args.pictures:
                    args.pictures.mkdir(parents=True, exist_ok=True)
                    shown = picture(scene, detection.grasps, gripper)
                    shown.save(args.pictures / f"{scene.name}_{name}.png")
            if vgn and scene.depths:
                depths = scene.depth_views()
                found = judged(judge, fused_surface(depths), vgn.detect(depths))
                results["vgn on measured depth"][scene.name] = found | physics
            judge.world.close()
    return results


def main() -> None:
    """Prints the table and writes what was asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dir", type=Path)
    parser.add_argument("--weights", default="neugrasp", help="a name of bundled weights, or a file")
    parser.add_argument("--evaluator", default="neugrasp", help="a name of a bundled evaluator, or a file")
    parser.add_argument("--vgn", type=Path, help="vgn_conv.pth of github.com/ethz-asl/vgn")
    parser.add_argument("--json", type=Path, help="where all numbers are written")
    parser.add_argument("--pictures", type=Path, help="a folder for photos with meshes and grasps")
    args = parser.parse_args()
    try:
        results = score(args)
    except InputError as error:
        raise SystemExit(f"error: {error}") from error
    print(table_of(results))
    if args.json:
        data = {"weights": Path(args.weights).name, "commit": source_commit(), "results": results}
        args.json.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
