"""Pending tasks, grouped into batches of a wanted duration.

Small tasks go together, so that the way to a worker and back costs little; tasks of a batch share their data. A batch
whose worker died is taken apart, so that of its tasks only the one that killed it is blamed.
"""

from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from .task import Outcome, Task

DEATHS = 3
"""Workers that may die of a task before it counts as failed."""

_MOST = 1000


class Batch(NamedTuple):
    """Tasks with the same data that go to a worker together."""

    tasks: tuple[Task, ...]
    deaths: int = 0

    @property
    def data(self) -> str:
        """Name of their data."""
        return self.tasks[0].data


class TaskQueue:
    """The tasks that are not done.

    Args:
        tasks: In the order in which neighbours share most.
        seconds: How long a batch should take.

    Attributes:
        seconds: As given; may change.
    """

    def __init__(self, tasks: Iterable[Task], seconds: float) -> None:
        self._tasks = iter(tasks)
        self._next = next(self._tasks, None)
        self._again: deque[Batch] = deque()
        self.seconds = seconds
        self._mean_s: float | None = None

    def __bool__(self) -> bool:
        return self._next is not None or bool(self._again)

    def take(self) -> Batch:
        """The next batch; there must be one."""
        if self._again:
            return self._again.popleft()
        size = 1 if self._mean_s is None else int(min(max(self.seconds / self._mean_s, 1), _MOST))
        tasks: list[Task] = []
        while self._next is not None and len(tasks) < size and all(self._next.data == t.data for t in tasks[:1]):
            tasks.append(self._next)
            self._next = next(self._tasks, None)
        return Batch(tuple(tasks))

    def finished(self, outcomes: Iterable[Outcome]) -> None:
        """Learns how long tasks take."""
        for outcome in outcomes:
            mean = outcome.seconds if self._mean_s is None else self._mean_s
            self._mean_s = max(0.8 * mean + 0.2 * outcome.seconds, 1e-6)

    def lost(self, batch: Batch) -> None:
        """Takes back a batch that nobody has worked on to its end, through no fault of its own."""
        self._again.append(batch)

    def died(self, batch: Batch, how: str) -> list[Outcome]:
        """Takes back a batch whose worker died; gives the tasks up that did this too often."""
        first, *others = batch.tasks
        if others:
            self._again.extend(Batch((task,)) for task in batch.tasks)
            return []
        if batch.deaths + 1 < DEATHS:
            self._again.append(Batch(batch.tasks, batch.deaths + 1))
            return []
        return [Outcome(first.number, None, 0.0, f"{how} It was tried {DEATHS} times.")]
