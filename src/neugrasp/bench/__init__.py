"""How long each stage of detection and of training takes, beside the least that the machine could need.

`stages` and `training_stages` name what is timed, `measure` times it, `report` prints it (docs/bench.md).
"""
