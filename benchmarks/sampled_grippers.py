"""Gripper files that nobody built, so that the evaluator of grasps learns what any two fingers can hold.

    python benchmarks/sampled_grippers.py OUT [--num 16] [--seed 0]

Each has a palm of one box, and fingers of a pad and of a thicker part behind it.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.gripper import FORMAT, VERSION, Gripper
from neugrasp.output import write_text

PALM_HEIGHT = 0.06
"""Metres from the flange to the palm's front."""
PADS = {"spinning_friction": 0.1, "stiffness": 30000, "damping": 1000}


def sampled_gripper(name: str, rng: np.random.Generator) -> dict[str, Any]:
    """The content of a gripper file. Lengths in metres, forces in newton, all uniform in their ranges."""
    opening = rng.uniform(0.045, 0.13)
    length = rng.uniform(0.04, 0.08)
    pad = [rng.uniform(0.010, 0.032), rng.uniform(0.004, 0.012), rng.uniform(0.4, 0.8) * length]
    base = [pad[0] + rng.uniform(0, 0.012), pad[1] + rng.uniform(0.002, 0.014), length - 0.6 * pad[2]]
    behind_tip = rng.uniform(0.003, 0.4 * pad[2])
    palm = [rng.uniform(0.035, 0.08), opening + 2 * base[1] + rng.uniform(-0.03, 0.03), PALM_HEIGHT]
    parts = [
        {"size": pad, "centre": [0.0, pad[1] / 2, length - pad[2] / 2]},
        {"size": base, "centre": [0.0, 0.002 + base[1] / 2, base[2] / 2]},
    ]
    return {
        "format": FORMAT,
        "version": VERSION,
        "name": name,
        "max_opening": opening,
        "finger_depth": length - 0.004,
        "tcp_height": PALM_HEIGHT + length - behind_tip,
        "tcp_depth": 0.9 * (length - behind_tip),
        "closing_force": rng.uniform(10, 45),
        "closing_speed": 0.2,
        "holding_force": 300,
        "centring_force": 50,
        "palm": {
            "mass": 0.8,
            "centre_of_mass": [0, 0, PALM_HEIGHT / 2],
            "parts": [{"size": palm, "centre": [0, 0, PALM_HEIGHT / 2]}],
        },
        "finger": {
            "mount": PALM_HEIGHT,
            "mass": 0.1,
            "centre_of_mass": [0, base[1] / 2, length / 2],
            "parts": parts,
            "pads": {"lateral_friction": rng.uniform(0.6, 1.2), **PADS},
        },
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--num", type=int, default=16)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for number in range(options.num):
        name = f"sampled_{options.seed}_{number:02d}"
        content = sampled_gripper(name, np.random.default_rng([options.seed, number]))
        gripper = Gripper.from_dict(content, name)
        write_text(options.out / f"{name}.json", json.dumps(content, indent=1) + "\n")
        sys.stdout.write(f"{name}: opens {1000 * gripper.max_opening:.0f} mm\n")


if __name__ == "__main__":
    main()
