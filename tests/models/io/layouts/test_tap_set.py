"""Streams that maps cut, and taps that they resample, align and free of useless taxels."""

import numpy as np
import pytest
import scipy.io
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.mapping import TapMap
from solidtouch.models.io.layouts.tap_set import load_mapped

RATE = 100.0


def write(path, columns):
    """A CSV file with these columns."""
    rows = zip(*columns.values(), strict=True)
    path.write_text("\n".join([",".join(columns), *(",".join(map(str, row)) for row in rows)]))


@pytest.fixture
def stream(tmp_path):
    """Six presses of 20 frames on the first of three taxels; the second is dead, the third counts frames.

    Before the fourth press the clock pauses for a minute, and the day changes.
    """
    frame = np.arange(6 * 50)
    pressing = (frame % 50 >= 20) & (frame % 50 < 40)
    time = frame / RATE + 60.0 * (frame >= 150)
    columns = {
        "t": np.round(time, 3),
        "f1": np.where(pressing, 5.0, 0.0),
        "f2": np.full(len(frame), 7.0),
        "f3": frame,
        "valve": np.where(pressing, "on", "off"),
        "day": np.where(frame < 150, "2026-11-25 23:59", "2026-11-26 00:01"),
    }
    write(tmp_path / "stream.csv", columns)
    return tmp_path / "stream.csv"


CUT = TapMap(taxels="f*", time="t", window=30, pre=10)
BEGINS = [10 + 50 * n for n in range(6)]


def begins(taps):
    """First frame of each tap."""
    return taps.taps[:, 0, -1].tolist()


def test_presses_by_contact_by_a_signal_and_by_events_are_the_same(stream):
    """Of the stream's clock as well as of its frames."""
    write(stream.with_name("presses.csv"), {"at": [0.2, 0.7, 1.2, 61.7, 62.2, 62.7]})
    write(stream.with_name("frames.csv"), {"frame": [20 + 50 * n for n in range(6)]})
    contact = CUT.changed(trigger="contact", level=3.0, taxels="f1")
    signal = CUT.changed(trigger="signal", signal="valve")
    events = CUT.changed(trigger="events", events="presses.csv:at")
    frames = events.changed(events="frames.csv", time=None, rate=RATE)
    found = [load_mapped(stream, how).taps for how in (signal, events, frames)]

    assert [begins(taps) for taps in found] == [BEGINS] * 3
    assert load_mapped(stream, contact).taps.taps[:, :, 0].tolist() == found[0].taps[:, :, 0].tolist()
    assert [taps.preprocessing.trigger for taps in found] == ["press"] * 3
    assert {taps.preprocessing.rate_hz for taps in found} == {RATE}


@pytest.mark.parametrize("session", ["gap:30", "date:day", "day"])
def test_a_pause_and_another_date_begin_a_session(session, stream):
    taps = load_mapped(stream, CUT.changed(trigger="signal", signal="valve", session=session)).taps

    assert taps.session.tolist() == [0, 0, 0, 1, 1, 1]
    assert taps.trial.tolist() == [0, 1, 2, 0, 1, 2]


def test_a_dead_taxel_is_left_out_and_named(stream):
    """Also where taps begin by contact, and it would always be in contact."""
    contact = CUT.changed(trigger="contact", level=3.0, taxels=("f1", "f2"), leave_out=("dead",))
    with pytest.raises(InputError, match="no tap found"):
        load_mapped(stream, contact.changed(leave_out=()))
    for how in (contact, contact.changed(trigger="signal", signal="valve", level=None)):
        taps, told = load_mapped(stream, how)

        assert taps.taps.shape == (6, 30, 1)
        assert taps.preprocessing.taxels == (0,)
        assert any("1 of 2 taxels left out: 1 (dead" in sentence for sentence in told)


def test_streams_are_resampled_before_they_are_cut(stream):
    """The taxel that counts frames then counts every second one."""
    how = CUT.changed(trigger="signal", signal="valve", resample=RATE / 2, window=10, pre=4, taxels="f3")
    taps = load_mapped(stream, how).taps

    assert (taps.preprocessing.rate_hz, taps.preprocessing.sensor_hz) == (RATE / 2, RATE)
    assert np.diff(taps.taps[:, 2:-2, 0], axis=1) == pytest.approx(2.0, abs=1e-3)


def test_taps_are_aligned_at_contact_and_at_their_peak(tmp_path):
    """Those that cannot be are left out, with their labels."""
    for name, shift, height in (("a", 2, 5), ("b", 4, 6), ("c", 3, 0.5)):
        signal = height * np.exp(-((np.arange(10) - shift) ** 2))
        write(tmp_path / f"{name}.csv", {"f1": np.round(signal, 3)})
    how = TapMap(what="file:{what}.csv", taxels="f1", tap="file", align="peak", pre=1, length=4)
    peaks = load_mapped(tmp_path, how).taps
    contact, told = load_mapped(tmp_path, how.changed(align="contact", level=3.0))

    assert peaks.taps[:, 1, 0].tolist() == [5, 6, 0.5]
    assert (contact.taps[:, 1, 0].tolist(), contact.what.tolist()) == ([5, 6], [0, 1])
    assert "1 tap left out: without a sample at the level 3." in told


def test_taps_that_are_cut_are_resampled_with_their_record(tmp_path):
    write(tmp_path / "a.csv", {"t": np.arange(40) / RATE, "f1": np.full(40, 2.5)})
    how = TapMap(taxels="f1", tap="file", time="t", resample=RATE / 4)
    taps = load_mapped(tmp_path / "a.csv", how).taps

    assert taps.taps.tolist() == [[[2.5]] * 10]
    assert (taps.preprocessing.rate_hz, taps.preprocessing.sensor_hz) == (RATE / 4, RATE)


def test_length_counts_samples_before_they_are_resampled(tmp_path):
    write(tmp_path / "a.csv", {"f1": range(30)})
    write(tmp_path / "b.csv", {"f1": range(40)})
    how = TapMap(taxels="f1", tap="file", rate=RATE, resample=RATE / 4, length=21)

    assert load_mapped(tmp_path, how).taps.tap_shape == (6, 1)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, r"tap is with tap \(--tap\), or cut taps with trigger \(--trigger\)"),
        ({"trigger": "events", "events": "t", "window": 3}, r"events \(--events\): t has a value for each frame"),
        ({"trigger": "events", "events": "no.csv", "window": 3}, r"events \(--events\): no\.csv: no such table"),
        (
            {"trigger": "clock", "time": None, "resample": 10.0, "window": 3},
            r"resample \(--resample\) requires the rate .*: time \(--time\) or rate \(--rate\)",
        ),
        (
            {"trigger": "clock", "time": None, "highpass": 10.0, "window": 3},
            r"highpass \(--highpass\) requires the rate",
        ),
        (
            {"trigger": "clock", "resample": 17.77777, "window": 3},
            r"resample \(--resample\): Cannot resample from 100 Hz",
        ),
        ({"tap": "file", "resample": 17.77777}, r"resample \(--resample\): Cannot resample from 100 Hz"),
        ({"trigger": "clock", "highpass": 99.0, "window": 3}, r"highpass \(--highpass\): A high-pass filter at 99"),
        ({"trigger": "signal", "signal": "day", "window": 3}, r"signal \(--signal\) day: must hold numbers or true"),
        ({"tap": "file", "taxels": "f2", "leave_out": "dead"}, r"leave_out \(--leave-out\): no taxel would be left"),
        ({"length": 3}, r"length \(--length\) is for taps"),
        ({"session": "gap:long", "trigger": "clock", "window": 3}, r"session \(--session\): gap:long"),
        ({"session": "gap:3", "trigger": "clock", "time": None, "window": 3}, r"needs time \(--time\)"),
    ],
)
def test_what_does_not_go_together_is_refused(changes, message, stream):
    with pytest.raises(InputError, match=message):
        load_mapped(stream, CUT.changed(**{"window": None, "pre": None} | changes))


def test_dead_and_saturated_taxels_are_both_left_out_by_their_own_numbers(tmp_path, rng):
    """Of four taxels the first is dead and the third stays at its limit while pressed."""
    frame = np.arange(6 * 50)
    pressing = (frame % 50 >= 20) & (frame % 50 < 40)
    noise = rng.normal(0, 0.1, (2, len(frame)))
    columns = {
        "f0": np.full(len(frame), 7.0),
        "f1": np.round(4.0 * pressing + noise[0], 4),
        "f2": np.where(pressing, 5.0, np.round(noise[1], 4)),
        "f3": np.round(3.0 * pressing + noise[1], 4),
        "valve": pressing.astype(int),
    }
    write(tmp_path / "stream.csv", columns)
    how = TapMap(taxels="f*", trigger="signal", signal="valve", window=30, pre=10, leave_out=("dead", "saturated"))
    taps, told = load_mapped(tmp_path / "stream.csv", how)

    assert taps.preprocessing.taxels == (1, 3)
    assert taps.taps[0, 10:12].tolist() == [[columns["f1"][n], columns["f3"][n]] for n in (20, 21)]
    assert "1 of 4 taxels left out: 0 (dead: one value throughout)." in told
    assert "1 of 3 taxels left out: 2 (saturated)." in told


def test_events_name_their_file_with_or_without_folder_and_ending(tmp_path):
    for folder in ("x", "y"):
        (tmp_path / folder).mkdir()
        for name in ("a", "b"):
            write(
                tmp_path / folder / f"{name}.csv",
                {"s": [f"{n + 100 * (name == 'b') + 1000 * (folder == 'y')}" for n in range(20)]},
            )
    how = TapMap(files="?/?.csv", taxels="s", trigger="events", events="presses.csv:at", window=2)
    write(tmp_path / "presses.csv", {"at": [5, 3, 7, 99], "of": ["x/a.csv", "y/b.csv", "y/b.csv", "x/a.csv"]})
    taps, told = load_mapped(tmp_path, how)

    assert taps.taps[:, 0, 0].tolist() == [5, 1103, 1107]
    assert "1 press left out: outside the streams." in told
    write(tmp_path / "presses.csv", {"at": [5, 3], "of": ["a.csv", "b.csv"]})
    with pytest.raises(InputError, match=r"names a\.csv, which x/a\.csv and y/a\.csv may be"):
        load_mapped(tmp_path, how)


@pytest.mark.parametrize("axes", ["what,trial,sample,taxel", "what,tap,sample,taxel"])
def test_ragged_cells_of_objects_and_trials(axes, tmp_path):
    """Of a cell array of MATLAB whose taps differ in length."""
    cells = np.empty((2, 3), object)
    for m in range(2):
        for n in range(3):
            cells[m, n] = np.full((2 + n, 2), 10.0 * m + n)
    scipy.io.savemat(tmp_path / "a.mat", {"data": cells})
    how = TapMap(taps="data", axes=axes, what_names=("cup", "rod"), length="shortest")
    taps = load_mapped(tmp_path / "a.mat", how).taps

    assert taps.taps[:, 0, 0].tolist() == [0, 1, 2, 10, 11, 12]
    assert [taps.what_name[m] for m in taps.what] == ["cup"] * 3 + ["rod"] * 3
    assert "tap" in axes or taps.trial.tolist() == [0, 1, 2] * 2


@pytest.mark.parametrize("ragged", [False, True])
def test_labels_may_have_the_axes_of_the_taps(ragged, tmp_path):
    """Such as a position for each object and trial; of another shape they are refused."""
    cells = np.empty((2, 3), object)
    for m in range(2):
        for n in range(3):
            cells[m, n] = np.full((2 + n * ragged, 2), 10.0 * m + n)
    at = np.array([[0, 1, 2], [3, 4, 5]])
    scipy.io.savemat(tmp_path / "a.mat", {"data": cells, "at": at, "turned": at.T})
    how = TapMap(taps="data", axes="what,trial,sample,taxel", where="at", length="shortest")
    taps = load_mapped(tmp_path / "a.mat", how).taps

    assert dict(zip(taps.taps[:, 0, 0].tolist(), taps.where.tolist(), strict=True)) == {
        10 * m + n: at[m, n] for m in range(2) for n in range(3)
    }
    with pytest.raises(InputError, match=r"where \(--where\): turned has shape \(3, 2\), expected one"):
        load_mapped(tmp_path / "a.mat", how.changed(where="turned"))


def test_two_axes_of_taps_are_one(tmp_path):
    """As of a struct array of trials and hands."""
    samples, label = np.arange(24.0).reshape(2, 3, 2, 2), np.array([["a", "b", "c"], ["c", "b", "a"]])
    np.savez(tmp_path / "a.npz", x=samples, label=label)
    taps = load_mapped(tmp_path / "a.npz", TapMap(taps="x", axes="tap,tap,sample,taxel", what="label")).taps

    assert taps.taps.tolist() == samples.reshape(6, 2, 2).tolist()
    assert "".join(taps.what_name[m] for m in taps.what) == "abccba"
