"""Scenes in physics, photographed in Blender, with grasps tried in them. Never imports torch.

`scene` is plain data that rebuilds a scene exactly; `physics` is the one adapter to PyBullet, `blender` the
one to Blender, in a process of its own. The same seed gives the same bytes, on any number of workers.
"""
