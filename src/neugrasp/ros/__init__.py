"""Grasps for ROS 2 through rosbridge: photos, cameras, transforms in, grasps, surface out (docs/ros.md)."""
