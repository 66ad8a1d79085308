"""What this machine is and how fast it multiplies and copies: the rooflines of everything else."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from neugrasp.bench.recorder import Cost

PRODUCTS = {"cpu": (512, 1024, 2048), "cuda": (4096, 8192)}
"""Edges of the square matrices that are multiplied; the fastest counts."""
COPIED = {"cpu": 2**28, "cuda": 2**30}
"""Bytes that are copied: more than any cache that a stage could profit from."""
TRIES = 5
PATIENCE = 0.5
"""Seconds that one size may take; hardware without bfloat16 is slow at it."""


@dataclass(frozen=True)
class Rates:
    """The best of several tries."""

    flops: dict[str, float]
    """Operations per second of matrix products, by type of number; a multiply-add is two."""
    copy: float
    """Bytes per second, read plus written."""

    def roofline(self, cost: Cost) -> float:
        """Least seconds of a stage: its products at full rate, or its bytes where they take longer."""
        products = sum(count / self.flops[kind] for kind, count in cost.flops.items())
        return max(products, cost.num_bytes / self.copy)


@dataclass(frozen=True)
class Machine:
    """Where the figures come from."""

    processor: str
    cores: int
    threads: int
    device: str
    torch: str
    load: float
    """Mean number of running programs over the last minute, before anything was measured."""

    @property
    def is_busy(self) -> bool:
        """Whether others were computing here."""
        return self.load > 0.5 * self.cores


def this_machine(device: torch.device) -> Machine:
    """The machine as it is now."""
    name = torch.cuda.get_device_name(device) if device.type == "cuda" else "cpu"
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return Machine(_processor(), cores, torch.get_num_threads(), name, torch.__version__, load)


def measure_rates(device: torch.device) -> Rates:
    """Matrix products in float32 and bfloat16, and copies, at their best."""
    kinds = {"float32": torch.float32, "bfloat16": torch.bfloat16}
    flops = {kind: _product_rate(dtype, device) for kind, dtype in kinds.items()}
    source = torch.ones(COPIED[device.type] // 4, device=device)
    target = torch.empty_like(source)
    return Rates(flops, 2 * source.nbytes / _fastest(lambda: target.copy_(source), device))


def peak_memory(device: torch.device) -> int | None:
    """Most bytes that this process held so far: the GPU's, else the main memory's; None if nobody says."""
    if device.type == "cuda":
        return int(torch.cuda.max_memory_allocated(device))
    return _linux_fact("/proc/self/status", "VmHWM")


def _product_rate(dtype: torch.dtype, device: torch.device) -> float:
    best = 0.0
    precision = torch.get_float32_matmul_precision()
    if device.type == "cuda":
        # Convolutions use TensorFloat-32 there by default, so a roofline has to reckon with it.
        torch.set_float32_matmul_precision("high")
    try:
        for edge in PRODUCTS[device.type]:
            a, b = torch.ones((2, edge, edge), dtype=dtype, device=device)
            seconds = _fastest(_product_of(a, b), device)
            best = max(best, 2 * edge**3 / seconds)
            if seconds > PATIENCE / TRIES:
                break
    finally:
        torch.set_float32_matmul_precision(precision)
    return best


def _product_of(a: Tensor, b: Tensor) -> Callable[[], Tensor]:
    return lambda: a @ b


def _fastest(work: Callable[[], object], device: torch.device) -> float:
    work()
    best = float("inf")
    began = time.perf_counter()
    for _ in range(TRIES):
        _wait(device)
        start = time.perf_counter()
        work()
        _wait(device)
        best = min(best, time.perf_counter() - start)
        if time.perf_counter() - began > PATIENCE:
            break
    return best


def _wait(device: torch.device) -> None:
    if device.type == "cuda":
        torch.cuda.synchronize(device)


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _linux_fact(file: str, key: str) -> int | None:
    """Bytes from a line "KEY: 123 kB" of a file that Linux keeps."""
    if not Path(file).exists():
        return None
    for line in Path(file).read_text(encoding="utf-8").splitlines():
        if line.startswith(f"{key}:"):
            return int(line.split()[1]) * 1024
    return None
