"""Processes that work for another one."""

import gc
import operator
import threading
from multiprocessing import get_context

from solidtouch.analysis.tasks.crew import on_runner
from solidtouch.analysis.tasks.local import _work, in_processes
from solidtouch.analysis.tasks.task import attempt


def test_a_worker_whose_other_process_was_killed_ends_without_a_word(capfd):
    """Also before it has said that it is ready."""
    context = get_context("spawn")
    here, there = context.Pipe()
    here.close()
    worker = context.Process(target=_work, args=(there, attempt, gc.get_threshold()))
    worker.start()
    worker.join(60)
    assert worker.exitcode == 0
    assert capfd.readouterr().err == ""


class Lost:
    """Data whose file has gone."""

    def __reduce__(self):
        raise FileNotFoundError("taps.nc")


def test_data_that_cannot_be_sent_end_the_work():
    """A worker that waits for data is not taken for one that has died."""
    told = []

    def work():
        try:
            list(on_runner(in_processes(1))(operator.add, [1], Lost()))
        except FileNotFoundError as error:
            told.append(str(error))

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(60)
    assert told == ["taps.nc"]
