"""Which workers share a command's work, from its options."""

from __future__ import annotations

import os

from neugrasp.parallel.cluster import Cluster
from neugrasp.parallel.crew import Crew
from neugrasp.parallel.local import Here, Processes


def crew_for(workers: int | None, tasks: int, cluster: str | None = None) -> tuple[Crew, int]:
    """The workers, no more than there are tasks, and the threads that each may use.

    Without a cluster: this process where one is enough, else processes, by default one for each core.
    """
    if cluster is not None:
        return Cluster(cluster, None if workers is None else min(workers, tasks)), 1
    cores = len(os.sched_getaffinity(0))
    count = min(workers or cores, tasks)
    threads = max(1, cores // max(count, 1))
    return (Here() if count == 1 else Processes(count)), threads
