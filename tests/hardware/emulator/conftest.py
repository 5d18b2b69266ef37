"""Devices small enough to foresee every byte of."""

import math

import pytest
from solidtouch.hardware.emulator.bench import Bench
from solidtouch.hardware.emulator.emulation import Emulation
from solidtouch.hardware.emulator.faults import Switches
from solidtouch.hardware.emulator.link import Link
from solidtouch.hardware.emulator.shared_clock import SharedClock
from solidtouch.hardware.link.loop import HostClock
from solidtouch.hardware.link.port import Port


class Echo:
    """Sends every byte back after a delay, and keeps a log of all that it saw."""

    def __init__(self, delay_s=0.01):
        self.delay_s = delay_s
        self.log = []
        self.pending = []

    def opened(self, time_s):
        self.log.append((time_s, "opened"))

    def closed(self, time_s):
        self.log.append((time_s, "closed"))

    def receive(self, data, time_s):
        self.log.append((time_s, data))
        self.pending.append((time_s + self.delay_s, data))

    def next_event_s(self):
        return self.pending[0][0] if self.pending else math.inf

    def step(self, time_s):
        data = b""
        while self.next_event_s() <= time_s:
            data += self.pending.pop(0)[1]
        return data

    @property
    def seen(self):
        return [what for _, what in self.log]


class Ticker(Echo):
    """Sends a numbered line every 20 ms while it is open."""

    def __init__(self):
        super().__init__()
        self.next_s = math.inf
        self.number = 0

    def opened(self, time_s):
        super().opened(time_s)
        self.next_s = time_s + 0.02

    def closed(self, time_s):
        super().closed(time_s)
        self.next_s = math.inf

    def next_event_s(self):
        return self.next_s

    def step(self, time_s):
        data = b""
        while self.next_s <= time_s:
            self.number += 1
            self.next_s += 0.02
            data += b"%d\n" % self.number
        return data


class Finger:
    """Has nothing before it."""

    what = None


class SmallBench:
    """An echo on the stage's port and a ticker on the sensor's, with ports for a program."""

    def __init__(self, folder):
        self.switches = Switches(seed=1)
        self.echo, self.ticker = Echo(), Ticker()
        self.finger = Finger()
        self.links = [
            Link("stage", folder / "stage", self.echo, self.switches),
            Link("sensor", folder / "finger", self.ticker, self.switches),
        ]
        self.bench = Bench(self.links)
        self.emulation = Emulation(self.bench, self.switches, self.finger, lambda time_s: (time_s, 0.0), ["a", "b"])
        self.clock = SharedClock(self.emulation)
        self.stage, self.sensor = Port(str(folder / "stage")), Port(str(folder / "finger"))

    def collect(self, port, seconds):
        """All that a port brings for a while, each part with its time."""
        until, parts = self.clock.now() + seconds, []
        while self.clock.now() < until:
            self.clock.wait([port], until)
            if data := port.read():
                parts.append((self.clock.now(), data))
        return parts

    def heard(self, port, seconds):
        """The same as one string of bytes."""
        return b"".join(data for _, data in self.collect(port, seconds))

    def close(self):
        for port in (self.stage, self.sensor):
            port.close()
        self.bench.close()


@pytest.fixture
def small_bench(tmp_path):
    bench = SmallBench(tmp_path)
    yield bench
    bench.close()


@pytest.fixture
def host():
    return HostClock()
