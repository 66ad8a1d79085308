"""See docs/architecture.md."""

import os

import torch

# oneDNN's AVX2 kernels write past their memory in the backward pass of narrow convolutions, and the process
# aborts (torch 2.13.0, an AMD EPYC without AVX-512); its AVX kernels do not. Read when oneDNN is first used.
if torch.backends.cpu.get_cpu_capability() == "AVX2":
    os.environ.setdefault("ONEDNN_MAX_CPU_ISA", "AVX")
