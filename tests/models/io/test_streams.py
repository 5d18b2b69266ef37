"""Streams are cut as they would have been cut live."""

from dataclasses import replace

import numpy as np
import pytest
from solidtouch.models.cutting.presses import presses_of_column, presses_of_events
from solidtouch.models.cutting.tap_cutter import TapCutter
from solidtouch.models.errors import InputError
from solidtouch.models.io.arrays import recording_from_arrays
from solidtouch.models.io.load import read_recording
from solidtouch.models.io.streams import segment, stream_starts
from solidtouch.models.preprocessing import Preprocessing


def pulses(starts, length=30, taxels=2):
    """A stream that is 0 but for three frames of 5 from each start on the last taxel."""
    frames = np.zeros((length, taxels))
    for start in starts:
        frames[start : start + 3, -1] = 5.0
    return frames


def recording(*streams, names=("a", "b"), **more):
    """Streams of (session, what, frames), positions equal to the row number."""
    frames = np.concatenate([stream for _, _, stream in streams])
    lengths = [len(stream) for _, _, stream in streams]
    arrays = {
        "stream": frames,
        "what": np.repeat([what for _, what, _ in streams], lengths),
        "session": np.repeat([session for session, _, _ in streams], lengths),
        "where": np.arange(len(frames)) / 4,
        "what_names": np.array(names),
        **more,
    }
    return recording_from_arrays(arrays)


CONTACT = Preprocessing(samples=4, rate_hz=20.0, trigger="contact", trigger_level=2.0, pre_samples=1)


def test_a_tap_begins_before_its_trigger_and_lies_where_it_was_triggered():
    cut = segment(recording((0, 0, pulses([10, 20])), (0, 1, pulses([5]))), CONTACT)

    assert cut.taps.taps[:, :, 1].tolist() == [[0, 5, 5, 5]] * 3
    assert cut.taps.where.tolist() == [10 / 4, 20 / 4, 35 / 4]
    assert cut.taps.what.tolist() == [0, 0, 1]
    assert cut.taps.trial.tolist() == [0, 1, 2]
    assert cut.taps.preprocessing == CONTACT


def test_every_run_of_an_object_in_a_session_is_its_own_stream():
    """A tare is taken anew where the session or the object changes, not where they come back to what they were."""
    tare = Preprocessing(samples=4, tare="stream", tare_samples=2, trigger="clock")
    streams = [(0, 0, np.full((6, 2), 1.0)), (0, 1, np.full((6, 2), 2.0)), (1, 1, np.full((6, 2), 3.0))]

    cut = segment(recording(*streams, (1, 0, np.full((6, 2), 4.0))), tare)

    assert cut.streams == 4
    assert not cut.taps.taps.any()
    assert cut.taps.session.tolist() == [0, 0, 1, 1]
    assert cut.taps.trial.tolist() == [0, 1, 0, 1]
    assert cut.incomplete == 4


def test_taps_cut_short_and_silent_streams_are_counted():
    cut = segment(recording((0, 0, pulses([0, 10, 28])), (0, 1, pulses([])), (3, 1, pulses([9]))), CONTACT)

    assert len(cut.taps) == 2
    assert cut.incomplete == 2
    assert cut.silent == ("session 0, b, 30 frames",)


def test_further_arrays_and_sample_types_follow_the_trigger_frame():
    streams = recording((0, 0, pulses([10]).astype(np.float32)), depth=np.arange(30.0), what=np.zeros(30))

    cut = segment(streams, CONTACT)

    assert cut.taps.dataset["depth"].values.tolist() == [10.0]
    assert cut.taps.taps.dtype == np.float32


def test_a_table_of_positions_survives_where_given():
    cut = segment(recording((0, 0, pulses([10])), where=np.zeros(30), where_values=np.array([1.0, 2.0, 4.0])), CONTACT)

    assert cut.taps.dataset["where_value"].values.tolist() == [1.0, 2.0, 4.0]


@pytest.mark.parametrize(
    ("streams", "record", "message"),
    [
        (
            [(0, 0, pulses([]))],
            CONTACT,
            r"no tap found in 1 stream: the level \(--level\) is 2 and the values as stored span 0 to 0",
        ),
        ([(0, 0, pulses([28]))], CONTACT, "1 tap cut short"),
        ([(0, 0, pulses([3]))], Preprocessing(samples=4), "needs? a trigger|clock, contact or press trigger"),
    ],
)
def test_nothing_to_cut_is_an_error_that_says_why(streams, record, message):
    with pytest.raises(InputError, match=message):
        segment(recording(*streams), record)


def test_too_short_streams_say_how_long_a_tap_is():
    with pytest.raises(InputError, match="no tap found in 1 stream: 1 tap"):
        segment(recording((0, 0, pulses([], 3))), Preprocessing(samples=4, trigger="clock"))
    held_back = Preprocessing(samples=4, tare="stream", tare_samples=9, trigger="clock")
    with pytest.raises(InputError, match="a tap takes 4 frames"):
        segment(recording((0, 0, pulses([], 5))), held_back)


def test_cut_taps_are_not_cut_again(make_taps, arrays_of):
    with pytest.raises(InputError, match="already cut"):
        segment(recording_from_arrays(arrays_of(make_taps(repeats=1))), CONTACT)


def test_files_of_a_folder_are_separate_streams_even_of_one_session(tmp_path):
    for name in ("a.csv", "b.csv"):
        rows = "".join(f"0,ball,{j},{int(j > 2) * 5}\n" for j in range(4))
        (tmp_path / name).write_text("session,what,where,taxel\n" + rows)

    cut = segment(read_recording(tmp_path), Preprocessing(samples=3, trigger="clock"))

    assert cut.streams == 2
    assert cut.incomplete == 2
    assert cut.taps.where.tolist() == [0.0, 0.0]


def test_stream_labels_of_another_length_are_refused():
    with pytest.raises(InputError, match=r"what must have shape \(30,\), got shape \(29,\)"):
        recording((0, 0, pulses([])), what=np.zeros(29))


PRESS = Preprocessing(samples=4, rate_hz=20.0, trigger="press", pre_samples=1)


def test_presses_cut_taps_with_the_labels_of_the_frame_behind_them():
    streams = recording((0, 0, pulses([10, 20])), (0, 1, pulses([5])))
    signal = streams.samples[:, -1] > 0
    cut = segment(streams, PRESS, presses_of_column(signal, stream_starts(streams)))

    assert cut.taps.taps[:, :, 1].tolist() == [[0, 5, 5, 5]] * 3
    assert cut.taps.where.tolist() == [10 / 4, 20 / 4, 35 / 4]
    assert cut.taps.preprocessing == PRESS
    assert cut.told == ("3 taps from 2 streams.",)


def test_what_presses_lost_is_told():
    """Cut short at either end, given up for the next one, outside, and streams that have none."""
    streams = recording((0, 0, pulses([10, 20])), (0, 1, pulses([5])))
    presses = presses_of_events([0, 10, 12, 28, 99, 45.0], streams.file)
    cut = segment(streams, PRESS, presses)

    assert cut.taps.where.tolist() == [12 / 4, 45 / 4]
    assert (cut.incomplete, cut.overlapping, cut.outside) == (2, 1, 1)
    assert cut.told == (
        "2 taps from 2 streams.",
        "2 taps left out: cut short by the start or end of a stream.",
        "1 tap left out: given up, as the next press came before the end.",
        "1 press left out: outside the streams.",
    )
    _, *one = segment(streams, PRESS, presses_of_events([10, 99, 98], streams.file)).told
    assert one == ["2 presses left out: outside the streams.", "No tap in the stream of session 0, b, 30 frames."]


def test_streams_are_split_at_gaps_in_time():
    """A tap does not reach across a pause, and a filter starts anew behind it."""
    tare = Preprocessing(samples=4, tare="stream", tare_samples=2, trigger="clock")
    streams = replace(
        recording((0, 0, np.repeat([[1.0, 1.0], [3.0, 3.0]], 10, axis=0))),
        time=np.concatenate([np.arange(10), 50 + np.arange(10)]) / 20,
    )
    cut = segment(streams, tare)

    assert (cut.streams, cut.gaps, cut.incomplete) == (2, 1, 2)
    assert cut.told[0] == "4 taps from 2 streams, split at 1 gap."
    assert not cut.taps.taps.any()
    assert stream_starts(streams).tolist() == [0, 10]
    assert segment(replace(streams, time=None), tare).streams == 1


def test_times_of_a_table_are_kept(tmp_path):
    rows = "".join(f"ball,{0.5 * j},{j}\n" for j in range(4)) + "ball,9,5\n"
    (tmp_path / "a.csv").write_text("what,time_s,taxel\n" + rows)
    found = read_recording(tmp_path / "a.csv")

    assert found.time.tolist() == [0.0, 0.5, 1.0, 1.5, 9.0]
    assert stream_starts(found).tolist() == [0, 4]


def test_a_tap_at_another_rate_has_the_labels_of_its_frame():
    streams = recording((0, 0, pulses([30], 90)))
    record = replace(PRESS, rate_hz=10.0, sensor_hz=20.0)
    cut = segment(streams, record, presses_of_events([31], streams.file))
    (tap,) = TapCutter(replace(record, trigger="clock", pre_samples=0)).push(streams.samples)[3:4]

    assert cut.taps.where.tolist() == [31 / 4]
    np.testing.assert_array_equal(cut.taps.taps[0, :1], tap.samples[3:])
    assert cut.taps.dataset["time"].values.tolist() == [0.0, 0.1, 0.2, 0.3]


def test_a_stream_is_cut_in_parts_that_fit_into_memory(monkeypatch):
    streams = recording((0, 0, pulses([10, 20])), (0, 1, pulses([5])))
    record = replace(CONTACT, highpass_hz=0.1, trigger_level=1.5)
    whole = segment(streams, record)
    monkeypatch.setattr("solidtouch.models.io.streams._AT_ONCE", 14)

    np.testing.assert_array_equal(segment(streams, record).taps.taps, whole.taps.taps)


@pytest.mark.parametrize(
    ("record", "presses", "message"),
    [
        (PRESS, None, "trigger='press' was asked for, but no presses were given"),
        (CONTACT, [3], "trigger='contact' was asked for, but presses were given"),
        (PRESS, [], "no tap found in 1 stream: there are no presses"),
        (PRESS, [99, 98], "no tap found in 1 stream: all presses are outside the streams"),
        (PRESS, [28], "no tap found in 1 stream: 1 tap cut short"),
        (PRESS, [27, 28], "1 tap cut short by .* stream, and 1 given up for the next press"),
    ],
)
def test_presses_that_give_no_tap_are_an_error_that_says_why(record, presses, message):
    streams = recording((0, 0, pulses([3])))
    found = None if presses is None else presses_of_events(presses, streams.file)
    with pytest.raises(InputError, match=message):
        segment(streams, record, found)


def test_a_missing_sample_of_a_used_taxel_is_refused_with_its_row():
    frames = pulses([10])
    frames[17, 0] = np.nan
    streams = replace(recording((0, 0, pulses([10]))), samples=frames)
    with pytest.raises(InputError, match=r"row 17 of the streams, counted from 0, has a sample that is missing"):
        segment(streams, CONTACT)

    assert segment(streams, replace(CONTACT, taxels=(1,))).taps.tap_shape == (4, 1)


@pytest.mark.parametrize(("level", "sign"), [(2.0, 1), (-2.0, -1)])
def test_streams_that_begin_in_contact_are_told(level, sign):
    """As one that nobody tared: its first tap begins with the stream, not with a touch."""
    rest = np.array([[200.0, 1.0]] * 5 + [[203.0, 1.0]] * 3 + [[200.0, 1.0]] * 5)
    arrays = {"stream": sign * rest, "what": np.zeros(13), "what_names": np.array(["a"])}
    recording = recording_from_arrays(arrays)
    record = Preprocessing(samples=3, trigger="contact", trigger_level=level)
    told = segment(recording, record).told
    assert told[1].startswith("1 of 1 stream begins in contact, at or beyond level (--level); --tare stream subtracts")
    tared = segment(recording, replace(record, tare="stream", tare_samples=2))
    assert tared.told == ("1 tap from 1 stream.",)
    with pytest.raises(InputError, match=r"no tap found .*; 1 of 1 stream begins in contact"):
        segment(recording, replace(record, pre_samples=2))


TARED = Preprocessing(
    samples=6, rate_hz=20.0, tare="stream", tare_samples=4, trigger="contact", trigger_level=2.0, pre_samples=2
)


def pressed(offset, starts, length=60, load=5.0):
    """A stream of two taxels at an offset with presses of ten frames on the last one."""
    frames = np.full((length, 2), float(offset))
    for start in starts:
        frames[start : start + 10, -1] += load
    return frames


@pytest.mark.parametrize("sign", [1, -1])
def test_a_stream_that_resumes_within_a_contact_is_tared_as_the_one_before(sign):
    """So its next tap shows the whole load; the rest of the contact is none."""
    frames = sign * pressed(100, [15, 40])
    time = np.arange(60) / 20 + np.where(np.arange(60) < 18, 0.0, 5.0)
    streams = replace(recording((0, 0, frames)), time=time)
    cut = segment(streams, replace(TARED, trigger_level=2.0 * sign))

    assert cut.taps.taps[:, :, 1].tolist() == [[0, 0, *[5 * sign] * 4]]
    assert cut.told == (
        "1 tap from 2 streams, split at 1 gap.",
        "1 tap left out: cut short by the start or end of a stream.",
        "1 of 2 streams begins in contact and is tared as the one before it.",
        "No tap in the stream of session 0, a, 18 frames.",
    )


@pytest.mark.parametrize("offset", [107, 101])
def test_a_baseline_that_drifted_is_taken_anew(offset):
    """Also by more than the trigger level."""
    cut = segment(recording((0, 0, pressed(100, [20])), (0, 1, pressed(offset, [20]))), TARED)

    assert cut.resumed == 0
    assert cut.taps.taps[:, :, 1].tolist() == [[0, 0, 5, 5, 5, 5]] * 2


def test_another_session_has_a_tare_of_its_own():
    """As somebody may have mounted the sensor anew."""
    cut = segment(recording((0, 0, pressed(100, [20])), (1, 0, pressed(107, [0, 20]))), TARED)

    assert (cut.resumed, len(cut.taps)) == (0, 1)


def test_a_short_stream_passes_on_the_tare_before_it():
    """Of three frames, where a tare takes four."""
    streams = [(0, 0, pressed(100, [20])), (0, 1, pressed(105, [], 3)), (0, 0, pressed(100, [0, 20]))]
    cut = segment(recording(*streams), TARED)

    assert cut.resumed == 1
    assert cut.taps.taps[:, :, 1].tolist() == [[0, 0, 5, 5, 5, 5]] * 2
