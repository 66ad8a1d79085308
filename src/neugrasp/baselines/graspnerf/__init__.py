"""GraspNeRF (Dai et al., ICRA 2023): photos -> volumetric rendering -> TSDF -> grasps, with and without TSDF
supervision. It sees no backgrounds.

What it has of its own is here: two encoders, where each photo says that its rays end (`visibility`), and the
aggregation of views. Sampling, cameras, the conversion to opacity, the grasp head, the losses and the
training loop are the project's.
"""
