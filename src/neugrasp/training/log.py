"""What a run writes down: one JSON line per step and validation, and TensorBoard where it is installed."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from typing import Any


class TrainingLog:
    """Appends to log.jsonl; lines of steps that a resumed run repeats are dropped first."""

    def __init__(self, folder: Path, start: int):
        self.path = folder / "log.jsonl"
        self._drop_from(start)
        self._file = self.path.open("a", encoding="utf-8")
        self._board: Any = None
        if importlib.util.find_spec("tensorboard"):
            from torch.utils.tensorboard import SummaryWriter

            self._board = SummaryWriter(str(folder / "tensorboard"), purge_step=start)

    def step(self, step: int, losses: dict[str, float], learning_rate: float) -> None:
        """The losses of a step."""
        self._write({"step": step, **losses, "learning_rate": learning_rate}, "train")

    def validation(self, step: int, scores: dict[str, float]) -> None:
        """The scores after `step` steps."""
        self._write({"step": step - 1, "validation": scores}, "validation", scores)

    def close(self) -> None:
        """Flushes everything."""
        self._file.close()
        if self._board is not None:
            self._board.close()

    def _write(self, line: dict[str, Any], group: str, scalars: dict[str, float] | None = None) -> None:
        self._file.write(json.dumps(line) + "\n")
        self._file.flush()
        if self._board is not None:
            for name, value in (scalars or line).items():
                self._board.add_scalar(f"{group}/{name}", value, line["step"])

    def _drop_from(self, start: int) -> None:
        if not self.path.is_file():
            return
        kept = []
        for line in self.path.read_text(encoding="utf-8").splitlines():
            try:
                if json.loads(line)["step"] < start:
                    kept.append(line)
            except (json.JSONDecodeError, KeyError):
                continue
        temporary = self.path.with_suffix(".tmp")
        temporary.write_text("".join(line + "\n" for line in kept), encoding="utf-8")
        temporary.replace(self.path)
