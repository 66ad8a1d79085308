"""The systems of the paper's first table: their names, how they are played here, what they reached."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from neugrasp.detection.options import DetectorOptions
from neugrasp.errors import InputError


@dataclass(frozen=True)
class ComparedMethod:
    """A detector as a row of the table."""

    detector: str
    title: str
    """What the paper calls it."""
    depth: Literal["exact", "stereo"] = "exact"
    """The sensor of one that sees depth."""
    borrows: str | None = None
    """The detector whose weights it takes where it is given none of its own."""
    most_rounds: int | None = None
    """So many rounds at most, where one takes minutes."""
    paper_s: float | None = None
    """Seconds from photos to grasps that the paper reports, on a GPU."""


COMPARED_METHODS = {
    one.detector: one
    for one in (
        ComparedMethod("neugrasp", "NeuGrasp", paper_s=0.274),
        ComparedMethod("vgn", "VGN", depth="stereo"),
        ComparedMethod("swindr-vgn", "SwinDR-VGN", depth="stereo", borrows="vgn"),
        ComparedMethod("graspnerf-tsdf", "GraspNeRF with TSDF"),
        ComparedMethod("graspnerf", "GraspNeRF without TSDF"),
        ComparedMethod("rgbgrasp-gt", "RGBGrasp-GT", borrows="vgn", most_rounds=30, paper_s=56.7),
    )
}

_PAPER = """
vgn            packed transparent-specular random 27.4 21.0 18.0 0.273
vgn            packed transparent-specular top    12.7 10.0  7.3 0.288
vgn            packed diffuse              random 47.9 40.5 36.7 0.205
vgn            packed diffuse              top    44.5 46.2 27.8 0.222
swindr-vgn     packed transparent-specular random 40.8 43.0 35.6 0.239
swindr-vgn     packed transparent-specular top    46.0 40.0 39.1 0.240
swindr-vgn     packed diffuse              random 66.0 57.8 55.8 0.204
swindr-vgn     packed diffuse              top    46.0 39.5 38.1 0.234
graspnerf-tsdf packed transparent-specular random 84.2 85.5 80.3 0.110
graspnerf-tsdf packed transparent-specular top    76.3 80.5 76.6 0.113
graspnerf-tsdf packed diffuse              random 74.2 79.9 75.7 0.112
graspnerf-tsdf packed diffuse              top    81.5 93.5 81.1 0.112
graspnerf      packed transparent-specular random 47.6 54.0 50.2 0.894
graspnerf      packed transparent-specular top    50.4 64.5 44.8 0.895
graspnerf      packed diffuse              random 43.3 52.8 43.9 0.897
graspnerf      packed diffuse              top    46.9 61.4 43.1 0.897
rgbgrasp-gt    packed transparent-specular random 36.2 23.0 18.9 0.807
rgbgrasp-gt    packed transparent-specular top    25.5 14.5 12.9 0.811
rgbgrasp-gt    packed diffuse              random 42.7 40.0 33.1 0.745
rgbgrasp-gt    packed diffuse              top    36.3 42.0 22.4 0.733
neugrasp       packed transparent-specular random 86.3 86.0 81.0 0.153
neugrasp       packed transparent-specular top    86.8 92.0 79.1 0.155
neugrasp       packed diffuse              random 88.3 86.0 81.0 0.152
neugrasp       packed diffuse              top    90.3 94.5 82.9 0.154
neugrasp       pile   transparent-specular random 65.2 67.5 45.6 0.164
neugrasp       pile   diffuse              random 65.3 64.5 43.2 0.171
"""
PAPER = {
    tuple(words[:4]): " / ".join(words[4:])
    for words in (line.split() for line in _PAPER.strip().splitlines())
}
"""SR / FSR / DR / L1 of the NeuGrasp paper's tables I and III by detector, scene, materials and strategy: its
own rules, the released views, the depth of a stereo sensor, for RGBGrasp-GT exact depth."""


def compared_method(detector: str) -> ComparedMethod:
    """The row of a detector, by name or package.module:NAME."""
    return COMPARED_METHODS.get(detector, ComparedMethod(detector, detector))


@dataclass(frozen=True)
class GivenWeights:
    """Files of weights for detectors, as words NAME=FILE. Raises `InputError` on another word."""

    words: Sequence[str]

    def __post_init__(self) -> None:
        for word in self.words:
            if not all(word.partition("=")):
                raise InputError(f"--weights {word}: give a detector and a file, as vgn=vgn_conv.pth")

    def of(self, detector: str) -> str:
        """Those of a detector, or of whom it borrows them; by default the detector's own."""
        given = dict(word.split("=", 1) for word in self.words)
        for name in (detector, compared_method(detector).borrows):
            if name in given:
                return str(Path(given[name]))
        return DetectorOptions.weights
