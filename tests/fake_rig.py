"""A rig without devices, which taps as `Rig` does and tells its journal the same; also run as a child process."""

import math

import numpy as np
from solidtouch.hardware.link.loop import Loop
from solidtouch.hardware.recording.plan import parse_plan
from solidtouch.hardware.rig.rig import TapTally
from solidtouch.hardware.rig.settings import parse_rig
from solidtouch.hardware.skin.skin import SkinFrame
from solidtouch.models.cutting.tap_cutter import TapCutter

RIG = """
name = "fake bench"
sensor = { kind = "lines", port = "/dev/finger", taxels = 3, rate_hz = 20.0, positions_mm = [[0, 1], [2, 3.5], [4, 5]] }
range = { start_mm = 1.0, end_mm = 5.0, cell_mm = 2.0 }
tap = { depth_mm = 2.5, samples = 7, lead_samples = 2, highpass_hz = 0.5 }
[stage]
port = "/dev/stage"
x = { letter = "X", origin_mm = -60.0, low_mm = 0.0, high_mm = 17.0, speed_mm_s = 20.0 }
y = { letter = "Y", origin_mm = -40.0, low_mm = -2.0, high_mm = 3.0, speed_mm_s = 12.0 }
"""
PLAN = """
settle_taps = 1
session = 4
positions = { start_mm = 1.0, end_mm = 5.0, spacing_mm = 1.0 }
objects = [{ name = "thin", size_mm = 4 }, { name = "thick", size_mm = 6.5 }]
"""


def fake_settings():
    return parse_rig(RIG)


def fake_plan():
    return parse_plan(PLAN)


def never(_):
    """Nothing is rejected and nothing fails."""
    return False


class FakeClock:
    """Time that passes while someone waits, and at once."""

    def __init__(self):
        self.time_s = 100.0

    def now(self):
        return self.time_s

    def wait(self, _, until):
        self.time_s = until


class FakeRig:
    """Presses whatever is told to be in front of it.

    Args:
        journal: Hears of everything.
        rejected: Whether the n-th attempt, counted from 0, gives a tap that cannot be believed.
        fail: Called before every attempt with its number.
        misses: Whether the n-th attempt touches nothing.
    """

    def __init__(self, journal, settings=None, rejected=never, fail=never, misses=never):
        self.settings = settings or fake_settings()
        self.loop = Loop(FakeClock())
        self.label = {}
        self.taps = []
        self.did = []
        self.tally = TapTally()
        self._journal, self._rejected, self._fail, self._misses = journal, rejected, fail, misses
        self._rng = np.random.default_rng(7)
        self._cutter = TapCutter(self.settings.preprocessing)
        self._attempts = 0
        self._x_mm = math.nan

    def connect(self):
        self._frames(3)
        self._journal.event(self.loop.now, "stream", "the readings start")
        self._cutter = TapCutter(self.settings.preprocessing)
        return self

    def clear(self):
        self.did.append("clear")
        self._journal.command(self.loop.now, "/dev/stage", b"$J=G90\n")

    def go(self, x_mm):
        self.did.append(x_mm)
        self._x_mm = x_mm
        self._journal.command(self.loop.now, "/dev/stage", b"\x85")
        self._journal.status(self.loop.now, "Idle", (x_mm, 0.0))
        self._frames(2)

    def tap(self):
        while True:
            n, self._attempts = self._attempts, self._attempts + 1
            self._fail(n)
            record = self.settings.preprocessing
            self._frames(record.pre_samples)
            self._journal.press(self.loop.now, {**self.label, "x_mm": self._x_mm})
            self._cutter.press()
            (cut,) = self._frames(record.samples - record.pre_samples)
            rejected = self._rejected(n)
            self._journal.tap(self.loop.now, not rejected, "taxel 1 jumped" if rejected else "")
            if not rejected:
                self.tally.touched += not self._misses(n)
                self.did.append("tap")
                self.taps.append((dict(self.label), cut.samples))
                return cut.samples

    def _frames(self, n):
        cuts = []
        for _ in range(n):
            self.loop.sleep(1 / self.settings.sensor.rate_hz)
            raw = self._rng.integers(0, 1024, self.settings.sensor.taxels).astype(np.float64)
            values = 1023.0 - raw / 3
            self._journal.frame(SkinFrame(self.loop.now, raw, values, np.ones(len(raw), bool), 1000 * self.loop.now))
            cuts += self._cutter.push(values[np.newaxis])
        return cuts


class FakeOperator:
    """Puts objects there at the third look."""

    def __init__(self, looks=3):
        self.placed = []
        self._looks, self._left = looks, 0

    def place(self, what, thing):
        self.placed.append((what, thing.name))
        self._left = self._looks

    def ready(self):
        self._left -= 1
        return self._left <= 0
