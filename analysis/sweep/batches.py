"""Pending cells, grouped into batches of a wanted duration.

Small cells go together, so that the way to a worker and back costs little; cells of a batch share a data set. A batch
whose worker died is taken apart, so that of its cells only the one that killed it is blamed.
"""

from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from .cell import Outcome
from .cells import Cell

DEATHS = 3
"""Workers that may die of a cell before it counts as failed."""

_MOST = 1000


class Batch(NamedTuple):
    """Cells of one data set that go to a worker together."""

    cells: tuple[Cell, ...]
    deaths: int = 0

    @property
    def data(self) -> str:
        """Name of the data set."""
        return self.cells[0].data


class CellQueue:
    """The cells that are not done.

    Args:
        cells: In the order in which neighbours share most.
        seconds: How long a batch should take.

    Attributes:
        seconds: As given; may change.
    """

    def __init__(self, cells: Iterable[Cell], seconds: float) -> None:
        self._cells = iter(cells)
        self._next = next(self._cells, None)
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
        cells: list[Cell] = []
        while self._next is not None and len(cells) < size and all(self._next.data == c.data for c in cells[:1]):
            cells.append(self._next)
            self._next = next(self._cells, None)
        return Batch(tuple(cells))

    def finished(self, outcomes: Iterable[Outcome]) -> None:
        """Learns how long cells take."""
        for outcome in outcomes:
            mean = outcome.seconds if self._mean_s is None else self._mean_s
            self._mean_s = max(0.8 * mean + 0.2 * outcome.seconds, 1e-6)

    def lost(self, batch: Batch) -> None:
        """Takes back a batch that nobody has worked on to its end, through no fault of its own."""
        self._again.append(batch)

    def died(self, batch: Batch, how: str) -> list[Outcome]:
        """Takes back a batch whose worker died; gives the cells up that did this too often."""
        first, *others = batch.cells
        if others:
            self._again.extend(Batch((cell,)) for cell in batch.cells)
            return []
        if batch.deaths + 1 < DEATHS:
            self._again.append(Batch(batch.cells, batch.deaths + 1))
            return []
        return [Outcome(first.number, {}, 0.0, f"{how} It was tried {DEATHS} times.")]
