"""The former place of `oracle_baselines`: installations from before name it until they are made again.

It goes with the next version.
"""

from neugrasp.evaluation.oracle_baselines import ANTIPODAL, JUDGED, ORACLE

__all__ = ["ANTIPODAL", "JUDGED", "ORACLE"]
