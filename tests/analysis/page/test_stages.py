"""Stages and checks with their seconds."""

from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from threading import Event

import numpy as np
from solidtouch.analysis.page.stages import StageClock, timed_check


def test_checks_are_timed():
    check = timed_check("a", "b", lambda: ("c", True))

    assert check[:4] == ("a", "b", "c", True)
    assert 0 <= check.seconds < 1
    assert np.isfinite(check.seconds)


def test_stages_side_by_side_have_bars_and_times_in_the_order_of_their_beginning():
    bars, shown, ready = [], Counter(), Event()

    def progress(name, total):
        bars.append((name, total))
        return lambda done: shown.update({name: done})

    def work(advance):
        advance(1)
        assert ready.wait(10)
        return "found"

    clock = StageClock(progress)
    with ThreadPoolExecutor(1) as threads:
        first, second = (clock.beside(threads, name, work, total=3) for name in ("first", "second"))
        with clock.stage("here"):
            ready.set()

    assert (first.result(), second.result()) == ("found", "found")
    assert bars == [("first", 3), ("second", 3), ("here", 1)]
    assert list(clock.elapsed_s) == ["first", "second", "here"]
    assert shown == {"first": 3, "second": 3, "here": 1}
