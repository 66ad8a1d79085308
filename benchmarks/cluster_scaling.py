"""How well two workers share scenes, measured on this machine: as processes, and as actors of a Ray cluster.

    python benchmarks/cluster_scaling.py --out FOLDER [--scenes 64] [--photos]

For each way, one and two workers make the same scenes by `neugrasp generate`, from nothing, each in a folder
of its own, which goes afterwards. Scenes an hour are counted from when workers are asked for, so their start
in it; the bytes of all four are compared. Efficiency is the rate of two over twice that of one. Run it on
a machine that does nothing else.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

from ray.cluster_utils import Cluster


def main() -> None:
    """Prints a table; ends with 1 where the bytes differ."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--scenes", type=int, default=64)
    parser.add_argument("--photos", action="store_true")
    options = parser.parse_args()
    # Ray's workers give way to all others (15) unless they are told not to.
    os.environ |= {"RAY_USAGE_STATS_ENABLED": "0", "RAY_worker_niceness": "0"}
    os.environ["PYTHONPATH"] = os.pathsep.join(part for part in sys.path if part)
    command = [sys.executable, "-m", "neugrasp", "generate", "--num", str(options.scenes), "--seed", "7"]
    command += ["--object-sets", "glassware", *([] if options.photos else ["--no-photos"])]
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 2, "include_dashboard": False})
    print(
        f"load before: {os.getloadavg()[0]:.1f}\n| | 1 worker | 2 workers | efficiency |\n|---|---|---|---|"
    )
    hashes = set()
    try:
        for way, more in (("processes", []), ("Ray", ["--cluster", cluster.address])):
            rates = []
            for count in (1, 2):
                rate, content = made([*command, "--workers", str(count), *more], options.out / "scaling")
                rates.append(rate)
                hashes.add(content)
            one, two = rates
            print(f"| {way} | {one:.0f} an hour | {two:.0f} | {two / (2 * one):.2f} |", flush=True)
    finally:
        cluster.shutdown()
    print("the same bytes" if len(hashes) == 1 else "DIFFERENT bytes")
    sys.exit(len(hashes) != 1)


def made(command: list[str], out: Path) -> tuple[float, str]:
    """Scenes an hour, and a hash of all of them."""
    shutil.rmtree(out, ignore_errors=True)
    subprocess.run([*command, "--out", str(out)], check=True, capture_output=True)
    rate = json.loads((out / "timing.json").read_text(encoding="utf-8"))["scenes_per_hour"]
    content = hashlib.sha256()
    for file in sorted(file for file in (out / "scenes").rglob("*") if file.is_file()):
        content.update(str(file.relative_to(out)).encode() + file.read_bytes())
    shutil.rmtree(out)
    return float(rate), content.hexdigest()


if __name__ == "__main__":
    main()
