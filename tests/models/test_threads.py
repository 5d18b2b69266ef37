"""Tasks on threads."""

from threading import Event

import pytest
from solidtouch.models.threads import in_order


@pytest.mark.parametrize("workers", [1, 3])
def test_results_come_in_order(workers):
    tasks = [lambda i=i: i * i for i in range(20)]
    assert list(in_order(tasks, workers)) == [i * i for i in range(20)]


def test_tasks_under_way_hear_that_nobody_wants_their_results():
    """As after Ctrl-C; otherwise whoever stops would wait for all that has begun."""
    unwanted, heard = Event(), []

    def task(number):
        if number:
            heard.append(unwanted.wait(20))
        return number

    results = in_order([lambda i=i: task(i) for i in range(9)], 2, unwanted)
    assert next(results) == 0
    results.close()
    assert heard
    assert all(heard)
