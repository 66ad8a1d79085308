"""RGBGrasp-GT: a radiance field for every grasp, told the exact depth; its rendered depth goes to VGN.

Nerfacto's parts (hash grids, proposal networks, their losses; method.md H) in plain PyTorch, in a metric box.
"""
