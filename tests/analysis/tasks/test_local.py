"""Processes that work for another one."""

import gc
from multiprocessing import get_context

from solidtouch.analysis.tasks.local import _work
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
