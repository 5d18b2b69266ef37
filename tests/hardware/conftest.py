"""Small rigs, whose sizes are pairwise different so that a swapped axis cannot pass, and ports without a system.

A `ScriptedPort` plays `(sent, answered)` exchanges and fails on any other byte; a `WiredPort` has an emulated device
behind it. Time goes on only while someone waits for them. A `RigBench` is everything, on pseudo-terminals.
"""

import math
from collections import deque
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from solidtouch.hardware.emulator.emulated_bench import emulated_bench
from solidtouch.hardware.emulator.wired_port import ManualClock, MemoryPort, WiredPort
from solidtouch.hardware.errors import RigError, WriteTimeout
from solidtouch.hardware.journal import NoJournal
from solidtouch.hardware.link.loop import Loop
from solidtouch.hardware.rig.open_rig import build_rig, connected
from solidtouch.hardware.simulator.settings import PAPER_RODS, PRESETS
from solidtouch.models.grid import ClassGrid

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


class Diary(NoJournal):
    """A journal that remembers, and can act in the middle of what happens.

    Attributes:
        log: Kind and content of everything but readings, in order.
        frames: Readings.
    """

    def __init__(self):
        self.log = []
        self.frames = []
        self.acts = {}

    def when(self, kind, act, condition=bool):
        """Does something once, the next time that this happens with a content that fulfils the condition."""
        self.acts[kind] = (condition, act)

    def all(self, kind):
        return [content for what, content in self.log if what == kind]

    def sent(self, port):
        return [data for address, data in self.all("command") if address == port]

    def frame(self, frame):
        self.frames.append(frame)
        self._act("frame", frame)

    def status(self, time_s, state, position_mm):
        self._note("status", (time_s, state, position_mm))

    def command(self, _, port, data):
        self._note("command", (port, data))

    def press(self, time_s, label):
        self._note("press", (time_s, dict(label)))

    def tap(self, _, accepted, reason):
        self._note("tap", (accepted, reason))

    def event(self, _, kind, text, **__):
        self._note("event", (kind, text))

    def _note(self, kind, content):
        self.log.append((kind, content))
        self._act(kind, content)

    def _act(self, kind, content):
        condition, act = self.acts.get(kind, (None, None))
        if condition is not None and condition(content):
            del self.acts[kind]
            act()


_NEAR_MM = (8.0, -1.0)


class RigBench:
    """A whole emulated bench, which knows where its finger truly is and what it truly felt.

    Attributes:
        settings: What stands there.
        diary: Hears of everything.
        places: Where the finger was at each reading, x and y.
        felt: What it felt then.
    """

    def __init__(self, bench):
        self.settings = bench.rig
        self.emulation = bench.emulation
        self.clock = bench.clock
        self.diary = Diary()
        self.places, self.felt = [], []
        self._deep = None
        self._read = bench.emulation.finger.read
        bench.emulation.finger.read = self._watch

    @property
    def place_mm(self):
        return tuple(self.emulation.state()["place_mm"])

    @property
    def is_clear(self):
        return self.place_mm[1] <= self.settings.tap.clear_mm + 0.01

    @property
    def stage_port(self):
        return self.settings.stage.port

    @property
    def open_ports(self):
        return [name for name, is_open in self.emulation.control({})["open"].items() if is_open]

    def build(self, journal=None, settings=None):
        """A rig on this bench, not connected."""
        return build_rig(settings or self.settings, self.clock, journal or self.diary)

    @contextmanager
    def rig(self, home=False, settings=None, journal=None):
        """A rig in the middle of the range, before the thickest object."""
        self.emulation.control({"object": len(self.emulation.objects) - 1})
        with connected(self.build(journal, settings), home) as rig:
            limits = self.settings.range
            rig.go(limits.start_mm + (limits.where_classes // 2 + 0.5) * limits.cell_mm)
            self.diary.log.clear()
            yield rig

    def on(self, fault, **how):
        self.emulation.control({"on": fault, **how})

    def off(self):
        self.emulation.control({"off": None})

    def struck(self, fault):
        return self.emulation.switches.tally()[fault]

    def once_deep(self, act):
        """Does something once when the finger is on the object."""
        self._deep = act

    def deviation(self, samples):
        """The largest difference of a tap from the readings in a row most like it, up to each taxel's zero."""
        J, felt = len(samples), np.array(self.felt)
        difference = [samples - felt[start : start + J] for start in range(len(felt) - J + 1)]
        return min(float(np.abs(d - np.median(d, axis=0)).max()) for d in difference)

    def _watch(self, time_s):
        counts = self._read(time_s)
        self.places.append(self.place_mm)
        self.felt.append(np.array(counts))
        if self._deep is not None and self.places[-1][1] > self.settings.tap.depth_mm - 0.8:
            act, self._deep = self._deep, None
            act()
        return counts


@pytest.fixture
def rig_bench(tmp_path):
    """A bench with a fingertip that is homed, near the place that `RigBench.rig` goes to.

    The way there from where homing ends takes 4 s, three quarters of the time of most tests.
    """
    with emulated_bench(tmp_path, seed=3, homed=True, place_mm=_NEAR_MM) as bench:
        yield RigBench(bench)


@pytest.fixture
def make_bench(tmp_path):
    """A function that makes benches, one after the other."""

    @contextmanager
    def make(settings=PRESETS["paper"], **options):
        known = {"seed": 3, "homed": True, **options}
        with emulated_bench(tmp_path, settings, **{"place_mm": _NEAR_MM if known["homed"] else None, **known}) as bench:
            yield RigBench(bench)

    return make
