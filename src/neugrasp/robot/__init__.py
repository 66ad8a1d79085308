"""What a cell can do, as protocols (`interface`), and a cell in physics behind them.

`pick` carries out one grasp by `execution`, which labels use, too. Drivers of real arms go behind the same
protocols.
"""
