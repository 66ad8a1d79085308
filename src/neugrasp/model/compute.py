"""Where PyTorch computes, and in which precision."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Literal, get_args

import torch

from neugrasp.errors import InputError

Precision = Literal["float32", "bfloat16"]


@dataclass(frozen=True)
class Compute:
    """A device and a precision."""

    device: torch.device
    precision: Precision = "float32"
    """Precision of products and convolutions; geometry and weights are float32 always."""

    @classmethod
    def of(cls, device: str | torch.device, precision: str = "float32") -> Compute:
        """By name: "cpu", "cuda", "cuda:1", "mps".

        Raises `InputError` where the machine has no such device, or there is no such precision.
        """
        names = get_args(Precision)
        if precision not in names:
            raise InputError(f"--precision {precision}: choose one of {', '.join(names)}")
        try:
            found = torch.device(device)
        except RuntimeError as error:
            raise InputError(f"--device {device}: PyTorch knows no such device; try cpu or cuda") from error
        there = {"cuda": torch.cuda.device_count(), "mps": int(torch.backends.mps.is_available())}
        if found.type in there and (found.index or 0) >= there[found.type]:
            seen = f"{there[found.type]} of them" if there[found.type] else "none"
            raise InputError(
                f"--device {device}: PyTorch sees {seen} here; use --device cpu, or install a build of "
                "PyTorch for it (pytorch.org)"
            )
        if found.type not in ("cpu", *there):
            try:
                torch.zeros(1, device=found).cpu()
            except (RuntimeError, AssertionError) as error:
                raise InputError(
                    f"--device {device}: nothing can be computed there; try cpu or cuda"
                ) from error
        return cls(found, "bfloat16" if precision == "bfloat16" else "float32")

    def autocast(self) -> AbstractContextManager[object]:
        """In which products run in the precision."""
        return torch.autocast(self.device.type, torch.bfloat16, enabled=self.precision == "bfloat16")
