"""What a run writes down at every step and validation: JSON lines always, TensorBoard and W&B where asked."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

from neugrasp.data.fields import Fields
from neugrasp.data.strict_json import parse_json
from neugrasp.errors import InputError
from neugrasp.output import write_text


class Logger(Protocol):
    """Somewhere that numbers go to."""

    def write(self, step: int, group: str, numbers: Mapping[str, float]) -> None:
        """The numbers of a group, "train" or "validation", after a step."""
        ...

    def close(self) -> None:
        """Writes out what is held back."""
        ...


class TrainingLog:
    """The loggers of a run. Steps that a resumed run repeats replace those of before.

    `names` are of "tensorboard" and "wandb". Raises `InputError` where one of them is not installed.
    """

    def __init__(self, folder: Path, start: int, names: Sequence[str] = (), about: Any = None):
        others: list[Logger] = []
        for name in names:
            others.append(WandB(folder, about) if name == "wandb" else TensorBoard(folder, start))
        self._loggers: list[Logger] = [JsonLines(folder, start), *others]

    def step(self, step: int, losses: dict[str, float], learning_rate: float) -> None:
        """The losses of a step."""
        self._write(step, "train", {**losses, "learning_rate": learning_rate})

    def validation(self, step: int, scores: dict[str, float]) -> None:
        """The scores after `step` steps."""
        self._write(step - 1, "validation", scores)

    def close(self) -> None:
        """Writes out what is held back."""
        for logger in self._loggers:
            logger.close()

    def _write(self, step: int, group: str, numbers: Mapping[str, float]) -> None:
        for logger in self._loggers:
            logger.write(step, group, numbers)


class JsonLines:
    """Appends to log.jsonl."""

    def __init__(self, folder: Path, start: int):
        self.path = folder / "log.jsonl"
        self._drop_from(start)
        self._file = self.path.open("a", encoding="utf-8")

    def write(self, step: int, group: str, numbers: Mapping[str, float]) -> None:
        """One line; the numbers of a validation have a name of their own in it."""
        line = {"step": step, **(numbers if group == "train" else {group: dict(numbers)})}
        self._file.write(json.dumps(line) + "\n")
        self._file.flush()

    def close(self) -> None:
        """Closes the file."""
        self._file.close()

    def _drop_from(self, start: int) -> None:
        if not self.path.is_file():
            return
        kept, name = [], str(self.path)
        for line in self.path.read_text(encoding="utf-8", errors="replace").splitlines():
            # A line cut off by a crash, or that somebody else wrote, is dropped.
            with suppress(InputError):
                Fields(name, parse_json(line, name, judges_values=False)).whole("step", 0, start - 1)
                kept.append(line)
        write_text(self.path, "".join(line + "\n" for line in kept))


class TensorBoard:
    """Events in tensorboard/. Raises `InputError` without the extra `train`."""

    def __init__(self, folder: Path, start: int):
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError as error:
            raise InputError("--loggers tensorboard: pip install 'neugrasp[train]'") from error
        self._board = SummaryWriter(str(folder / "tensorboard"), purge_step=start)

    def write(self, step: int, group: str, numbers: Mapping[str, float]) -> None:
        """A scalar for each number."""
        for name, value in numbers.items():
            self._board.add_scalar(f"{group}/{name}", value, step)

    def close(self) -> None:
        """Writes out what is held back."""
        self._board.close()


class WandB:
    """A run of Weights & Biases that bears the folder's name and goes on with it.

    Raises `InputError` where wandb is not installed.
    """

    def __init__(self, folder: Path, about: Any):
        try:
            import wandb
        except ImportError as error:
            raise InputError("--loggers wandb: pip install wandb") from error
        name = folder.resolve().name
        self._run = wandb.init(
            project="neugrasp", id=name, name=name, dir=str(folder), config=about, resume="allow"
        )

    def write(self, step: int, group: str, numbers: Mapping[str, float]) -> None:
        """A scalar for each number; a step that was written before is skipped by the server."""
        self._run.log({f"{group}/{name}": value for name, value in numbers.items()}, step=step)

    def close(self) -> None:
        """Writes out what is held back."""
        self._run.finish()
