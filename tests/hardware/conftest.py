"""Small rigs, whose sizes are pairwise different so that a swapped axis cannot pass, and ports without a system.

A `ScriptedPort` plays `(sent, answered)` exchanges and fails on any other byte; a `WiredPort` has an emulated device
behind it. Time goes on only while someone waits for them.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from solidtouch.hardware.errors import PortLost, RigError, WriteTimeout
from solidtouch.hardware.loop import Loop
from solidtouch.hardware.presets import PRESETS
from solidtouch.hardware.simulation_settings import PAPER_RODS
from solidtouch.models.classes import ClassGrid

WITHOUT_NOISE = {"white_counts": 0.0}


@pytest.fixture
def small():
    """The paper's rig with 2 rods, 4 where classes around the centre and 5 taps of 10 samples in each."""
    return replace(
        PRESETS["paper"], rods=PAPER_RODS[:2], start_mm=6.0, end_mm=10.0, spacing_mm=0.2, rate_hz=10.0, lag_s=0.02
    )


@pytest.fixture
def exact():
    """The preset `ideal` without its white noise."""
    return replace(PRESETS["ideal"], **WITHOUT_NOISE)


@pytest.fixture
def grid():
    """5 where classes of 1 mm and 2 what classes."""
    edges = np.arange(6.0)
    return ClassGrid(edges[:-1] + 0.5, "mm", edges, (("thin",), ("thick",)), np.array([4.0, 12.0]), "mm")


@pytest.fixture
def rng():
    return np.random.default_rng(20)


class ManualClock:
    """Time that goes on only while someone waits: to the next byte of a port, or to the end of the wait."""

    def __init__(self):
        self.time_s = 0.0

    def now(self):
        return self.time_s

    def wait(self, ports, until):
        while not any(port.waiting() for port in ports):
            due = min((port.next_event_s() for port in ports), default=math.inf)
            self.time_s = max(self.time_s, min(due, until))
            for port in ports:
                port.step()
            if due > until:
                return


class MemoryPort:
    """What `Port` offers, without a system; `failure` is raised by every use as if the port had failed so."""

    def __init__(self, clock, address):
        self.address = address
        self.clock = clock
        self.is_open = False
        self.sent = self.received = 0
        self.failure: RigError | None = None
        self.incoming = bytearray()

    def open(self):
        self.is_open = True

    def close(self):
        self.is_open = False

    def read(self):
        self.check()
        data = bytes(self.incoming)
        self.incoming.clear()
        self.received += len(data)
        return data

    def write(self, data):
        self.check()
        self.sent += len(data)

    def waiting(self):
        return len(self.incoming) if self.is_open and self.failure is None else 1

    def fileno(self):
        return None

    def check(self):
        if self.failure is not None:
            self.is_open &= not isinstance(self.failure, PortLost)
            raise self.failure
        if not self.is_open:
            raise PortLost(f"{self.address}: the port is closed.")


class ScriptedPort(MemoryPort):
    """Plays exchanges `(sent, answered)` or `(sent, answered, after_s)`.

    Nothing sent means that the answer comes unasked, `after_s` behind the exchange before. An answer may be an error:
    `WriteTimeout` is raised by the write, any other by the next read.
    """

    def __init__(self, clock, exchanges, address):
        super().__init__(clock, address)
        self.exchanges = deque((*exchange, 0.0)[:3] for exchange in exchanges)
        self.written = b""
        self.answers = []

    def open(self):
        super().open()
        self.advance()

    def write(self, data):
        super().write(data)
        self.written += bytes(data)
        self.advance()

    def next_event_s(self):
        return min((time_s for time_s, _ in self.answers), default=math.inf)

    def step(self):
        due = [answer for time_s, answer in self.answers if time_s <= self.clock.now()]
        self.answers = [(time_s, answer) for time_s, answer in self.answers if time_s > self.clock.now()]
        for answer in due:
            if isinstance(answer, RigError):
                self.failure = answer
            else:
                self.incoming += answer

    def advance(self):
        start_s = self.clock.now()
        while self.exchanges:
            sent, answered, after_s = self.exchanges[0]
            if not self.written.startswith(sent):
                break
            self.written = self.written[len(sent) :]
            self.exchanges.popleft()
            if isinstance(answered, WriteTimeout):
                raise answered
            start_s += after_s
            self.answers.append((start_s, answered))
        self.step()
        expected = self.exchanges[0][0] if self.exchanges else b""
        assert expected.startswith(self.written), f"sent {self.written!r} instead of {expected!r}"

    def assert_over(self):
        assert not self.exchanges, f"never sent {[sent for sent, *_ in self.exchanges]}"
        assert not self.written, f"sent {self.written!r} at the end"


class WiredPort(MemoryPort):
    """Has an emulated device behind it; `wire` may change what the device sends.

    Attributes:
        log: All bytes sent.
    """

    def __init__(self, clock, device, address, wire: Callable[[bytes], bytes] = bytes):
        super().__init__(clock, address)
        self.device = device
        self.wire = wire
        self.log = b""

    def open(self):
        if not self.is_open:
            super().open()
            self.device.opened(self.clock.now())

    def close(self):
        if self.is_open:
            super().close()
            self.incoming.clear()
            self.device.closed(self.clock.now())

    def write(self, data):
        super().write(data)
        self.log += bytes(data)
        self.device.receive(bytes(data), self.clock.now())
        self.step()

    def next_event_s(self):
        return self.device.next_event_s()

    def step(self):
        if data := self.device.step(self.clock.now()):
            self.incoming += self.wire(data)


@pytest.fixture
def clock():
    return ManualClock()


@pytest.fixture
def loop(clock):
    return Loop(clock)


@pytest.fixture
def scripted(clock):
    """A function that makes a port from exchanges; at the end of the test all of them must have happened."""
    ports = []

    def make(*exchanges, address="scripted"):
        ports.append(ScriptedPort(clock, exchanges, address))
        return ports[-1]

    yield make
    for port in ports:
        port.assert_over()


@pytest.fixture
def wired(clock):
    """A function that makes a port with an emulated device behind it."""

    def make(device, address="wired", **options):
        return WiredPort(clock, device, address, **options)

    return make
