"""A collection follows its plan, waits for objects, and can be interrupted and continued anywhere."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solidtouch.hardware.errors import StaleSensor
from solidtouch.hardware.journal import NoJournal
from solidtouch.hardware.recording.collection import collect, resume_recording
from solidtouch.hardware.recording.recording import Recorder
from solidtouch.hardware.recording.settings import about_rig
from solidtouch.models.errors import InputError
from solidtouch.models.io.rig import read_rig
from solidtouch.models.io.rig_reader import RecordingReader
from solidtouch.models.io.rig_recording import Event


def test_objects_are_changed_with_the_finger_off_and_settled_before_taps_count(fake_rig):
    plan, operator, progress = fake_rig.fake_plan(), fake_rig.FakeOperator(), []
    rig = fake_rig.FakeRig(NoJournal())
    collect(rig, plan.taps(), plan.objects, 2, operator, NoJournal(), lambda: progress.append(1))

    one = ["clear", 1.5, "tap", "tap", "tap", 2.5, "tap", 3.5, "tap", 4.5, "tap"]
    assert rig.did == one * 2
    assert operator.placed == [(0, "thin"), (1, "thick")]
    assert [label.get("trial") for label, _ in rig.taps] == [None, None, 0, 1, 2, 3, None, None, 4, 5, 6, 7]
    assert len(progress) == 8
    assert rig.label == {}


def test_the_rig_does_not_move_between_taps_at_one_place(fake_rig):
    plan = fake_rig.parse_plan("taps_per_position = 3\npositions = [1.5, 2.5]\nobjects = [{ name = 'a' }]")
    rig = fake_rig.FakeRig(NoJournal())
    collect(rig, plan.taps(), plan.objects, 0, fake_rig.FakeOperator(), NoJournal())

    assert rig.did == ["clear", 1.5, "tap", "tap", "tap", 2.5, "tap", "tap", "tap"]


@pytest.mark.parametrize(
    ("misses", "first", "named"),
    [
        (range(12), 0, ["thin", "thick"]),
        ([0, 1, 2, 3, 5, 6, 7, 8, 9, 10, 11], 0, ["thick"]),
        (range(6), 0, ["thin"]),
        (range(12), 2, ["thick"]),
        ([], 0, []),
    ],
)
def test_an_object_that_no_tap_touched_is_named(fake_rig, misses, first, named):
    """Not where some of its taps were made before, which may have touched it."""
    plan, said = fake_rig.fake_plan(), []
    rig = fake_rig.FakeRig(NoJournal(), misses=lambda n: n in misses)
    collect(rig, list(plan.taps())[first:], plan.objects, 2, fake_rig.FakeOperator(), NoJournal(), warn=said.append)

    assert [sentence.split()[3] for sentence in said] == named
    assert all("(stage.y.direction)" in sentence and "`solidtouch rig approach`" in sentence for sentence in said)


def test_readings_are_taken_while_the_operator_is_waited_for(fake_rig):
    """The loop turns, so that they do not pile up in the port."""
    plan = fake_rig.parse_plan("positions = [1.5]\nobjects = [{ name = 'a' }]")
    rig = fake_rig.FakeRig(NoJournal())
    before = rig.loop.now
    collect(rig, [], plan.objects, 0, fake_rig.FakeOperator(looks=100), NoJournal())
    assert rig.loop.now == before
    collect(rig, plan.taps(), plan.objects, 0, fake_rig.FakeOperator(looks=100), NoJournal())

    assert rig.loop.now - before > 99 * 0.05


def test_the_change_of_an_object_is_recorded(fake_rig, tmp_path):
    plan, path = fake_rig.fake_plan(), tmp_path / "a.mcap"
    with Recorder.create(path, about_rig(fake_rig.fake_settings(), "", plan)) as recorder:
        rig = fake_rig.FakeRig(recorder).connect()
        collect(rig, plan.taps(), plan.objects, 0, fake_rig.FakeOperator(), recorder)
    events = [entry.content for entry in RecordingReader(path) if isinstance(entry.content, Event)]

    assert [event.kind for event in events] == ["stream", "object", "object"]
    assert [event.details.get("name") for event in events[1:]] == ["thin", "thick"]


@given(stops=st.lists(st.tuples(st.integers(0, 14), st.integers(0, 400)), max_size=4))
@settings(max_examples=25, deadline=None)
def test_a_collection_that_stops_anywhere_ends_with_the_same_taps(fake_rig, tmp_path_factory, stops):
    """Faults at any attempt, with any number of bytes lost, and resumed each time: every trial once, in order."""
    plan, path = fake_rig.fake_plan(), tmp_path_factory.mktemp("stops") / "a.mcap"
    about = about_rig(fake_rig.fake_settings(), "", plan)
    recorder, made = Recorder.create(path, about), {}
    begin = path.stat().st_size
    trials = frozenset()
    for attempts, lost in [*stops, (10**6, 0)]:

        def fail(n, attempts=attempts):
            if n == attempts:
                raise StaleSensor("no reading for")

        rig = fake_rig.FakeRig(recorder, fail=fail, rejected=lambda n: n % 4 == 1).connect()
        left = [tap for tap in plan.taps() if tap.trial not in trials]
        try:
            with recorder:
                collect(rig, left, plan.objects, plan.settle_taps, fake_rig.FakeOperator(), recorder)
        except StaleSensor:
            whole = path.read_bytes()
            path.write_bytes(whole[: max(begin, len(whole) - lost)])
            recorder, trials, _ = resume_recording(path, about)
        made |= {label["trial"]: samples for label, samples in rig.taps if label}
    recorder.finish()
    read = read_rig(path)

    assert [tap.label.trial for tap in read.taps] == list(range(8))
    assert all(np.array_equal(tap.samples, made[tap.label.trial]) for tap in read.taps)


def test_a_full_disk_stops_the_collection_after_the_tap(fake_rig, tmp_path):
    """What was recorded before stays; the rig is told of no further tap."""
    plan, path = fake_rig.fake_plan(), tmp_path / "a.mcap"
    recorder = Recorder.create(path, about_rig(fake_rig.fake_settings(), "", plan))
    rig = fake_rig.FakeRig(recorder).connect()
    flush = recorder._file.flush

    def full():
        if len(rig.taps) >= 4:
            raise OSError(28, "No space left on device")
        flush()

    recorder._file = Full(recorder._file, full)
    with pytest.raises(InputError, match="writing failed: No space left on device"):
        collect(rig, plan.taps(), plan.objects, plan.settle_taps, fake_rig.FakeOperator(), recorder)

    with pytest.raises(InputError, match="writing failed"):
        recorder.finish()

    assert len(rig.taps) == 4
    assert len(read_rig(path).taps) == 3


class Full:
    """A file whose disk may be full."""

    def __init__(self, file, flush):
        self._file, self.flush = file, flush

    def __getattr__(self, name):
        return getattr(self._file, name)


@pytest.mark.parametrize("highpass_hz", [0.0, 0.5])
def test_a_damaged_tap_is_made_again(highpass_hz, fake_rig, tmp_path):
    """With a high-pass those after it too, as they cannot be cut any more; each trial is there once in the end."""
    bench = fake_rig.parse_rig(fake_rig.RIG.replace("highpass_hz = 0.5", f"highpass_hz = {highpass_hz}"))
    plan, path = fake_rig.fake_plan(), tmp_path / "a.mcap"
    about = about_rig(bench, "", plan)
    with Recorder.create(path, about) as recorder:
        rig = fake_rig.FakeRig(recorder, bench).connect()
        collect(rig, list(plan.taps())[:4], plan.objects, 0, fake_rig.FakeOperator(), recorder)
    whole = path.read_bytes()
    place = whole.index(b'"trial":1,')
    path.write_bytes(whole[:place] + b"?" + whole[place + 1 :])
    recovered = resume_recording(path, about)
    with recovered.recorder as recorder:
        rig = fake_rig.FakeRig(recorder, bench).connect()
        left = [tap for tap in plan.taps() if tap.trial not in recovered.trials]
        collect(rig, left, plan.objects, 0, fake_rig.FakeOperator(), recorder)

    assert recovered.trials == ({0, 2, 3} if highpass_hz == 0 else {0})
    assert recovered.lost == "2 messages before are damaged"
    assert sorted(tap.label.trial for tap in read_rig(path).taps) == list(range(8))
