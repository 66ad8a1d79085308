"""Fields and types of the messages that are sent, as docs.ros.org has them for Jazzy.

std_msgs, geometry_msgs, sensor_msgs, trajectory_msgs, shape_msgs, std_srvs, moveit_msgs, grasping_msgs 0.5;
and the operations of the rosbridge protocol, version 2.
"""

from __future__ import annotations

import base64
from typing import Any

TIME = {"sec": "int32", "nanosec": "uint32"}
DEFINITIONS: dict[str, dict[str, str]] = {
    "builtin_interfaces/Time": TIME,
    "builtin_interfaces/Duration": TIME,
    "std_msgs/Header": {"stamp": "builtin_interfaces/Time", "frame_id": "string"},
    "geometry_msgs/Point": dict.fromkeys("xyz", "float64"),
    "geometry_msgs/Vector3": dict.fromkeys("xyz", "float64"),
    "geometry_msgs/Quaternion": dict.fromkeys("xyzw", "float64"),
    "geometry_msgs/Pose": {"position": "geometry_msgs/Point", "orientation": "geometry_msgs/Quaternion"},
    "geometry_msgs/PoseStamped": {"header": "std_msgs/Header", "pose": "geometry_msgs/Pose"},
    "geometry_msgs/Vector3Stamped": {"header": "std_msgs/Header", "vector": "geometry_msgs/Vector3"},
    "trajectory_msgs/JointTrajectoryPoint": {
        **dict.fromkeys(("positions", "velocities", "accelerations", "effort"), "float64[]"),
        "time_from_start": "builtin_interfaces/Duration",
    },
    "trajectory_msgs/JointTrajectory": {
        "header": "std_msgs/Header",
        "joint_names": "string[]",
        "points": "trajectory_msgs/JointTrajectoryPoint[]",
    },
    "moveit_msgs/GripperTranslation": {
        "direction": "geometry_msgs/Vector3Stamped",
        "desired_distance": "float32",
        "min_distance": "float32",
    },
    "moveit_msgs/Grasp": {
        "id": "string",
        "pre_grasp_posture": "trajectory_msgs/JointTrajectory",
        "grasp_posture": "trajectory_msgs/JointTrajectory",
        "grasp_pose": "geometry_msgs/PoseStamped",
        "grasp_quality": "float64",
        "pre_grasp_approach": "moveit_msgs/GripperTranslation",
        "post_grasp_retreat": "moveit_msgs/GripperTranslation",
        "post_place_retreat": "moveit_msgs/GripperTranslation",
        "max_contact_force": "float32",
        "allowed_touch_objects": "string[]",
    },
    "sensor_msgs/PointField": {"name": "string", "offset": "uint32", "datatype": "uint8", "count": "uint32"},
    "sensor_msgs/PointCloud2": {
        "header": "std_msgs/Header",
        "height": "uint32",
        "width": "uint32",
        "fields": "sensor_msgs/PointField[]",
        "is_bigendian": "bool",
        "point_step": "uint32",
        "row_step": "uint32",
        "data": "uint8[]",
        "is_dense": "bool",
    },
    "shape_msgs/Plane": {"coef": "float64[]"},
    "grasping_msgs/Object": {
        "header": "std_msgs/Header",
        "name": "string",
        "support_surface": "string",
        "properties": "grasping_msgs/ObjectProperty[]",
        "point_cluster": "sensor_msgs/PointCloud2",
        "primitives": "shape_msgs/SolidPrimitive[]",
        "primitive_poses": "geometry_msgs/Pose[]",
        "meshes": "shape_msgs/Mesh[]",
        "mesh_poses": "geometry_msgs/Pose[]",
        "surface": "shape_msgs/Plane",
    },
    "grasping_msgs/GraspableObject": {"object": "grasping_msgs/Object", "grasps": "moveit_msgs/Grasp[]"},
    "std_srvs/Trigger_Response": {"success": "bool", "message": "string"},
}
OPERATIONS = {
    "subscribe": {
        "op",
        "id",
        "topic",
        "type",
        "throttle_rate",
        "queue_length",
        "fragment_size",
        "compression",
    }
}
UNSIGNED = {"uint8": 2**8, "uint32": 2**32}


def check(value: Any, kind: str) -> None:
    """Fails where a value is no message of that type: a field too many or too few, or of another type."""
    if kind == "uint8[]":
        base64.b64decode(value, validate=True)
    elif kind.endswith("[]"):
        assert isinstance(value, list), kind
        for one in value:
            check(one, kind[:-2])
    elif kind in OPERATIONS:
        assert set(value) <= OPERATIONS[kind]
    elif kind in DEFINITIONS:
        assert set(value) == set(DEFINITIONS[kind]), kind
        for name, inner in DEFINITIONS[kind].items():
            check(value[name], inner)
    elif kind in ("float32", "float64"):
        assert isinstance(value, float), (kind, value)
    elif kind == "string":
        assert isinstance(value, str)
    elif kind == "bool":
        assert isinstance(value, bool)
    else:
        assert type(value) is int, (kind, value)
        assert kind == "int32" or 0 <= value < UNSIGNED[kind]
