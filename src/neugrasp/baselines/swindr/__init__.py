"""SwinDR-VGN: stereo depth restored by a small two-branch Swin (Dai et al., ECCV 2022), then VGN.

Our own network, trained from scratch on our own renders: not the checkpoint of the authors, which has 160 M
parameters, and whose second branch is overwritten by the first where the two meet. Here the two meet alike.
"""
