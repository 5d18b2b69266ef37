"""`collect` as a person types it, with a rig without devices in place of the one that `open_rig` opens."""

import os
import re
import resource
import signal
import sys
from contextlib import contextmanager
from types import SimpleNamespace

import pytest
from solidtouch.cli.shared.operators import Emulator, Person
from solidtouch.hardware.errors import StaleSensor
from solidtouch.hardware.recording.plan import ObjectSettings
from solidtouch.models.errors import InputError
from solidtouch.models.io.rig import read_rig
from solidtouch.models.taps import TapSet


class Bench:
    """What `open_rig` gives: rigs that fail as the test wants, with an emulator that changes the objects."""

    def __init__(self, fake_rig):
        self.fake_rig = fake_rig
        self.fail = fake_rig.never
        self.orders = []
        self.opened = []

    @contextmanager
    def open_rig(self, settings, journal, home=False):
        self.opened.append(home)
        rig = self.fake_rig.FakeRig(journal, settings, fail=self.fail)
        rig.emulator = SimpleNamespace(control=self.orders.append)
        self.fail(-1)
        yield rig.connect()
        rig.clear()


@pytest.fixture
def bench(fake_rig, monkeypatch):
    bench = Bench(fake_rig)
    monkeypatch.setitem(sys.modules, "solidtouch.hardware.rig.open_rig", SimpleNamespace(open_rig=bench.open_rig))
    return bench


@pytest.fixture
def words(fake_rig, tmp_path):
    (tmp_path / "rig.toml").write_text(fake_rig.RIG)
    (tmp_path / "plan.toml").write_text(fake_rig.PLAN)
    return "collect", tmp_path / "rig.toml", tmp_path / "plan.toml", "--out", tmp_path / "a.mcap"


def stop_at(attempt, act):
    def fail(n):
        if n == attempt:
            act()

    return fail


def stale():
    raise StaleSensor("/dev/finger: no reading for 150 ms.")


def test_a_plan_becomes_a_tap_set(bench, words, command, tmp_path):
    done = command(*words, "--home", "--yes", "--session", 9)

    assert done.code == 0
    assert "a.mcap: 8 taps" in done.out
    assert bench.opened == [True]
    assert bench.orders == [{"object": "thin"}, {"object": "thick"}]
    assert command("convert", tmp_path / "a.mcap", tmp_path / "a.nc").code == 0
    taps = TapSet.load(tmp_path / "a.nc")
    assert taps.taps.shape == (8, 7, 3)
    assert set(taps.session) == {9}
    assert command("inspect", tmp_path / "a.mcap").code == 0


STOPS = {
    "a device": (stale, 3, "no reading for 150 ms"),
    "ctrl-c": (lambda: signal.raise_signal(signal.SIGINT), 130, "interrupted"),
    "sigterm": (lambda: signal.raise_signal(signal.SIGTERM), 143, "interrupted"),
}


@pytest.mark.parametrize("case", STOPS)
def test_a_collection_that_was_stopped_goes_on_where_it_was(case, bench, words, command, tmp_path):
    """It says how many taps are kept, and ends with every trial once."""
    act, code, message = STOPS[case]
    bench.fail = stop_at(6, act)
    stopped = command(*words)

    assert (stopped.code, message in stopped.err) == (code, True)
    assert "4 of 8 taps recorded; continue with --resume." in " ".join(stopped.err.split())
    bench.fail = bench.fake_rig.never
    assert command(*words).code == 2
    assert command(*words, "--resume").code == 0
    assert [tap.label.trial for tap in read_rig(tmp_path / "a.mcap").taps] == list(range(8))
    opened = len(bench.opened)
    assert command(*words, "--resume").code == 0
    assert len(bench.opened) == opened


@pytest.mark.parametrize("room", [0, 1, 700, 5000])
def test_a_disk_that_fills_costs_nothing_that_is_said_to_be_kept(room, bench, words, command, tmp_path):
    path, before = tmp_path / "a.mcap", resource.getrlimit(resource.RLIMIT_FSIZE)
    fill = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + room, before[1]))  # noqa: E731
    bench.fail = stop_at(6, fill)
    try:
        stopped = command(*words)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)

    assert stopped.code == 2
    assert re.search(r"^solidtouch: .*a\.mcap: writing failed: File too large; .*\.$", stopped.err, re.MULTILINE)
    kept = [tap.label.trial for tap in read_rig(path).taps]
    assert f"{len(kept)} of 8 taps recorded; continue with --resume." in " ".join(stopped.err.split())
    assert len(kept) >= 4
    bench.fail = bench.fake_rig.never
    assert command(*words, "--resume").code == 0
    assert [tap.label.trial for tap in read_rig(path).taps] == list(range(8))


def test_a_rig_that_cannot_be_opened_leaves_no_file(bench, words, command, tmp_path):
    bench.fail = stop_at(-1, stale)

    assert command(*words).code == 3
    assert not (tmp_path / "a.mcap").exists()


def test_what_was_lost_is_told_on_resuming(bench, words, command, tmp_path):
    bench.fail = stop_at(6, stale)
    command(*words)
    path = tmp_path / "a.mcap"
    path.write_bytes(path.read_bytes()[:-3000])
    bench.fail = bench.fake_rig.never
    done = command(*words, "--resume")

    assert done.code == 0
    assert "bytes are damaged; earlier taps are kept" in " ".join(done.err.split())
    path.write_bytes(path.read_bytes() + b"12")
    assert "Damaged: the last 2 bytes are damaged." in command("convert", path, tmp_path / "a.nc").out


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("spacing_mm = 1.0", "spacing_mm = 3.0", "a whole number of spacings"),
        ("start_mm = 1.0", "start_mm = 0.0", "positions: 0.5 mm is outside the range of the rig"),
        ("session = 4", "sesion = 4", "unknown key `sesion`"),
    ],
)
def test_a_plan_that_does_not_fit_moves_nothing(old, new, message, bench, words, command, tmp_path):
    plan = tmp_path / "plan.toml"
    plan.write_text(plan.read_text().replace(old, new))
    done = command(*words)

    assert (done.code, message in done.err) == (2, True)
    assert not bench.opened
    assert not (tmp_path / "a.mcap").exists()


def test_a_person_is_asked_and_waited_for():
    """Any line goes on, and only a whole one."""
    read, write = os.pipe()
    said = []
    person = Person(said.append, read)
    person.place(1, ObjectSettings(name="thick rod"))
    try:
        assert not person.ready()
        os.write(write, b"ok\n")
        assert [person.ready() for _ in range(4)] == [False, False, True, False]
        assert said == ["Put the thick rod under the finger, take your hands away and press Enter."]
    finally:
        os.close(write)
        with pytest.raises(InputError, match="Standard input ended"):
            person.ready()
        os.close(read)


def test_an_emulator_changes_the_object_by_its_name():
    orders = []
    emulator = Emulator(SimpleNamespace(control=orders.append))
    emulator.place(1, ObjectSettings(name="thick rod"))

    assert emulator.ready()
    assert orders == [{"object": "thick rod"}]
