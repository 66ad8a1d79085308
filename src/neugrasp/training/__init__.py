"""See docs/architecture.md."""

import os

import torch

# oneDNN's AVX2 kernels write past their memory in the backward pass of 1 x 1 convolutions of stride 2 over
# 4 channels that lie last in memory (8, 12 and 16 do not; torch 2.13.0, an AMD EPYC without AVX-512), and the
# process aborts; its AVX kernels do not. Read when oneDNN is first used.
if torch.backends.cpu.get_cpu_capability() == "AVX2":
    os.environ.setdefault("ONEDNN_MAX_CPU_ISA", "AVX")
