"""The one contract of everything that finds grasps: an observation in, a detection out."""

from __future__ import annotations

import base64
import time
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
from jaxtyping import Float

from neugrasp.data.fields import Fields
from neugrasp.data.whole_or_nothing import whole_or_nothing
from neugrasp.detection import files
from neugrasp.detection.notebook import as_html, in_short
from neugrasp.errors import InputError
from neugrasp.geometry.surface import Surface, surface_of
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasps
from neugrasp.gripper import Gripper
from neugrasp.observation import Views
from neugrasp.pictures import detection_picture, overlay_sheet, write_picture
from neugrasp.pictures.files import png

Seen = TypeVar("Seen", contravariant=True)
COUNTED = 10**9
"""Most candidates, or seconds, that a file may speak of."""


@dataclass(frozen=True, eq=False)
class Detection:
    """What a detector found. It stands alone: whoever holds it needs neither detector nor observation.

    Raises `ValueError` where the surface is not of the workspace's resolution.
    """

    grasps: Grasps
    """In the user's world, best first."""
    workspace: Workspace
    gripper: Gripper
    """The gripper that they are for."""
    tsdf: Float[np.ndarray, "r r r"] | None = None
    """In [-1, 1], indexed [x, y, z] in the workspace frame; None: the detector has no surface."""
    rejected: Mapping[str, int] = field(default_factory=dict)
    """How many candidates each rule rejected."""
    best_rejected: float | None = None
    """The best quality of any voxel near a surface, where the detector has one."""
    threshold: float | None = None
    """The quality below which nothing is a grasp, where the detector has one."""
    timing_s: Mapping[str, float] = field(default_factory=dict)
    """Seconds of each stage."""
    source: str = ""
    """Where the observation came from, as it says."""
    margin: float | None = None
    """How much less sure a grasp may be, to be carried out, than the best of those that are wanted and
    possible; None: any may."""

    def __post_init__(self) -> None:
        cube = (self.workspace.resolution,) * 3
        if self.tsdf is not None and self.tsdf.shape != cube:
            raise ValueError(f"a surface of shape {self.tsdf.shape}; the workspace has {cube} voxels")
        # The workspace knows which way is up, whoever made the grasps.
        object.__setattr__(self, "grasps", replace(self.grasps, up=self.workspace.up))

    def __repr__(self) -> str:
        return in_short(self)

    def _repr_html_(self) -> str:
        return as_html(self)

    def _repr_png_(self) -> bytes | None:
        """The surface with the best grasps, from the side; None without a surface."""
        if self.tsdf is None:
            return None
        return png(detection_picture(self.tsdf, self.workspace, self.grasps, self.gripper))

    def grid(self) -> Float[np.ndarray, "r r r"]:
        """The `tsdf`. Raises `InputError` where the detector has no surface."""
        if self.tsdf is None:
            raise InputError(
                f"{self.source or 'the detection'}: this detector finds grasps without a surface"
            )
        return self.tsdf

    def surface(self) -> Surface:
        """The mesh in the user's world. Raises `InputError` as `grid`."""
        return surface_of(self.grid(), self.workspace).moved(self.workspace.world_from_workspace)

    def to_dict(self, with_surface: bool = False) -> dict[str, Any]:
        """The content of grasps.json: plain data that JSON can hold, with the grid only if asked for."""
        facts: dict[str, Any] = {"scene": self.source} if self.source else {}
        facts |= {
            "gripper": self.gripper.name,
            "rejected": {reason: int(count) for reason, count in self.rejected.items()},
            "timing_s": {stage: float(seconds) for stage, seconds in self.timing_s.items()},
            "workspace": self.workspace.to_dict(),
            "gripper_file": self.gripper.to_dict(),
        }
        numbers = {name: getattr(self, name) for name in ("best_rejected", "threshold", "margin")}
        facts |= {name: float(number) for name, number in numbers.items() if number is not None}
        if with_surface and self.tsdf is not None:
            # The quickest level: the slowest one is a twentieth smaller and takes three times as long.
            grid = zlib.compress(np.ascontiguousarray(self.tsdf, dtype="<f4").tobytes(), level=1)
            facts["tsdf"] = base64.b64encode(grid).decode("ascii")
        return files.document(self.grasps, facts)

    @classmethod
    def from_dict(cls, data: Any, source: str = "a detection") -> Detection:
        """The reverse of `to_dict`. Raises `InputError` naming `source` and the field."""
        given = Fields(source, data)
        grasps = files.grasps_of(given)
        workspace = Workspace.from_dict(given.inside("workspace"))
        return cls(
            Grasps.of(grasps),
            workspace,
            Gripper.from_dict(given.inside("gripper_file")),
            _grid(given, workspace) if "tsdf" in given.data else None,
            {
                name: given.inside("rejected").whole(name, 0, COUNTED)
                for name in given.inside("rejected").data
            },
            given.number("best_rejected", 0, files.HIGHEST) if "best_rejected" in given.data else None,
            given.number("threshold", 0, 1) if "threshold" in given.data else None,
            given.inside("timing_s").each_number(0, COUNTED),
            given.text("scene") if "scene" in given.data else "",
            given.number("margin", 0, 1) if "margin" in given.data else None,
        )

    def save(self, folder: str | Path, views: Views | None = None) -> None:
        """grasps.json; where there is a surface, tsdf.npz and surface.ply; with `views`, overlay.png: the
        photos with the grasps. All of them or none; those of an earlier prediction go, all else stays.

        Raises `InputError` or `WriteError` where the folder cannot be written into.
        """
        with whole_or_nothing(Path(folder), files.FILES) as part:
            self.write(part, views)

    def write(self, folder: Path, views: Views | None = None) -> None:
        """The files of `save` into a folder that is there."""
        if views is not None:
            write_picture(folder / "overlay.png", overlay_sheet(views, self.grasps, self.gripper))
        if self.tsdf is not None:
            files.write_surface(folder / "surface.ply", self.surface())
            files.write_tsdf(folder / "tsdf.npz", self.tsdf, self.workspace)
        files.write_json(folder / "grasps.json", self.to_dict())


class Detector(Protocol[Seen]):
    """Anything that finds grasps. What it may see is the type of its argument: `Observation`, or, for
    measuring sticks, `Truth`. One detector serves many threads and many cells."""

    def detect(self, seen: Seen, /) -> Detection:
        """Ranked grasps of a scene, best first."""
        ...


class Stopwatch:
    """Seconds by stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Adds the time of the block to stage `name`."""
        start = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start


def _grid(given: Fields, workspace: Workspace) -> np.ndarray:
    shape = (workspace.resolution,) * 3
    size = 4 * workspace.resolution**3
    try:
        unpacked = zlib.decompressobj().decompress(
            base64.b64decode(given.text("tsdf"), validate=True), size + 1
        )
    except (ValueError, zlib.error) as error:
        raise given.refuse("tsdf", f"cannot be unpacked ({error})") from error
    if len(unpacked) != size:
        raise given.refuse("tsdf", f"holds {len(unpacked)} bytes; {shape} float32 have {size}")
    grid = np.frombuffer(unpacked, dtype="<f4").reshape(shape).astype(np.float32)
    if not np.all(np.isfinite(grid)):
        raise given.refuse("tsdf", "contains NaN or infinity")
    return grid
