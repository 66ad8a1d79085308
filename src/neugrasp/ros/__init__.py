"""Grasps for ROS 2 through rosbridge: photos, cameras and transforms in, grasps and surface out (docs/ros.md)."""
