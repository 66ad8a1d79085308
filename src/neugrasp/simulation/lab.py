"""The lab: one table that no training saw, through a camera that is a little wrong; and domains by name.

Nothing of it is drawn: two runs, and two detectors, meet the same lab.
"""

from __future__ import annotations

from neugrasp.errors import InputError
from neugrasp.simulation.domain import Domain, DomainLens, Earlier, HandEye, Room, Sensor

_LAMPS = [
    {
        "position": [0.75, -0.35, 1.35], "target": [0.15, 0.15, 0.05], "size": 0.06, "irradiance": 1.3,
        "colour": [1.12, 1.0, 0.84],
    },
    {
        "position": [-0.9, 1.1, 1.9], "target": [0.15, 0.15, 0.05], "size": 1.1, "irradiance": 0.25,
        "colour": [0.93, 1.0, 1.08],
    },
]  # fmt: skip
"""A desk lamp, small and warm, which throws hard shadows; a cool light panel. The room is dim."""

_TABLE = {
    "centre": [0.15, 0.10, 0.05],
    "size": [0.9, 0.75],
    "texture": {
        "pattern": "bands",
        "colours": [[0.1, 0.1, 0.1], [0.035, 0.035, 0.04], [0.17, 0.165, 0.16]],
        "scale": 22.0,
        "offset": [3.1, -2.7, 0.4],
        "rotation": [0.0, 0.0, 0.35],
        "distortion": 0.5,
        "contrast": 1.0,
    },
    "roughness": 0.07,
    "specular": 0.9,
    "floor": {
        "height": -0.70,
        "texture": {
            "pattern": "speckled",
            "colours": [[0.11, 0.13, 0.16], [0.05, 0.06, 0.08], [0.2, 0.2, 0.22]],
            "scale": 120.0,
            "offset": [0.0, 5.0, 0.0],
            "rotation": [0.0, 0.0, 0.0],
            "distortion": 0.3,
            "contrast": 0.7,
        },
    },
    "wall": None,
}
"""A varnished dark board, glossier than any table of training (roughness 0.25 and up), in a pattern that only
objects have there."""

LAB = Domain(
    name="lab",
    room=Room(
        light={"hdri": "interior", "rotation": 2.2, "strength": 0.28, "exposure": -0.75, "lamps": _LAMPS},
        table=_TABLE,
        seed=90210,
    ),
    earlier=Earlier(turn=0.5, panorama=0.75, lamps=0.85),
    lens=DomainLens(
        focal=(455.744, 454.798),
        principal_point=(321.525, 190.348),
        size=(640, 360),
        radial=(0.04, -0.06),
        tangential=(0.001, -0.001),
    ),
    sensor=Sensor(vignetting=0.35, shot=0.003, read=0.012, jpeg=60),
    tone="AgX",
    hand_eye=HandEye(millimetres=1.5, degrees=0.3, view_millimetres=0.3, view_degrees=0.05, seed=7),
    friction=0.5,
    gripper="robotiq_2f85",
)
"""The D435's intrinsics are those of the paper's cell; its errors, what a careful calibration leaves."""

DOMAINS = {"training": Domain("training"), "lab": LAB}


def domain_of(name: str) -> Domain:
    """A domain by name, or parts of one: "lab:lens+hand_eye". Raises `InputError` where there is none."""
    whole, colon, parts = name.partition(":")
    if whole not in DOMAINS:
        raise InputError(
            f"--domain {name}: choose one of {', '.join(DOMAINS)}, or parts of one, as lab:lens+hand_eye"
        )
    return DOMAINS[whole].only(parts.split("+")) if colon else DOMAINS[whole]
