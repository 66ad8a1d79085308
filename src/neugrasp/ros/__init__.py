"""Grasps for ROS 2 through rosbridge: photos and transforms in, grasps and surface out (docs/ros.md)."""
