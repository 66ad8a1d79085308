"""Trained weights as they are shipped: float16, with the threshold of scores that they are used with.

python benchmarks/ship_weights.py RUN/weights.safetensors NAME.safetensors --threshold 0.85
python benchmarks/ship_weights.py RUN/evaluator.safetensors NAME.safetensors --threshold 0.7 --evaluator
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from neugrasp.model.checkpoint import ship_checkpoint
from neugrasp.model.evaluator_file import load_evaluator, save_evaluator


def main() -> None:
    parser = argparse.ArgumentParser(description="Writes trained weights as they are shipped.")
    parser.add_argument("trained", type=Path, help="what `neugrasp train` wrote, of any network")
    parser.add_argument("shipped", type=Path, help="the file to write")
    parser.add_argument("--threshold", type=float, required=True, help="of scores, 0 to 1")
    parser.add_argument("--evaluator", action="store_true", help="what `neugrasp train-evaluator` wrote")
    options = parser.parse_args()
    if not 0 <= options.threshold <= 1:
        parser.error(f"--threshold {options.threshold}: must be from 0 to 1")
    if options.evaluator:
        taught = load_evaluator(options.trained)
        about = {**taught.about, "threshold": options.threshold}
        save_evaluator(options.shipped, taught.model(), taught.workspace, about, half=True)
    else:
        about = ship_checkpoint(options.trained, options.shipped, options.threshold)
    sys.stdout.write(f"{options.shipped}: {options.shipped.stat().st_size / 1e6:.1f} MB, {about}\n")


if __name__ == "__main__":
    main()
