"""RGBGrasp-GT: a radiance field for every grasp, told the exact depth; its rendered depth goes to VGN.

Nerfacto's parts (hash grids, proposal networks, their losses) in plain PyTorch, in a metric box.
"""
