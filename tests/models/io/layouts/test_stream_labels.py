"""Labels of taps that are cut from streams, one for each press or tap."""

import h5py
import numpy as np
import pytest
import scipy.io
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.mapping import TapMap
from solidtouch.models.io.layouts.tap_set import load_mapped

CUT = TapMap(taxels="f*", time="t", window=10, pre=2)
EVENTS = CUT.changed(trigger="events", events="presses.csv:onset")
OBJECTS, ANGLES = ("ball", "cube", "rod"), (0, 15, 30)


def write(path, columns):
    """A CSV file with these columns."""
    path.parent.mkdir(exist_ok=True)
    rows = zip(*columns.values(), strict=True)
    path.write_text("\n".join([",".join(columns), *(",".join(map(str, row)) for row in rows)]))


def stream(path, presses, frames=None, further=None):
    """A stream of one taxel that shows the number of each press for 5 frames from its frame on, at 100 Hz."""
    frames = max(presses) + 20 if frames is None else frames
    values = np.zeros(frames)
    for number, frame in enumerate(presses):
        values[frame : frame + 5] = 1 + number
    write(path, {"t": np.arange(frames) / 100, "f1": values, "valve": values.astype(bool), **(further or {})})


def table(path, presses, rng, **columns):
    """A table of presses with random labels, which it returns."""
    labels = {
        "object": rng.choice(OBJECTS, len(presses)),
        "angle": rng.choice(ANGLES, len(presses)),
    }
    write(path, {"onset": np.asarray(presses) / 100, **labels, **columns})
    return labels


def labelled(taps):
    """Number of the press, object and position of each tap."""
    names = [taps.what_name[what] for what in taps.what]
    return list(zip((taps.taps[:, CUT.pre or 0, 0] - 1).astype(int).tolist(), names, taps.where.tolist(), strict=True))


def expected(labels, presses):
    """Likewise, of these presses."""
    return [(n, str(labels["object"][n]), float(labels["angle"][n])) for n in presses]


def test_a_table_of_presses_holds_their_labels(tmp_path, rng):
    """Also of the presses that give no tap: the third comes too soon, the last is beyond the end, and one outside."""
    presses = [10, 40, 44, 70, 100, 125]
    stream(tmp_path / "s.csv", presses, 130)
    labels = table(tmp_path / "presses.csv", [*presses, 900], rng)

    taps, told = load_mapped(tmp_path / "s.csv", EVENTS.changed(what="presses.csv:object", where="presses.csv:angle"))

    assert [number for number, *_ in labelled(taps)] == [0, 2, 3, 4]
    assert labelled(taps) == expected(labels, [0, 2, 3, 4])
    assert [sentence[:11] for sentence in told[:3]] == ["5 taps from", "1 tap left ", "1 press lef"] or told


def test_a_table_of_presses_may_be_in_any_order_and_name_its_files(tmp_path, rng):
    """One of the files has a press less than the other, and a label of its own."""
    presses = {"a": [10, 40, 70], "b": [20, 60]}
    for name, frames in presses.items():
        stream(
            tmp_path / f"in/{name}.csv", frames, further={"day": ["2026-11-2" + str(len(frames))] * (max(frames) + 20)}
        )
    order = rng.permutation(5)
    files, frames = np.repeat(["a", "b"], [3, 2])[order], np.concatenate(list(presses.values()))[order]
    labels = table(tmp_path / "in/presses.csv", frames, rng, recording=files)

    how = EVENTS.changed(files="?.csv", what="presses.csv:object", where="presses.csv:angle", session="date:day")

    taps = load_mapped(tmp_path / "in", how).taps

    whose = [int(np.flatnonzero((files == name) & (frames == frame))[0]) for name in presses for frame in presses[name]]
    assert [row[1:] for row in labelled(taps)] == [row[1:] for row in expected(labels, whose)]
    assert taps.session.tolist() == [1, 1, 1, 0, 0]


@pytest.mark.parametrize("trigger", ["contact", "signal"])
def test_taps_have_the_labels_of_a_table_in_their_order(tmp_path, rng, trigger):
    """Across all files: three taps in the first, two in the second."""
    for name, frames in (("a", [10, 40, 70]), ("b", [20, 60])):
        stream(tmp_path / f"in/{name}.csv", frames, 90)
    labels = table(tmp_path / "labels.csv", range(5), rng)
    how = CUT.changed(trigger=trigger, what="labels.csv:object", where="labels.csv:angle")
    how = how.changed(level=0.5) if trigger == "contact" else how.changed(signal="valve")

    taps, told = load_mapped(tmp_path / "in", how, folder=tmp_path)

    assert [row[1:] for row in labelled(taps)] == [row[1:] for row in expected(labels, range(5))]
    assert "labels.csv is read in the order of the taps" in told[0]


def test_arrays_beside_a_stream_have_a_value_for_each_tap(tmp_path):
    """Places in a plane, of which y is the same for all taps of a file."""
    for name, frames in (("a", [10, 40, 70]), ("b", [20, 60])):
        with h5py.File(tmp_path / f"{name}.h5", "w") as file:
            values = np.zeros((90, 1))
            for frame in frames:
                values[frame : frame + 5] = 1
            file["f"] = values
            file["x"], file["size"] = np.arange(len(frames)), np.full(len(frames), len(frames) * 2.0)
            file["kind"] = [f"rod {len(frames)}".encode()] * len(frames)
            file.attrs["y"] = len(frames)
    how = TapMap(
        taps="f", trigger="contact", level=0.5, window=10, pre=2, what="kind", what_value="size", where=("x", "y")
    )

    taps = load_mapped([tmp_path / "a.h5", tmp_path / "b.h5"], how).taps

    assert taps.dataset["where_place"].values[taps.where.astype(int)].tolist() == [
        [0, 3],
        [1, 3],
        [2, 3],
        [0, 2],
        [1, 2],
    ]
    assert taps.dataset["what_value"].values[taps.what].tolist() == [6, 6, 6, 4, 4]
    assert taps.session.tolist() == [0, 0, 0, 1, 1]


def test_streams_do_not_end_where_the_object_of_the_next_press_begins(tmp_path, rng):
    """A filter and a tare of the stream go on, as the labels are not those of frames."""
    stream(tmp_path / "s.csv", [10, 40, 70])
    table(tmp_path / "presses.csv", [10, 40, 70], rng)
    how = EVENTS.changed(what="presses.csv:object")

    assert load_mapped(tmp_path / "s.csv", how).told[0] == "3 taps from 1 stream."


def test_labels_follow_their_presses_through_all_losses(tmp_path, rng):
    """Random presses, as many too near to each other or to the ends as there may be."""
    for number in range(20):
        presses = np.sort(rng.choice(200, rng.integers(2, 12), replace=False)).tolist()
        presses = [20, *(press for press in presses if press > 40)]
        stream(tmp_path / f"{number}.csv", [frame for frame in presses if frame < 150], 150)
        labels = table(tmp_path / "presses.csv", presses, rng)
        how = EVENTS.changed(what="presses.csv:object", where="presses.csv:angle")

        found = labelled(load_mapped(tmp_path / f"{number}.csv", how).taps)

        assert found == expected(labels, [press for press, *_ in found])


@pytest.mark.parametrize(
    ("trigger", "rows", "sentence"),
    [
        ("events", 2, r"what \(--what\): labels.csv: 2 labels for 3 presses in the streams; its first line counts as"),
        ("events", 4, "labels.csv: 4 labels for 3 presses in the streams"),
        ("contact", 5, "labels.csv: 5 labels for 3 taps in the streams"),
    ],
)
def test_another_number_of_labels_is_refused(tmp_path, rng, trigger, rows, sentence):
    stream(tmp_path / "s.csv", [10, 40, 70])
    table(tmp_path / "presses.csv", [10, 40, 70], rng)
    write(tmp_path / "labels.csv", {"object": ["ball"] * rows})
    how = EVENTS if trigger == "events" else CUT.changed(trigger="contact", level=0.5)

    with pytest.raises(InputError, match=sentence):
        load_mapped(tmp_path / "s.csv", how.changed(what="labels.csv"))


def test_two_presses_at_one_frame_have_no_labels(tmp_path, rng):
    stream(tmp_path / "s.csv", [10, 40])
    table(tmp_path / "presses.csv", [10, 40, 39.9999], rng)

    with pytest.raises(InputError, match="presses 1 and 2, counted from 0, are at the same frame"):
        load_mapped(tmp_path / "s.csv", EVENTS.changed(what="presses.csv:object"))


@pytest.mark.parametrize(
    ("time", "unit", "onset", "scale"),
    [
        ("t", None, "onset", 1),
        ("t", None, "onset_ms", 1000),
        ("t [ms]", None, "onset", 1000),
        ("t_ms", None, "onset [s]", 1),
        ("t", "us", "onset", 10**6),
    ],
)
def test_presses_are_in_the_unit_of_their_header_or_else_of_the_time(tmp_path, time, unit, onset, scale):
    frames, per_s = np.arange(100), 1000 if "ms" in time else 10**6 if unit else 1
    write(tmp_path / "s.csv", {time: frames / 100 * per_s, "f1": frames})
    write(tmp_path / "presses.csv", {onset: np.array([20, 50]) / 100 * scale})
    events = f"presses.csv:{onset.partition(' ')[0]}"

    taps = load_mapped(
        tmp_path / "s.csv", EVENTS.changed(time=time.partition(" ")[0], time_unit=unit, events=events)
    ).taps

    assert taps.taps[:, 2, 0].tolist() == [20, 50]


def test_presses_and_frames_may_have_dates(tmp_path):
    clock = np.datetime64("2026-11-26T10:00:00") + np.arange(100) * np.timedelta64(10, "ms")
    write(tmp_path / "s.csv", {"t": clock, "f1": np.arange(100)})
    write(tmp_path / "presses.csv", {"onset": ["2026-11-26 10:00:00.2", "2026-11-26 10:00:00.495"]})

    assert load_mapped(tmp_path / "s.csv", EVENTS).taps.taps[:, 2, 0].tolist() == [20, 50]


CONTACT = CUT.changed(trigger="contact", level=0.5, what="object", where="x")


def test_labels_that_only_taps_have_are_those_of_taps(tmp_path):
    """In all of their frames, or in the first alone, one before the contact; frames between have none."""
    stream(tmp_path / "s.csv", [10, 40, 70])
    lines = (tmp_path / "s.csv").read_text().splitlines()
    for first, last in ((10, 15), (9, 10)):
        labels = [("", "")] * 90
        for frame, label in ((0, ("cup", 1)), (30, ("rod", 2)), (60, ("cup", 3))):
            labels[frame + first : frame + last] = [label] * (last - first)
        rows = [f"{line},{what},{where}" for line, (what, where) in zip(lines[1:], labels, strict=True)]
        (tmp_path / "l.csv").write_text("\n".join([f"{lines[0]},object,x", *rows]))

        taps = load_mapped(tmp_path / "l.csv", CONTACT).taps

        assert labelled(taps) == [(0, "cup", 1), (1, "rod", 2), (2, "cup", 3)]
    with pytest.raises(InputError, match=r"l.csv: what \(--what\): is missing in the tap at row 10, counted from 0"):
        load_mapped(tmp_path / "l.csv", CONTACT.changed(pre=0))
    (tmp_path / "l.csv").write_text((tmp_path / "l.csv").read_text().replace("0.11,1.0,True,,", "0.11,1.0,True,pot,1"))
    with pytest.raises(InputError, match=r"what \(--what\): has cup and pot in the tap at row 10"):
        load_mapped(tmp_path / "l.csv", CONTACT)


@pytest.mark.parametrize("time", ["t", None])
def test_rows_that_are_not_kept_end_a_stream(tmp_path, time):
    """Also where no time tells: no window runs from one press into the next."""
    valve = np.repeat([0, 1, 0, 1, 0], [20, 15, 20, 15, 20])
    write(tmp_path / "s.csv", {"t": np.arange(90) / 100, "f1": np.arange(90), "valve": valve})
    how = TapMap(taxels="f1", time=time, keep="valve=1", trigger="clock", window=10)

    found = load_mapped(tmp_path / "s.csv", how.changed(rate=None if time else 100.0))

    assert found.taps.taps[:, 0, 0].tolist() == [20, 55]
    assert found.told[0] == "2 taps from 2 streams, split at 1 gap."


@pytest.mark.parametrize("time", [None, "t"])
@pytest.mark.parametrize("one_based", [False, True])
def test_presses_may_be_an_array_of_the_file(tmp_path, time, one_based):
    """With their labels, in frames or on the clock of the file."""
    for name, presses in (("a", [10, 40, 70]), ("b", [20, 60])):
        at = np.array(presses) / 100 if time else np.array(presses) + one_based
        sound, kind = np.arange(100.0)[:, np.newaxis] * [1, 1], np.array(presses) // 30 + one_based
        scipy.io.savemat(tmp_path / f"{name}.mat", {"x": sound, "t": np.arange(100) / 100, "onset": at, "cond": kind})
    how = TapMap(taps="x", time=time, trigger="events", events="onset", window=10, what="cond", one_based=one_based)
    how = how.changed(what_names=("cup", "rod", "pot"))

    taps = load_mapped([tmp_path / "a.mat", tmp_path / "b.mat"], how).taps

    assert taps.taps[:, 0, 0].tolist() == [10, 40, 70, 20, 60]
    assert [taps.what_name[m] for m in taps.what] == ["cup", "rod", "pot", "cup", "pot"]


def test_a_column_of_frames_is_one_though_frames_have_times(tmp_path):
    """Of the rows of the file, kept or not."""
    write(tmp_path / "s.csv", {"t": np.arange(90) / 100, "f1": np.arange(90), "ok": [1] * 30 + [0] * 10 + [1] * 50})
    write(tmp_path / "presses.csv", {"frame": [20, 50, 70]})
    how = EVENTS.changed(events="presses.csv:frame", pre=0)
    for keep in (None, "ok=1"):
        taps = load_mapped(tmp_path / "s.csv", how.changed(keep=keep)).taps
        assert taps.taps[:, 0, 0].tolist() == [20, 50, 70]


def test_each_file_may_have_a_table_of_its_presses(tmp_path, rng):
    """Called after it, with their labels and the date of its session."""
    expected_taps = []
    for name, presses in (("a", [10, 40, 70]), ("b", [20, 60])):
        stream(tmp_path / f"in/rec_{name}.csv", presses)
        order = rng.permutation(len(presses))
        day = [f"2026-11-2{7 - len(presses)} 10:00"] * len(presses)
        labels = table(tmp_path / f"in/presses_{name}.csv", np.array(presses)[order], rng, day=day)
        places = np.argsort(order).tolist()
        expected_taps += [row[1:] for row in expected(labels, places)]
    how = CUT.changed(trigger="events", events="presses_{what}.csv:onset", files="rec_{what}.csv")
    how = how.changed(what="presses_{what}.csv:object", where="presses_{what}.csv:angle")

    taps = load_mapped(tmp_path / "in", how.changed(session="date:presses_{what}.csv:day")).taps

    assert [row[1:] for row in labelled(taps)] == expected_taps
    assert taps.session.tolist() == [0, 0, 0, 1, 1]


def test_presses_without_a_label_are_left_out_and_told(tmp_path, rng):
    """As rests are in a table of events."""
    stream(tmp_path / "s.csv", [10, 40, 70])
    labels = table(tmp_path / "presses.csv", [10, 25, 40, 70], rng)
    lines = (tmp_path / "presses.csv").read_text().splitlines()
    (tmp_path / "presses.csv").write_text("\n".join([*lines[:2], "0.25,n/a,n/a", *lines[3:]]))

    taps, told = load_mapped(tmp_path / "s.csv", EVENTS.changed(what="presses.csv:object", where="presses.csv:angle"))

    assert [row[1:] for row in labelled(taps)] == [row[1:] for row in expected(labels, [0, 2, 3])]
    assert told[-1] == "1 press left out: without a label."
