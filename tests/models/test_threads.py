"""Tasks on threads."""

import os
import threading
import time
from concurrent.futures import CancelledError

import pytest
from solidtouch.models.threads import check_wanted, cores, in_order, one_core, one_numpyro, other_threads


@pytest.mark.parametrize("workers", [1, 3])
def test_results_come_in_order(workers):
    tasks = [lambda i=i: i * i for i in range(20)]
    assert list(in_order(tasks, workers)) == [i * i for i in range(20)]


def test_tasks_that_must_run_alone_run_where_results_are_taken():
    """And others beside them."""
    here = threading.get_ident()
    odd = [lambda i=i: (i, threading.get_ident()) for i in range(9)]
    results = list(in_order(odd, 2, lambda task: task.__defaults__[0] % 2 == 1))

    assert [i for i, _ in results] == list(range(9))
    assert all((thread == here) == (i % 2 == 1) for i, thread in results)


def test_tasks_under_way_hear_that_nobody_wants_their_results():
    """As after Ctrl-C; otherwise whoever stops would wait for all that has begun."""
    heard, begun = [], threading.Event()

    def task(number):
        try:
            for _ in range(2000 if number else 0):
                begun.set()
                check_wanted()
                time.sleep(0.01)
        except CancelledError:
            heard.append(number)
            raise
        return number

    def outer(number):
        return list(in_order([lambda: task(number)] * 2, 2))

    results = in_order([lambda i=i: outer(i) for i in range(9)], 2)
    assert next(results) == [0, 0]
    assert begun.wait(60)
    results.close()
    assert heard


def test_work_beside_others_has_one_core_by_default():
    with one_core():
        assert (cores(None), cores(3)) == (1, 3)
        assert list(in_order([lambda: cores(None)] * 2, 1)) == [1, 1]
    assert cores(2) == 2


def test_a_failure_drops_what_has_not_begun():
    begun, done = threading.Event(), []

    with pytest.raises(ValueError, match="here"), other_threads(1) as threads:  # noqa: PT012 - the block is what fails
        running = threads.submit(lambda: begun.set() or done.append("running"))
        waiting = [threads.submit(time.sleep, 0.2), threads.submit(done.append, "waiting")]
        begun.wait(10)
        raise ValueError("here")

    assert running.done()
    assert waiting[1].cancelled()
    assert done == ["running"]


@pytest.mark.parametrize("workers", [1, 2])
def test_tasks_of_a_task_do_not_begin_when_nobody_wants_their_results(workers):
    begun, stopped, done = threading.Event(), threading.Event(), []

    def long():
        for _ in in_order([lambda i=i: done.append(i) for i in range(99)], workers):
            begun.set()
            stopped.wait(10)

    results = in_order([lambda: begun.wait(10), long, lambda: time.sleep(0.1)], 2)
    assert next(results)
    threading.Timer(0.1, stopped.set).start()
    results.close()

    assert 0 < len(done) < 99


def test_as_many_tasks_as_asked_for_are_begun_ahead():
    begun = threading.Event()
    tasks = [lambda: begun.wait(10), *[lambda: None] * 9, lambda: begun.set() or True]

    assert next(in_order(tasks, 2, ahead=len(tasks)))


def test_numpyro_runs_in_one_thread_at_a_time():
    inside, most = [], []

    def task():
        with one_numpyro(), one_numpyro():
            inside.append(1)
            most.append(len(inside))
            time.sleep(0.01)
            inside.pop()

    list(in_order([task] * 4, 4))
    assert most == [1] * 4


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system has no affinities of threads")
@pytest.mark.parametrize("fewer", [0, 1])
def test_as_many_threads_as_cores_begin_on_one_each_and_may_use_all(monkeypatch, fewer):
    free, begun = {0, 1, 2}, []
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: free)
    monkeypatch.setattr(os, "sched_setaffinity", lambda _, to: begun.append((threading.get_ident(), to)))
    meet = threading.Barrier(3 - fewer, timeout=60)
    assert sum(in_order([meet.wait] * (3 - fewer), 3 - fewer)) == (1 if fewer else 3)

    own = {thread: [to for one, to in begun if one == thread] for thread, _ in begun}
    assert all(len(first) == 1 and last == free for first, last in own.values())
    assert sorted(core for first, _ in own.values() for core in first) == ([] if fewer else [0, 1, 2])


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system has no affinities of threads")
def test_threads_work_where_a_core_has_gone(monkeypatch):
    def gone(_, to):
        raise OSError

    monkeypatch.setattr(os, "sched_setaffinity", gone)
    assert list(in_order([lambda: 1] * 3, len(os.sched_getaffinity(0)))) == [1, 1, 1]
