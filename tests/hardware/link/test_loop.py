"""One loop hands out bytes, runs guards, and gives up in time."""

from itertools import pairwise

import pytest
from solidtouch.hardware.errors import NoAnswer, PortLost, StageFault
from solidtouch.hardware.link.loop import Loop


class Clock:
    """Goes on to the next line of a script, or to the end of the wait."""

    def __init__(self):
        self.time_s = 0.0
        self.script = []

    def now(self):
        return self.time_s

    def wait(self, _, until):
        if self.script and self.script[0][0] <= until:
            self.time_s, port, data = self.script.pop(0)
            port.data += data
        else:
            self.time_s = max(self.time_s, until)


class Source:
    """A port that a script fills; None breaks it."""

    def __init__(self):
        self.data = b""
        self.lost = False

    def read(self):
        if self.lost:
            raise PortLost("source: lost the port while reading; it was unplugged.")
        data, self.data = self.data, b""
        return data


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def loop(clock):
    return Loop(clock)


@pytest.fixture
def sources(loop):
    """Two attached ports and what each receiver got."""
    got = []
    ports = Source(), Source()
    for name, port in zip("ab", ports, strict=True):
        loop.attach(port, lambda data, time_s, name=name: got.append((name, time_s, data)))
    return ports, got


def test_bytes_go_to_whom_they_belong_with_the_time_they_came(clock, loop, sources):
    (a, b), got = sources
    clock.script = [(0.25, a, b"x"), (0.5, b, b"yz")]
    loop.sleep(1.0)

    assert got == [("a", 0.25, b"x"), ("b", 0.5, b"yz")]
    assert loop.now == 1.0


def test_a_detached_port_is_left_alone(clock, loop, sources):
    (a, _), got = sources
    loop.detach(a)
    loop.detach(a)
    clock.script = [(0.25, a, b"x")]
    loop.sleep(1.0)

    assert got == []
    assert a.data == b"x"


def test_a_receiver_may_detach_a_port(clock, loop, sources):
    (a, b), _ = sources
    loop.attach(a, lambda *_: loop.detach(b))
    clock.script = [(0.25, a, b"x")]
    loop.turn(1.0)
    b.lost = True
    loop.sleep(1.0)

    assert loop.now >= 1.25


def test_a_port_detached_by_a_receiver_is_not_read_in_the_same_turn(clock, loop, sources):
    (a, b), _ = sources
    b.lost = True
    loop.attach(a, lambda *_: loop.detach(b))
    clock.script = [(0.25, a, b"x")]
    loop.turn(1.0)

    assert loop.now == 0.25


def test_a_lost_port_ends_the_turn(loop, sources):
    sources[0][1].lost = True
    with pytest.raises(PortLost, match="source: lost the port"):
        loop.turn(1.0)


def test_a_lost_port_is_told_once_and_the_others_go_on(clock, loop, sources):
    (a, b), got = sources
    b.lost = True
    with pytest.raises(PortLost, match="source: lost the port"):
        loop.turn(1.0)
    clock.script = [(2.0, a, b"x")]
    loop.turn(3.0)

    assert got == [("a", 2.0, b"x")]


def test_waiting_ends_with_the_condition(clock, loop, sources):
    (a, _), got = sources
    clock.script = [(0.25, a, b"x"), (0.5, a, b"y")]
    loop.wait_for(lambda: len(got) == 1, 1.0, "never said")

    assert loop.now == 0.25


def test_a_condition_that_holds_already_takes_no_time(loop):
    loop.wait_for(lambda: True, 1.0, "never said")

    assert loop.now == 0.0


def test_silence_past_the_deadline_is_said(loop, sources):
    with pytest.raises(NoAnswer, match="stage: it did not answer"):
        loop.wait_for(lambda: False, 1.5, "stage: it did not answer.")

    assert loop.now == 1.5


def test_what_comes_just_in_time_counts(clock, loop, sources):
    (a, _), got = sources
    clock.script = [(1.0, a, b"x")]
    loop.wait_for(lambda: bool(got), 1.0, "never said")

    assert loop.now == 1.0


def objects_at(limit_s):
    def guard(now_s):
        if now_s >= limit_s:
            raise StageFault(f"too late at {now_s:g}.")

    return guard


def test_a_guard_runs_after_every_turn_inside_the_block_only(clock, loop, sources):
    clock.script = [(0.25, sources[0][0], b"x"), (0.5, sources[0][0], b"y")]
    with pytest.raises(StageFault, match=r"too late at 0.5"), loop.guarded(objects_at(0.5)):
        loop.sleep(1.0)

    loop.sleep(1.0)


def test_guards_see_what_the_turn_brought(clock, loop, sources):
    (a, _), got = sources
    clock.script = [(0.04, a, b"x")]
    seen = []
    with loop.guarded(lambda _: seen.append(len(got))):
        loop.turn(1.0)

    assert seen == [1]


def test_guards_look_while_nothing_arrives(loop):
    seen = []
    with loop.guarded(seen.append):
        loop.sleep(1.0)

    assert max(b - a for a, b in pairwise(seen)) <= 0.051


def test_without_guards_a_rig_can_be_brought_to_rest(loop):
    with loop.guarded(objects_at(0.0)):
        with loop.unguarded():
            loop.sleep(1.0)
        with pytest.raises(StageFault, match="too late"):
            loop.sleep(1.0)


def test_an_exception_inside_puts_the_guards_back(loop):
    with loop.guarded(objects_at(0.0)):
        with pytest.raises(ZeroDivisionError), loop.unguarded():
            _ = 1 / 0
        with pytest.raises(StageFault, match="too late"):
            loop.turn(1.0)
    loop.turn(1.0)


def test_a_guard_taken_twice_goes_one_at_a_time(loop):
    guard = objects_at(0.0)
    with loop.guarded(guard):
        with loop.guarded(guard):
            pass
        with pytest.raises(StageFault, match="too late"):
            loop.turn(1.0)
    loop.turn(1.0)
