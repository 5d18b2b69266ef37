"""The recorder loses nothing that it was told, whatever happens to its process or its disk."""

import os
import resource
import signal
import stat
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from solidtouch.hardware.recording import collection, recording
from solidtouch.hardware.recording.collection import collect, resume_recording
from solidtouch.hardware.recording.recording import Recorder
from solidtouch.hardware.recording.settings import about_rig, differences
from solidtouch.hardware.skin.skin import SkinFrame
from solidtouch.models.errors import InputError
from solidtouch.models.io.rig import read_rig
from solidtouch.models.io.rig_reader import RecordingReader
from solidtouch.models.io.rig_recording import Command, Event, Frame, Status


@pytest.fixture
def about(fake_rig):
    return about_rig(fake_rig.fake_settings(), fake_rig.RIG, fake_rig.fake_plan())


def run(fake_rig, recorder, trials=range(8), **options):
    plan = fake_rig.fake_plan()
    rig = fake_rig.FakeRig(recorder, **options).connect()
    taps = [tap for tap in plan.taps() if tap.trial in trials]
    collect(rig, taps, plan.objects, plan.settle_taps, fake_rig.FakeOperator(), recorder)
    return rig


def contents(path, kind):
    return [entry.content for entry in RecordingReader(path) if isinstance(entry.content, kind)]


def test_everything_told_is_in_the_file(about, tmp_path):
    with Recorder.create(tmp_path / "a.mcap", about) as recorder:
        recorder.frame(SkinFrame(1.0, np.array([2.5, 3]), np.array([-2.5, -3]), np.array([True, False]), 17.0))
        recorder.frame(SkinFrame(1.0, np.array([2.5, 3]), np.array([-2.5, -3]), np.array([True, False])))
        recorder.status(2.0, "Idle", (1.5, -0.5))
        recorder.status(2.5, "Alarm", None)
        recorder.command(3.0, "/dev/stage", b"\x85G1\n")
        recorder.event(4.0, "lost", "two were lost", count=np.int64(2), where=np.arange(2.0), path=Path("a"))
    path = tmp_path / "a.mcap"

    assert contents(path, Frame)[0] == Frame(1.0, [2.5, 3], [-2.5, -3], [True, False], 17.0)
    assert contents(path, Frame)[1] == Frame(1.0, [2.5, 3], [-2.5, -3], [True, False])
    assert contents(path, Status) == [Status(2.0, "Idle", 1.5, -0.5), Status(2.5, "Alarm")]
    assert contents(path, Command) == [Command(3.0, "/dev/stage", "\\x85G1\n", "8547310a")]
    assert contents(path, Event) == [
        Event(4.0, "lost", "two were lost", {"count": 2, "where": [0.0, 1.0], "path": "a"})
    ]


def test_the_log_time_is_the_wall_clock_plus_rig_time(about, tmp_path):
    with Recorder.create(tmp_path / "a.mcap", about, lambda: 5_000_000_000) as recorder:
        recorder.event(1000.0, "a", "")
        recorder.event(1000.25, "b", "")
    times = [entry.log_time_ns for entry in RecordingReader(tmp_path / "a.mcap")]

    assert times == [5_000_000_000, 5_000_000_000, 5_250_000_000]


def test_a_message_is_with_the_system_when_the_call_returns(about, tmp_path):
    """So that killing the process loses none."""
    recorder = Recorder.create(tmp_path / "a.mcap", about)
    for n in range(20):
        recorder.event(float(n), "count", "")

        assert len(contents(tmp_path / "a.mcap", Event)) == n + 1
    recorder.finish()


def test_every_tap_is_synced_before_the_next(about, fake_rig, tmp_path, monkeypatch):
    """The disk has all that was written when `tap` returns."""
    path, synced = tmp_path / "a.mcap", []
    monkeypatch.setattr(recording.os, "fsync", lambda _: synced.append(path.stat().st_size))
    recorder = Recorder.create(path, about)
    rig = fake_rig.FakeRig(recorder).connect()
    for n in range(3):
        before = len(synced)
        rig.tap()

        assert len(synced) == before + 1
        assert synced[-1] == path.stat().st_size
        assert recorder.presses == n + 1
    recorder.finish()


def test_taps_with_a_label_are_counted(about, fake_rig, tmp_path):
    with Recorder.create(tmp_path / "a.mcap", about) as recorder:
        run(fake_rig, recorder, rejected=lambda n: n % 3 == 1)

    assert recorder.taps == 8
    assert recorder.presses > 10


def test_what_comes_after_the_end_is_forgotten(about, tmp_path):
    recorder = Recorder.create(tmp_path / "a.mcap", about)
    recorder.finish()
    size = (tmp_path / "a.mcap").stat().st_size
    recorder.event(1.0, "late", "")
    recorder.tap(1.0, True, "")
    recorder.finish()

    assert (tmp_path / "a.mcap").stat().st_size == size


@pytest.mark.parametrize("stop", [KeyboardInterrupt, SystemExit, RuntimeError])
def test_an_exception_ends_the_file_properly(about, tmp_path, stop):
    recorder = Recorder.create(tmp_path / "a.mcap", about)
    recorder.event(1.0, "a", "")
    with pytest.raises(stop), recorder:
        raise stop
    with (tmp_path / "a.mcap").open("rb") as file:
        assert make_reader(file).get_summary().statistics.message_count == 2


def test_ctrl_c_never_tears_a_message(about, tmp_path):
    """The interrupt arrives after the message that it met."""
    recorder = Recorder.create(tmp_path / "a.mcap", about)
    add = recorder._writer.add_message

    def interrupted(*words):
        signal.raise_signal(signal.SIGINT)
        add(*words)

    recorder._writer.add_message = interrupted
    with pytest.raises(KeyboardInterrupt):
        recorder.event(1.0, "met", "")
    recorder._writer.add_message = add
    recorder.finish()

    assert [event.kind for event in contents(tmp_path / "a.mcap", Event)] == ["met"]


@contextmanager
def full_disk(left, path):
    """No file can grow beyond its size now plus `left`."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + left, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("left", [0, 1, 137, 700])
def test_a_full_disk_raises_only_where_the_finger_is_off(about, fake_rig, tmp_path, left):
    """Readings and commands go on unrecorded; the next press or tap says why, and what was written can be read."""
    path = tmp_path / "a.mcap"
    recorder = Recorder.create(path, about)
    rig = fake_rig.FakeRig(recorder).connect()
    rig.label = {"trial": 0, "what": 0, "where_mm": 1.5, "session": 0}
    rig.tap()
    with full_disk(left, path):
        for n in range(20):
            recorder.event(float(n), "a", "x" * 100)
        recorder.command(1.0, "/dev/stage", b"!")
        for call in (lambda: recorder.press(1.0, {}), lambda: recorder.tap(1.0, True, ""), recorder.sync):
            with pytest.raises(InputError, match=r"a\.mcap: writing failed: .*; the recording so far"):
                call()
        with pytest.raises(InputError, match="writing failed"):
            recorder.finish()
    recorder.finish()

    assert len(read_rig(path).taps) == 1


def test_a_full_disk_at_the_start_leaves_no_file(about, tmp_path):
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    try:
        with pytest.raises(InputError, match=r"a\.mcap: writing failed: File too large"):
            Recorder.create(tmp_path / "a.mcap", about)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)

    assert not list(tmp_path.iterdir())


def test_an_error_inside_is_not_hidden_by_a_full_disk(about, tmp_path):
    path = tmp_path / "a.mcap"
    with pytest.raises(RuntimeError, match="first"), Recorder.create(path, about), full_disk(0, path):
        raise RuntimeError("first")


def test_a_recording_is_not_started_where_it_cannot_be(about, tmp_path):
    (tmp_path / "there.mcap").write_bytes(b"x")
    with pytest.raises(InputError, match=r"there\.mcap: already exists; resume the recording \(--resume\)"):
        Recorder.create(tmp_path / "there.mcap", about)
    with pytest.raises(InputError, match=r"must end in \.mcap"):
        Recorder.create(tmp_path / "a.nc", about)
    with pytest.raises(InputError, match="no folder"):
        Recorder.create(tmp_path / "no" / "a.mcap", about)
    assert (tmp_path / "there.mcap").read_bytes() == b"x"


@pytest.mark.parametrize("damage", [0, 1, 20, 300, "finished"])
def test_a_resumed_recording_goes_on_after_what_can_be_read(about, fake_rig, tmp_path, damage):
    """Whether it was ended or killed; the file stays readable by others, and the trials are told."""
    path = tmp_path / "a.mcap"
    recorder = Recorder.create(path, about)
    first = run(fake_rig, recorder, range(3))
    whole = path.read_bytes()
    recorder.finish()
    if damage != "finished":
        path.write_bytes(whole[: len(whole) - damage])
    path.chmod(0o640)
    recovered = resume_recording(path, about)
    with recovered.recorder as recorder:
        second = run(fake_rig, recorder, set(range(8)) - recovered.trials)
    read = read_rig(path)

    assert [tap.label.trial for tap in read.taps] == list(range(8))
    assert bool(recovered.lost) == (damage not in (0, "finished"))
    assert read.lost == ""
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.mcap"]
    made = [samples for label, samples in first.taps[: 1 + len(recovered.trials)] + second.taps if label]
    assert all(np.array_equal(tap.samples, samples) for tap, samples in zip(read.taps, made, strict=True))
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_summary().statistics.message_count == sum(1 for _ in reader.iter_messages())


def test_a_failed_resumption_leaves_the_old_file_as_it_was(about, fake_rig, tmp_path):
    path = tmp_path / "a.mcap"
    with Recorder.create(path, about) as recorder:
        run(fake_rig, recorder, range(2))
    whole = path.read_bytes()
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(whole) // 2, before[1]))
    try:
        with pytest.raises(InputError, match=r"a\.mcap: writing failed: File too large"):
            Recorder.resume(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)

    assert path.read_bytes() == whole
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.mcap"]


def test_two_programs_do_not_record_to_one_file(about, fake_rig, tmp_path):
    path = tmp_path / "a.mcap"
    with Recorder.create(path, about) as recorder:
        run(fake_rig, recorder, range(1))
        size = path.stat().st_size
        with pytest.raises(InputError, match=r"a\.mcap: another program is recording to it"):
            Recorder.resume(path)
        assert path.stat().st_size == size
    with Recorder.resume(path), pytest.raises(InputError, match="another program is recording to it"):
        Recorder.resume(path)


def test_a_recording_is_read_when_nobody_else_can_add_to_it(about, fake_rig, tmp_path, monkeypatch):
    """Taps that another program adds after that would be made twice."""
    path = tmp_path / "a.mcap"
    with Recorder.create(path, about) as recorder:
        run(fake_rig, recorder, range(2))

    def read(name):
        with pytest.raises(InputError, match="another program is recording to it"):
            Recorder.resume(name)
        return read_rig(name)

    monkeypatch.setattr(collection, "read_rig", read)
    with resume_recording(path, about).recorder:
        assert len(read_rig(path).taps) == 2


def test_nothing_to_resume_is_said(about, tmp_path):
    with pytest.raises(InputError, match=r"a\.mcap: cannot read: No such file"):
        Recorder.resume(tmp_path / "a.mcap")
    (tmp_path / "b.mcap").write_bytes(b"\x89MCAP")
    with pytest.raises(InputError, match="cannot resume: the description of rig and plan is missing; delete the file"):
        Recorder.resume(tmp_path / "b.mcap")
    assert len(list(tmp_path.iterdir())) == 1


def test_another_plan_or_rig_is_refused_by_name(about, fake_rig, tmp_path):
    """Where the devices are plugged in may change, as may comments."""
    path = tmp_path / "a.mcap"
    with Recorder.create(path, about) as recorder:
        run(fake_rig, recorder, range(2))
    whole = path.read_bytes()
    plan = fake_rig.parse_plan(fake_rig.PLAN.replace("spacing_mm = 1.0", "spacing_mm = 2.0"))
    with pytest.raises(InputError, match=r"plan\.positions\.spacing_mm is 2\.0 here and 1\.0 in the recording"):
        resume_recording(path, about_rig(fake_rig.fake_settings(), "", plan))
    deeper = fake_rig.parse_rig(fake_rig.RIG.replace("depth_mm = 2.5", "depth_mm = 2.6"))
    with pytest.raises(InputError, match=r"settings\.tap\.depth_mm is 2\.6 here and 2\.5 in the recording"):
        resume_recording(path, about_rig(deeper, "", fake_rig.fake_plan()))
    assert path.read_bytes() == whole
    moved = fake_rig.parse_rig(fake_rig.RIG.replace("/dev/stage", "/dev/other").replace("/dev/finger", "/dev/x"))
    assert differences(about_rig(moved, "# comment", fake_rig.fake_plan()), about) == []


CHILD = """
import itertools, os, sys
sys.path.insert(0, sys.argv[1])
from fake_rig import FakeRig, fake_plan, fake_settings
from solidtouch.hardware.recording.settings import about_rig
from solidtouch.hardware.recording.recording import Recorder

def record(path):
    recorder = Recorder.create(path, about_rig(fake_settings(), "", fake_plan()))
    rig = FakeRig(recorder).connect()
    for trial in itertools.count():
        rig.label = {"trial": trial, "what": 0, "where_mm": 1.5, "session": 0}
        rig.tap()
        print(f"{trial}\\n", end="", flush=True)  # at once, so that no half of a line is said

for path in sys.argv[2:]:
    child = os.fork()
    if not child:
        print(os.getpid(), flush=True)
        record(path)
    os.waitpid(child, 0)
    print("killed", flush=True)
"""


def test_a_killed_process_loses_nothing_but_the_tap_in_progress(about, fake_rig, tmp_path, rng):
    """Killed at several random moments; every tap that was reported done is in the file."""
    folder = Path(fake_rig.__file__).parent
    paths = [tmp_path / f"{n}.mcap" for n in range(3)]
    with subprocess.Popen(
        [sys.executable, "-c", CHILD, folder, *paths], stdout=subprocess.PIPE, text=True
    ) as recorders:
        said = iter(recorders.stdout.readline, "")
        for path, wait_s in zip(paths, rng.uniform(0.0, 0.05, size=len(paths)), strict=True):
            child = int(next(said))
            next(said)
            time.sleep(wait_s)
            os.kill(child, signal.SIGKILL)
            done = 1 + len([*iter(said.__next__, "killed\n")])
            read = read_rig(path)

            assert [tap.label.trial for tap in read.taps] == list(range(len(read.taps)))
            assert done <= len(read.taps) <= done + 1
            recovered = resume_recording(path, about)
            with recovered.recorder:
                assert recovered.trials == frozenset(range(len(read.taps)))


def test_a_clock_that_jumps_back_changes_no_order(about, fake_rig, tmp_path):
    """Between two parts of a recording."""
    path = tmp_path / "a.mcap"
    with Recorder.create(path, about, wall_ns=lambda: 2 * 10**18) as recorder:
        run(fake_rig, recorder, range(3))
    trials = frozenset(tap.label.trial for tap in read_rig(path).taps)
    with Recorder.resume(path, wall_ns=lambda: 10**9) as recorder:
        run(fake_rig, recorder, range(3, 6))
    read = read_rig(path)

    assert trials == {0, 1, 2}
    assert [tap.label.trial for tap in read.taps] == list(range(6))
    assert (read.lost, read.began_ns) == ("", 2 * 10**18)


def test_a_copy_that_was_killed_is_overwritten(about, fake_rig, tmp_path):
    """So that none pile up."""
    path = tmp_path / "a.mcap"
    with Recorder.create(path, about) as recorder:
        run(fake_rig, recorder, range(2))
    (tmp_path / ".a.mcap.resumed").write_bytes(b"half a copy")
    Recorder.resume(path).finish()

    assert [entry.name for entry in tmp_path.iterdir()] == ["a.mcap"]
    assert len(read_rig(path).taps) == 2


def test_a_file_is_replaced_only_with_force_and_while_nobody_records_to_it(about, tmp_path):
    path = tmp_path / "a.mcap"
    with Recorder.create(path, about) as recorder:
        with pytest.raises(InputError, match="another program is recording to it"):
            Recorder.create(path, about, force=True)
        recorder.event(1.0, "old", "")
    Recorder.create(path, about, force=True).finish()

    assert not contents(path, Event)
