"""Poses, cameras, the cube, sampling, fusion, surfaces: every convention of frames and pixels is decided
here.

Each mapping has a property test. Pixels and voxels are looked up in `sampling` alone. Whoever changes a
convention changes docs/conventions.md and makes all weights invalid.
"""
