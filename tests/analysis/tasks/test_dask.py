"""The client of a Dask cluster, against one in this process that loses what it is told to."""

from types import SimpleNamespace

import pytest
from solidtouch.analysis.tasks import dask
from solidtouch.analysis.tasks.code import code
from solidtouch.analysis.tasks.crew import on_runner
from solidtouch.models.errors import InputError

ADDRESS = "tcp://10.0.0.1:8786"


class Done:
    """A future that ended when it was made."""

    status = "finished"

    def __init__(self, value):
        self.value = value

    def add_done_callback(self, told):
        told(self)


@pytest.fixture
def losing(monkeypatch):
    """A function that gives a crew of which the client loses its connection at these numbers of gathering results."""
    monkeypatch.setattr(dask, "get_worker", lambda: SimpleNamespace(address="here"))

    def make(lost, notes):
        gathered = iter(range(1_000_000))

        class LosingClient:
            def __init__(self, *_, **__): ...

            def wait_for_workers(self, *_, **__): ...

            def run(self, *_, **__):
                return {"here": code()}

            def run_on_scheduler(self, *_): ...

            def nthreads(self):
                return {"here": 1}

            def submit(self, function, *arguments, **_):
                known = (one.value if isinstance(one, Done) else one for one in arguments)
                return Done(function(*known))

            def gather(self, future, **_):
                if next(gathered) in lost:
                    raise OSError("in <TCP>: Stream is closed")
                return future.value

            def cancel(self, *_, **__): ...

            def close(self, **_): ...

        monkeypatch.setattr(dask, "Client", LosingClient)
        return on_runner(dask.on_cluster(ADDRESS, 5.0, notes.append))

    return make


def double(item, shared):
    return shared * item


def test_no_task_is_forgotten_when_its_result_is_lost(losing):
    notes = []

    assert list(losing({0, 1, 2, 3, 5, 9, 10}, notes)(double, range(20), 2)) == [2 * item for item in range(20)]
    assert len(notes) == 7


def test_a_scheduler_that_loses_all_it_is_given_ends_the_study(losing):
    """After what was finished; whatever is the matter, the next try would be like the last."""
    notes, results = [], []
    with pytest.raises(InputError) as told:
        results.extend(losing(range(2, 100), notes)(double, range(20), 2))

    assert results == [0, 2]
    assert str(told.value) == (
        f"The scheduler at {ADDRESS} lost its tasks 5 times before one was finished. "
        "The last time: OSError: in <TCP>: Stream is closed."
    )
    assert notes == [f"The connection to the scheduler at {ADDRESS} is lost; waiting for it to come back."] * 4


@pytest.mark.parametrize("shared", [True, False])
def test_what_cannot_be_pickled_is_told(losing, shared):
    unfit = (step for step in ())
    with pytest.raises(InputError, match=r"^A task cannot be sent to the cluster: TypeError: cannot pickle 'gen"):
        list(losing((), [])(double, [2 if shared else unfit], unfit if shared else 2))


def test_a_file_that_is_not_there_is_no_lost_connection(losing):
    """An error of the client's own data goes to whoever asked for them."""

    def items():
        yield 1
        raise FileNotFoundError("taps.nc")

    with pytest.raises(FileNotFoundError, match=r"taps\.nc"):
        list(losing((), [])(double, items(), 2))
