"""What others do with depth, in our own code: VGN, antipodal grasps.

A baseline is a detector like any other and may import `detection`; nothing imports a baseline but what
evaluates. Another system to compare with goes here, with a line in the entry points of pyproject.toml.
"""
