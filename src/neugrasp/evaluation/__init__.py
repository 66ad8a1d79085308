"""The decluttering benchmark: rounds, protocols, counts with intervals, comparisons.

`declutter` is the loop and knows nothing of a simulation; `episode_runner` builds a round around it. Oracle
baselines, which are told the true surface, live here and can be handed to nobody else.
"""
