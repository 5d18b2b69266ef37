"""Which tasks a worker is given at once, and which are given up."""

from typing import NamedTuple

from solidtouch.analysis.tasks.batches import DEATHS, Batch, TaskQueue
from solidtouch.analysis.tasks.task import Outcome


class Numbered(NamedTuple):
    """A task that does nothing."""

    number: int
    data: str = "rods"


SIX = [Numbered(number) for number in range(6)]


def test_batches_grow_until_they_take_as_long_as_wanted():
    queue = TaskQueue(SIX, 0.75)
    first = queue.take()
    assert len(first.tasks) == 1
    queue.finished([Outcome(0, {}, 0.25)])

    assert [len(queue.take().tasks) for _ in range(2)] == [3, 2]
    assert not queue


def test_a_batch_has_one_data_set():
    queue = TaskQueue([*SIX, *(task._replace(data="others") for task in SIX)], 100.0)
    queue.finished([Outcome(0, {}, 0.25)])

    assert [(batch.data, len(batch.tasks)) for batch in (queue.take(), queue.take())] == [("rods", 6), ("others", 6)]


def test_only_the_task_that_kills_its_workers_is_given_up():
    queue = TaskQueue((), 1.0)
    one, other, *_ = SIX
    assert not queue.died(Batch((one, other)), "It died.")
    assert queue.take().tasks == (one,)
    batch, outcomes = queue.take(), []
    assert batch.tasks == (other,)

    for death in range(1, DEATHS + 1):
        outcomes = queue.died(batch, "It died.")
        assert bool(outcomes) == (death == DEATHS)
        if not outcomes:
            batch = queue.take()

    assert not queue
    assert [outcome.number for outcome in outcomes] == [other.number]
    assert outcomes[0].traceback == f"It died. It was tried {DEATHS} times."
