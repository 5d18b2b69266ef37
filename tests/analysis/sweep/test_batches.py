"""Which cells a worker is given at once, and which are given up."""

from solidtouch.analysis.sweep.batches import DEATHS, Batch, CellQueue
from solidtouch.analysis.sweep.cell import Outcome
from solidtouch.analysis.sweep.cells import CellGrid
from solidtouch.analysis.sweep.study import load_study


def cells(make_study, grid="seed = [0, 1, 2, 3, 4, 5]\npolicy = [0.5]"):
    path = make_study(grid)
    whole = CellGrid.of(load_study(path), ("rods",))
    return [whole.cell(number) for number in range(len(whole))]


def test_batches_grow_until_they_take_as_long_as_wanted(make_study):
    queue = CellQueue(cells(make_study), 0.75)
    first = queue.take()
    assert len(first.cells) == 1
    queue.finished([Outcome(0, {}, 0.25)])

    assert [len(queue.take().cells) for _ in range(2)] == [3, 2]
    assert not queue


def test_a_batch_has_one_data_set(make_study):
    one = cells(make_study)
    queue = CellQueue([*one, *(cell._replace(data="others") for cell in one)], 100.0)
    queue.finished([Outcome(0, {}, 0.25)])

    assert [(batch.data, len(batch.cells)) for batch in (queue.take(), queue.take())] == [("rods", 6), ("others", 6)]


def test_only_the_cell_that_kills_its_workers_is_given_up(make_study):
    queue = CellQueue((), 1.0)
    one, other, *_ = cells(make_study)
    assert not queue.died(Batch((one, other)), "It died.")
    assert queue.take().cells == (one,)
    batch, outcomes = queue.take(), []
    assert batch.cells == (other,)

    for death in range(1, DEATHS + 1):
        outcomes = queue.died(batch, "It died.")
        assert bool(outcomes) == (death == DEATHS)
        if not outcomes:
            batch = queue.take()

    assert not queue
    assert [outcome.number for outcome in outcomes] == [other.number]
    assert outcomes[0].traceback == f"It died. It was tried {DEATHS} times."
