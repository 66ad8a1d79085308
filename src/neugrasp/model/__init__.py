"""The network, as Fig. 2 and Eqs. 5 to 9 of the paper have it, and weights on disk.

Read `network` first. Nothing here knows files of data or simulators. `chunked` keeps memory bounded outside
of the modules, faster layers are in `kernels`. A change of a shape makes the shipped weights unreadable.
"""
