"""A network trained for a dozen steps: the whole course of a training run in a minute.

    neugrasp generate --scene packed --num 8 --out data/few
    python examples/04_train_tiny.py --data data/few

The recipe "tiny" is a very small network, which learns nothing worth having; what happens is the same as with
"small" and "paper": first the grasp head alone learns on true surfaces, then everything learns on photos. A
recipe is a function that returns the complete configuration (src/neugrasp/training/recipes.py), so a change
of yours is one more function.

A run can be killed at any moment. Started again with `resume=True` it goes on as if nothing had happened, to
the same weights in every bit.
"""

from __future__ import annotations

import json
from pathlib import Path

import tyro

from neugrasp.model.checkpoint import load_checkpoint
from neugrasp.training.command import Train
from neugrasp.training.recipes import configured
from neugrasp.training.trainer import train


def main(
    data: Path = Path("data/few"),
    validation: Path | None = None,
    recipe: str = "tiny",
    steps: int | None = None,
    out: Path = Path("outputs/tiny"),
) -> None:
    """Trains in two sittings and prints the losses."""
    held_out = () if validation is None else (validation,)
    run = Train(recipe=recipe, data=(data,), validation=held_out, out=out, steps=steps, resume=True)
    config = configured(run)
    print(f"{config.steps} steps, {config.head_steps} of them for the grasp head alone")

    train(run, stop_after=config.steps // 2)
    weights = train(run)

    for line in (out / "log.jsonl").read_text().splitlines():
        entry = json.loads(line)
        if "validation" in entry:
            scores = entry["validation"]
            print(f"validation: L1 {scores['l1_0.3']:.3f}, always 0: {scores['l1_0.3_constant_+0']:.3f}")
        else:
            print(f"step {entry['step']:3d}  loss {entry['loss']:.3f}")

    model = load_checkpoint(weights).model()
    count = sum(parameter.numel() for parameter in model.parameters())
    print(f"{weights}: {count:,} numbers; use it with `neugrasp predict SCENE --weights {weights}`")


if __name__ == "__main__":
    tyro.cli(main)
