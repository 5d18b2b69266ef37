"""Results of tasks on threads and from runners, in order."""

import sys
import time

import cloudpickle
import pytest
from solidtouch.analysis.tasks.crew import crew_of, on_runner, on_threads
from solidtouch.analysis.tasks.kept import Kept
from solidtouch.analysis.tasks.local import in_this_process
from solidtouch.analysis.tasks.task import Outcome
from solidtouch.models.errors import InputError
from solidtouch.models.progress import ShownHere, no_progress
from task_runners import through_pickle


def over(item, shared):
    """What is shared, over the item."""
    if item < 0:
        raise InputError(f"{item} is negative.")
    return shared / item


CREWS = [on_threads(1), on_threads(2), on_runner(in_this_process), on_runner(through_pickle)]


@pytest.mark.parametrize("crew", CREWS)
def test_results_are_in_the_order_of_the_items_and_counted(crew):
    counted = []
    assert list(crew(over, range(1, 11), 60.0, counted.append)) == [60.0 / item for item in range(1, 11)]
    assert counted == [1] * 10


@pytest.mark.parametrize("crew", CREWS)
def test_what_a_task_refuses_is_refused(crew):
    with pytest.raises(InputError, match=r"^-1 is negative\.$"):
        list(crew(over, [1, -1], 1.0))


def test_any_other_error_is_told_with_its_traceback():
    with pytest.raises(RuntimeError, match=r"(?s)Traceback.*in over.*ZeroDivisionError: .*division by zero"):
        list(on_runner(through_pickle)(over, [1, 0], 1.0))


def test_a_task_that_kills_its_workers_is_told_in_a_sentence():
    def killing(tasks, work, load):
        yield Outcome(next(tasks).number, None, 0.0, "The workers died. It was tried 3 times.")

    with pytest.raises(InputError, match=r"^The workers died\. It was tried 3 times\.$"):
        list(on_runner(killing)(over, [1], 1.0))


def test_nothing_runs_on_after_the_last_result_that_is_wanted():
    closed = []

    def watched(tasks, work, load):
        try:
            yield from in_this_process(tasks, work, load)
        finally:
            closed.append(True)

    results = on_runner(watched)(over, range(1, 9), 1.0)
    assert next(results) == 1.0
    results.close()
    assert closed == [True]


def test_workers_and_a_scheduler_exclude_each_other():
    with pytest.raises(InputError, match="--workers cannot be combined with --scheduler"):
        crew_of("tcp://127.0.0.1:1", 2)


def test_without_distributed_only_a_scheduler_is_refused(monkeypatch):
    monkeypatch.delitem(sys.modules, "solidtouch.analysis.tasks.dask", raising=False)
    monkeypatch.setitem(sys.modules, "distributed", None)

    assert list(crew_of(None, 1)(over, [1], 1.0)) == [1.0]
    with pytest.raises(InputError, match=r"needs distributed: pip install 'solidtouch\[cluster\]'\.$"):
        crew_of("tcp://127.0.0.1:1", None)


def test_kept_values_are_made_once_and_dropped_when_there_are_more():
    made = []
    kept = Kept(2)
    for key in "abacab":
        assert kept(key, lambda key=key: made.append(key) or key * 2) == key * 2
    assert made == ["a", "b", "c", "b"]


def test_a_value_that_cannot_be_made_is_refused_each_time():
    kept = Kept()

    def fail():
        raise InputError("no")

    for _ in range(2):
        with pytest.raises(InputError, match="no"):
            kept("a", fail)


def test_threads_wait_for_a_value_that_one_of_them_makes():
    made = []
    results = list(on_threads(4)(_slowly, range(8), (Kept(), made)))
    assert results == [1] * 8
    assert made == [True]


def _slowly(_, shared):
    kept, made = shared
    return kept("a", lambda: time.sleep(0.05) or made.append(True) or len(made))


def test_progress_is_shown_in_this_process_only():
    told = []
    here = ShownHere(lambda name, total: told.append((name, total)) or told.append)
    here("stage", 2)(1)
    copy = cloudpickle.loads(cloudpickle.dumps(here))
    copy("stage", 2)(1)
    assert told == [("stage", 2), 1]
    assert copy("stage", 2)(1) is not no_progress
