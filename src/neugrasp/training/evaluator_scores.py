"""How good an evaluator of grasps is: AUC, loss, and what its probabilities are worth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float32

from neugrasp.metrics import area_under_roc
from neugrasp.model.evaluator_file import load_evaluator
from neugrasp.model.grasp_evaluator import GraspEvaluator
from neugrasp.training.evaluator_trials import Seen

BINS = 10
"""Bins of the reliability curve."""


@torch.no_grad()
def probabilities(model: GraspEvaluator, seen: Seen, at_once: int = 1024) -> Float32[np.ndarray, " k"]:
    """What the network says of trials; the mean over mirror images."""
    was_training = model.training
    model.eval()
    device = next(model.parameters()).device
    parts = [
        model.symmetric(box.to(device), of_up.to(device), seen.hands[hand].to(device))
        for box, of_up, hand in zip(
            *(each.split(at_once) for each in (seen.box, seen.of_up, seen.hand)), strict=True
        )
    ]
    model.train(was_training)
    found: np.ndarray = torch.cat(parts).sigmoid().cpu().numpy()
    return found


def judgement(model: GraspEvaluator, seen: Seen) -> dict[str, float]:
    """AUC over all trials and over those free of collision, the loss, and the reliability curve.

    The curve: of each bin of probability its trials, what was said, and what held; its error is the mean gap.
    """
    said, held_at_all = probabilities(model, seen), seen.success.numpy() > 0.5
    scores = {
        "auc": area_under_roc(said, held_at_all),
        "auc_free": area_under_roc(said[seen.free], held_at_all[seen.free]),
        "loss": float(F.binary_cross_entropy(torch.from_numpy(said), seen.success)),
    }
    gaps = 0.0
    bins = np.minimum((said * BINS).astype(int), BINS - 1)
    for number in range(BINS):
        here = bins == number
        if here.any():
            name = f"from {number / BINS:g}"
            scores |= {f"{name} trials": float(here.sum()), f"{name} said": float(said[here].mean())}
            scores[f"{name} held"] = float(held_at_all[here].mean())
            gaps += here.sum() * abs(scores[f"{name} said"] - scores[f"{name} held"])
    return scores | {"calibration_error": float(gaps / len(said))}


def reliability_table(weights: Path) -> str:
    """The scores noted with an evaluator, and its reliability curve, for people."""
    scores = load_evaluator(weights).about["scores"]
    lines = [f"{name:<18} {scores[name]:.3f}" for name in scores if " " not in name]
    lines += ["", "said            trials   said   held"]
    for number in range(BINS):
        name = f"from {number / BINS:g}"
        if f"{name} trials" in scores:
            count, said, held_share = (scores[f"{name} {what}"] for what in ("trials", "said", "held"))
            span = f"{number / BINS:g} to {(number + 1) / BINS:g}"
            lines.append(f"{span:<15} {count:>6.0f}  {said:>5.2f}  {held_share:>5.2f}")
    return "\n".join([*lines, "", f"{weights}"])
