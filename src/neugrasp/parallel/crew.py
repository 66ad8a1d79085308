"""Tasks to results, by workers that may die: the loop is the same wherever they are."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any, Generic, Protocol, TypeVar

from neugrasp.errors import InputError, NeuGraspError

log = logging.getLogger(__name__)

Task = TypeVar("Task")
Result = TypeVar("Result")
Opener = Callable[[], AbstractContextManager[Callable[[Task], Result]]]
"""Makes what a worker keeps between tasks, and gives what it does with one; it travels to the worker."""
TRIES = 3
"""Workers that a task may kill before it is given up: one that needs too much memory kills them all."""


class Worker(Protocol):
    """One task at a time."""

    def begin(self, task: Any) -> Future[Any]:
        """Starts a task."""
        ...

    def has_died(self, error: BaseException) -> bool:
        """Whether an error of a task says that the worker is gone, not that the task cannot be done."""
        ...

    def revive(self) -> bool:
        """Puts a new worker in the place of one that died; False where there is no room for it now."""
        ...


class Crew(Protocol):
    """Workers with what starts and ends them."""

    def open(self, opener: Opener[Any, Any]) -> AbstractContextManager[Sequence[Worker]]:
        """The workers, as long as the block lasts."""
        ...


def spread(
    crew: Crew, opener: Opener[Task, Result], groups: Iterable[Sequence[Task]]
) -> Generator[Result, None, None]:
    """Results as they are finished. Tasks of a group go to one worker, one after the other, while it lives.

    A worker that dies costs the task that it had, which is begun anew by another one. Raises what a task
    raises, and `NeuGraspError` where a task killed three workers, or no worker is left.
    """
    left = deque(deque(_Job(task) for task in group) for group in groups if group)
    if not left:
        return
    with crew.open(opener) as workers:
        yield from _Shift(left, list(workers)).results()


@dataclass(eq=False)
class _Job(Generic[Task]):
    """A task, and how many workers died of it."""

    task: Task
    deaths: int = 0


@dataclass(eq=False)
class _Shift(Generic[Task, Result]):
    """Who does what, until all is done."""

    left: deque[deque[_Job[Task]]]
    """Groups that nobody has begun."""
    idle: list[Worker]
    current: dict[Worker, deque[_Job[Task]]] = field(default_factory=dict)
    """What is left of the group of each worker."""
    running: dict[Future[Result], tuple[Worker, _Job[Task]]] = field(default_factory=dict)
    fallen: list[Worker] = field(default_factory=list)
    """Died, and could not be put in place again yet."""

    def results(self) -> Iterator[Result]:
        """As they are finished."""
        while self._hand_out():
            done, _ = wait(self.running, return_when=FIRST_COMPLETED)
            for future in done:
                worker, job = self.running.pop(future)
                error = future.exception()
                if error is None:
                    result = future.result()
                    if isinstance(result, Failed):
                        raise result.raised()
                    self.idle.append(worker)
                    yield result
                elif worker.has_died(error):
                    self._bury(worker, job)
                else:
                    raise error

    def _hand_out(self) -> bool:
        """Gives work to who has none; whether anything is being done."""
        self.fallen = [worker for worker in self.fallen if not self._back(worker)]
        for worker in list(self.idle):
            group = self.current.get(worker)
            if not group:
                if not self.left:
                    continue
                group = self.current[worker] = self.left.popleft()
            self.idle.remove(worker)
            job = group.popleft()
            self.running[worker.begin(job.task)] = worker, job
        if not self.running and self.left:
            raise NeuGraspError("no worker is left; run the command again to go on")
        return bool(self.running)

    def _bury(self, worker: Worker, job: _Job[Task]) -> None:
        """The task, and the rest of the group, are for whoever comes first."""
        job.deaths += 1
        if job.deaths == TRIES:
            raise NeuGraspError("a worker was killed (out of memory?); run the command again to go on")
        log.warning("a worker was killed (out of memory?); what it was doing is begun anew")
        self.left.appendleft(deque([job, *self.current.pop(worker, ())]))
        self.fallen.append(worker)

    def _back(self, worker: Worker) -> bool:
        if worker.revive():
            self.idle.append(worker)
            return True
        return False


@dataclass(frozen=True)
class Failed:
    """A task that cannot be done, told so that it survives the way between processes: some errors do not."""

    text: str
    is_input: bool

    def raised(self) -> NeuGraspError:
        """As an error again."""
        return (InputError if self.is_input else NeuGraspError)(self.text)


def told(work: Callable[[Any], Any], task: Any) -> Any:
    """The result of a task, or what `Failed`."""
    try:
        return work(task)
    except NeuGraspError as error:
        return Failed(str(error), isinstance(error, InputError))
