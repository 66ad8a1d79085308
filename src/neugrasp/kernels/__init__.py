"""Faster versions of layers of `model`, each behind one function and equal to the plain layer.

A kernel is used where its `pays` says so, by device and by whether a gradient is wanted. Whoever changes a
layer may delete its kernel: nothing else depends on it. `tests/kernels` has the proof of equality.
"""
