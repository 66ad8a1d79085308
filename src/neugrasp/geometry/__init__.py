"""Poses, cameras, the cube, sampling, surfaces: conventions of frames and pixels are decided here.

Each mapping has a property test. Pixels and voxels are looked up in `sampling` alone. Whoever changes a
convention changes docs/conventions.md and makes all weights invalid.
"""
