"""What `run_one_shot` returns, for reading."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from neugrasp.metrics import CONSTANTS, L1_MASKS

ATTEMPTS = "{:<20} {:>8} {:>8} {:>16}  {}"
SURFACES = "{:<14} {:>8} {:<12}" + " {:>7}" * len(L1_MASKS) + " {:>7} {:>7} {:>7} {:>7}"


def one_shot_table(summary: dict[str, Any]) -> str:
    """Success rates by kind and detector, then the surface by material with the constants under it."""
    return "\n".join([*_attempts(summary["success"]), "", *_surfaces(summary["by_material"])])


def _attempts(success: dict[str, dict[str, Any]]) -> Iterator[str]:
    yield ATTEMPTS.format("best grasp executed", "attempts", "success", "95 % interval", "what came of it")
    for name, row in success.items():
        low, high = row["ci"]
        reasons = ", ".join(
            f"{count} {reason}" for reason, count in sorted(row["reasons"].items(), key=lambda item: -item[1])
        )
        yield ATTEMPTS.format(
            name, row["attempts"], f"{row['rate']:.1f} %", f"{low:.1f} to {high:.1f} %", reasons
        )


def _surfaces(by_material: dict[str, dict[str, Any]]) -> Iterator[str]:
    masks = [f"L1 {mask:g}" for mask in L1_MASKS]
    yield SURFACES.format("material", "records", "surface", *masks, "IoU", "PSNR", "SSIM", "AUC")
    for material, scores in by_material.items():
        errors = [_number(scores[f"l1_{mask}"]) for mask in L1_MASKS]
        others = [
            _number(scores["iou"]),
            _number(scores["psnr"], 1),
            _number(scores["ssim"]),
            _number(scores["grasp_auc"]),
        ]
        yield SURFACES.format(material, scores["records"], "predicted", *errors, *others).rstrip()
        for constant in CONSTANTS:
            errors = [_number(scores[f"l1_{mask}_constant_{constant:+.0f}"]) for mask in L1_MASKS]
            name = f"constant {constant:+.0f}"
            yield SURFACES.format("", "", name, *errors, "", "", "", "").rstrip()


def _number(value: float | None, digits: int = 3) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
