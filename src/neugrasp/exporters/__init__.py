"""Grasps in the conventions of other programs."""
