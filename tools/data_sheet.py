"""What a data set holds: counts, balance of labels and materials, and pictures of some scenes.

python tools/data_sheet.py --data DIR [DIR ...] --out DIR
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from PIL import Image as Picture
from PIL import ImageDraw, ImageFont
from scipy.spatial.transform import Rotation

from neugrasp.data.records import Record
from neugrasp.data.scene_sets import open_scenes
from neugrasp.data.whole_or_nothing import whole_or_nothing
from neugrasp.errors import NeuGraspError
from neugrasp.observation import Image
from neugrasp.pictures import Tile, contact_sheet, write_picture
from neugrasp.progress import counted

TEXT, SCENES, BALANCE = "data_sheet.md", "scenes.jpg", "balance.png"
NUM_SCENES = 3
"""Scenes of each folder that are shown."""
MATERIALS = ("diffuse", "specular", "transparent")
STEEP, FLAT = 30.0, 60.0
"""Degrees between the approach and straight down that part grasps from above from those from the side."""
SPREAD = (10, 50, 90)
"""Percentiles."""
SIZE = (420, 200)
"""Pixels of a chart."""
BARS = 30
BAR, INK, PAPER = (70, 110, 160), (40, 40, 40), (255, 255, 255)


@dataclass
class Counts:
    """Of the records of one folder, added up one by one."""

    scenes: int = 0
    with_photos: int = 0
    photos: int = 0
    cells: set[int] = field(default_factory=set)
    objects: int = 0
    materials: Counter[str] = field(default_factory=Counter)
    views: Counter[str] = field(default_factory=Counter)
    pixels: Counter[str] = field(default_factory=Counter)
    """Of the input photos: "all", "object"."""
    voxels: Counter[str] = field(default_factory=Counter)
    """Observed ones above the table: "all", "inside"."""
    positives: list[int] = field(default_factory=list)
    """Successful grasps of each scene."""
    trials: int = 0
    widths: list[float] = field(default_factory=list)
    """Of successful grasps, metres."""
    angles: list[float] = field(default_factory=list)
    """Of successful grasps, between the approach and straight down, degrees."""

    def add(self, record: Record) -> None:
        """Counts a record."""
        workspace, labels = record.workspace, record.labels
        self.scenes += 1
        self.objects += len(record.scene.bodies)
        self.materials.update(record.materials)
        if record.has_photos:
            self.with_photos += 1
            self.photos += len(record.images) + len(record.targets)
            self.cells.add(int(record.cell.get("index", 0)))
            self.views[str(record.cell.get("views", "unknown"))] += 1
            self.pixels.update(all=record.masks.size, object=int((record.masks > 0).sum()))
        above = record.observed & (workspace.voxel_centres()[..., 2] > workspace.table_height)
        self.voxels.update(all=int(above.sum()), inside=int((above & (record.tsdf < 0)).sum()))
        self.positives.append(int(labels.success.sum()))
        self.trials += len(labels.success)
        if labels.success.any():
            self.widths += labels.widths[labels.success].tolist()
            approach = Rotation.from_quat(labels.quaternions[labels.success]).apply((0.0, 0.0, 1.0))
            self.angles += np.degrees(np.arccos(np.clip(-approach[:, 2], -1, 1))).tolist()


def write_data_sheet(folders: Sequence[Path], out: Path) -> Path:
    """Writes data_sheet.md, scenes.jpg and balance.png into `out`, all or none; the first one's path.

    Raises `InputError` where a folder holds no records or a damaged one.
    """
    counts: dict[str, Counts] = {}
    tiles: list[Tile] = []
    with whole_or_nothing(out, (TEXT, BALANCE, SCENES)) as temporary:
        for folder in folders:
            mine = counts.setdefault(_name(folder, counts), Counts())
            shown = 0
            records = open_scenes(folder)
            for index in counted(range(len(records)), "scenes"):
                record = records.read(index, trials=False)
                mine.add(record)
                if record.has_photos and shown < NUM_SCENES:
                    tiles += _pictures(record)
                    shown += 1
        (temporary / TEXT).write_text("\n".join(sheet(counts, bool(tiles))) + "\n", encoding="utf-8")
        write_picture(temporary / BALANCE, _charts(counts))
        if tiles:
            write_picture(temporary / SCENES, contact_sheet(tiles, columns=4))
    return out / TEXT


def _name(folder: Path, taken: Mapping[str, Counts]) -> str:
    name = folder.resolve().name
    return name if name not in taken else str(folder)


def sheet(counts: Mapping[str, Counts], has_pictures: bool) -> list[str]:
    """The lines of the page."""
    rows: dict[str, list[str]] = {}
    for one in counts.values():
        for name, value in _facts(one).items():
            rows.setdefault(name, []).append(value)
    total = sum(one.scenes for one in counts.values())
    return [
        "# Data sheet",
        "",
        f"{total} scenes, {sum(one.with_photos for one in counts.values())} of them with photos.",
        "",
        "| | " + " | ".join(counts) + " |",
        "|---|" + "---|" * len(counts),
        *(f"| {name} | " + " | ".join(values) + " |" for name, values in rows.items()),
        "",
        f"![Successes of a scene, their widths, and their angles to straight down]({BALANCE})",
        *(["", f"![Photos and their backgrounds]({SCENES})"] if has_pictures else []),
    ]


def _facts(one: Counts) -> dict[str, str]:
    total = max(1, sum(one.materials.values()))
    steep = sum(angle < STEEP for angle in one.angles)
    flat = sum(angle > FLAT for angle in one.angles)
    angles = (steep, len(one.angles) - steep - flat, flat)
    return {
        "scenes": str(one.scenes),
        "of them with photos": str(one.with_photos),
        "photos, without backgrounds": str(one.photos),
        "work cells": str(len(one.cells)),
        "views": ", ".join(sorted(one.views)) or "-",
        "objects a scene": f"{one.objects / one.scenes:.1f}",
        **{f"{kind} objects": f"{100 * one.materials[kind] / total:.0f} %" for kind in MATERIALS},
        "objects' share of the input photos": _share(one.pixels["object"], one.pixels["all"]),
        "inside objects, of what is observed above the table": _share(
            one.voxels["inside"], one.voxels["all"]
        ),
        "grasp points tried": str(one.trials),
        "of them successful": _share(sum(one.positives), one.trials),
        "successes a scene, 10, 50, 90 %": _spread(one.positives, 1, 0),
        "scenes without any": str(sum(count == 0 for count in one.positives)),
        "widths of successes, mm, 10, 50, 90 %": _spread(one.widths, 1000, 0),
        f"successes within {STEEP:.0f} deg of straight down, between, beyond {FLAT:.0f} deg": ", ".join(
            _share(count, len(one.angles)) for count in angles
        ),
    }


def _share(part: int, whole: int) -> str:
    return f"{100 * part / whole:.1f} %" if whole else "-"


def _spread(values: Sequence[float], scale: float, digits: int) -> str:
    if not values:
        return "-"
    return ", ".join(f"{scale * value:.{digits}f}" for value in np.percentile(values, SPREAD))


def _pictures(record: Record) -> list[Tile]:
    kinds = Counter(record.materials)
    content = ", ".join(f"{kinds[kind]} {kind[:4]}." for kind in MATERIALS if kinds[kind])
    return [
        Tile(record.images[0], record.name),
        Tile(record.backgrounds[0], "its background"),
        Tile(record.targets[0], "a target view"),
        Tile(_masks(record), content),
    ]


def _masks(record: Record) -> Image:
    """The objects of the first photo in the colour of their material."""
    colours = {"diffuse": (150, 120, 90), "specular": (200, 200, 90), "transparent": (90, 160, 220)}
    picture = np.full((*record.masks[0].shape, 3), 235, np.uint8)
    for index, kind in enumerate(record.materials):
        picture[record.masks[0] == index + 1] = colours[kind]
    return picture


def _charts(counts: Mapping[str, Counts]) -> Image:
    tiles = []
    for name, one in counts.items():
        widths = [1000 * width for width in one.widths]
        # Every bar of whole numbers stands for as many of them.
        most = BARS * max(1, -(-max(one.positives) // BARS))
        tiles += [
            Tile(_bars(one.positives, most), f"{name}: successes a scene"),
            Tile(_bars(widths, 90), f"{name}: width of successes, mm"),
            Tile(_bars(one.angles, 120), f"{name}: degrees from straight down"),
        ]
    return contact_sheet(tiles, columns=3)


def _bars(values: Iterable[float], high: int) -> Image:
    """A histogram from 0 to a value that is written under its end."""
    heights, _ = np.histogram(list(values), bins=BARS, range=(0, high))
    width, height = SIZE
    picture = Picture.new("RGB", SIZE, PAPER)
    pen, font = ImageDraw.Draw(picture), ImageFont.load_default(14)
    floor, step = height - 22, width / BARS
    for index, value in enumerate(heights.tolist()):
        top = floor - (floor - 8) * value / max(1, int(heights.max()))
        if value:
            pen.rectangle((index * step + 1, top, (index + 1) * step - 1, floor), fill=BAR)
    pen.line((0, floor + 1, width, floor + 1), fill=INK)
    pen.text((2, floor + 4), "0", fill=INK, font=font)
    pen.text((width - 2, floor + 4), str(high), fill=INK, font=font, anchor="ra")
    return np.asarray(picture)


def main(words: Sequence[str] | None = None) -> int:
    """Writes data_sheet.md and its two pictures, all or none, and prints its name; 2 where it cannot."""
    parser = argparse.ArgumentParser(description="Counts, balance and pictures of generated scenes.")
    parser.add_argument("--data", type=Path, nargs="+", required=True, help="each has a column; shards, too")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args(words)
    try:
        print(write_data_sheet(options.data, options.out))
    except (NeuGraspError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
