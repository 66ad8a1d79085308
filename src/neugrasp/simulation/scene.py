"""The former place of `data.world`: programs from before name it.

It goes with the next version.
"""

from neugrasp.data.world import (
    Body,
    Cell,
    Material,
    Scene,
    camera_from_dict,
    camera_to_dict,
    scene_from_json,
    scene_to_json,
)

__all__ = [
    "Body",
    "Cell",
    "Material",
    "Scene",
    "camera_from_dict",
    "camera_to_dict",
    "scene_from_json",
    "scene_to_json",
]
