"""Labels on another topic of an MCAP file than the samples: the last message at or before each row."""

import json

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.first_look.look import look
from solidtouch.models.io.layouts.mapping import TapMap
from solidtouch.models.io.layouts.tap_set import load_mapped

BEGIN = 1_700_000_000_000_000_000
STEP = 10_000_000  # ns
PRESSES = range(20, 200, 30)
STREAM = TapMap(
    taps="/skin/v", time="/skin/log_time", axes="sample,taxel", trigger="contact", level=2.0, window=10, pre=2
)


def bag(path, topics):
    """A file of topics, each a list of times in frames and messages."""
    messages = sorted(
        ((at, topic, row) for topic, rows in topics.items() for at, row in rows), key=lambda each: each[0]
    )
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start()
        schema = writer.register_schema("s", "jsonschema", b"{}")
        channels = {topic: writer.register_channel(topic, "json", schema) for topic in topics}
        for at, topic, row in messages:
            time = BEGIN + round(at * STEP)
            writer.add_message(channels[topic], time, json.dumps(row).encode(), time)
        writer.finish()
    return path


@pytest.fixture
def recorded():
    """200 frames with six presses, an object named when it changes, and a pose for every fifth frame."""
    values = np.zeros((200, 2))
    for number, frame in enumerate(PRESSES):
        values[frame : frame + 5] = 3 + number
    return {
        "/skin": [(n, {"v": each.tolist(), "c": n}) for n, each in enumerate(values)],
        "/object": [(-0.5, {"data": "ball"}), (69.9, {"data": "cube"}), (108, {"data": "ball"})],
        "/pose": [(n + 0.1, {"x": 2 * (n // 100)}) for n in range(0, 200, 5)],
    }


def found(taps):
    """Number of the press, object and position of each tap."""
    number = (taps.taps[:, 2, 0] - 3).astype(int).tolist()
    return list(zip(number, [taps.what_name[what] for what in taps.what], taps.where.tolist(), strict=True))


def test_the_last_message_at_or_before_each_row_counts(recorded, tmp_path):
    """Of labels, and of what is kept; frame 108, with which the fourth tap begins, has the object of its time."""
    path = bag(tmp_path / "a.mcap", recorded)
    taps, told = load_mapped(path, STREAM.changed(what="/object/data", where="/pose/x"))
    kept = load_mapped(path, STREAM.changed(what="/object/data", where="/pose/x", keep="/object/data=cube")).taps

    assert found(taps) == [
        (0, "ball", 0.0),
        (1, "ball", 0.0),
        (2, "cube", 0.0),
        (3, "ball", 2.0),
        (4, "ball", 2.0),
        (5, "ball", 2.0),
    ]
    assert told[0] == "/object/data, /pose/x: the last message at or before each of /skin counts."
    assert told[1] == f"{path}: 1 row left out: before the first of these."
    assert kept.what_name == ["cube"]
    assert found(kept) == [(2, "cube", 0.0)]


def test_a_signal_on_another_topic_tells_presses(recorded, tmp_path):
    """As a switch that is published when it changes."""
    recorded["/valve"] = [(-1, {"on": False})]
    recorded["/valve"] += [each for n in PRESSES for each in ((n - 0.5, {"on": True}), (n + 9.5, {"on": False}))]
    how = STREAM.changed(trigger="signal", signal="/valve/on", level=None)

    assert [press for press, *_ in found(load_mapped(bag(tmp_path / "a.mcap", recorded), how).taps)] == [*range(6)]


def test_columns_of_one_topic_have_labels_of_another(recorded, tmp_path):
    rows = [(at, {"f0": row["v"][0], "f1": row["v"][1]}) for at, row in recorded["/skin"]]
    path = bag(tmp_path / "a.mcap", {**recorded, "/skin": rows})
    how = STREAM.changed(taps=None, axes=None, taxels="/skin/f*", what="/object/data", where="/pose/x")

    assert found(load_mapped(path, how).taps)[2:4] == [(2, "cube", 0.0), (3, "ball", 2.0)]


def test_messages_that_are_taps_are_labelled_likewise(tmp_path):
    """Also where lengths differ."""
    taps = [(10 * n, {"samples": [[n, j] for j in range(3 + n % 2)]}) for n in range(4)]
    path = tmp_path / "a.mcap"
    how = TapMap(taps="/tap/samples", length="shortest", axes="tap,sample,taxel", what="/what/value")
    recorded = {"/tap": taps, "/what": [(at, {"value": name}) for at, name in ((5, "ball"), (25, "rod"))]}
    taps, told = load_mapped(bag(path, recorded), how)

    assert taps.taps[:, 0, 0].tolist() == [1, 2, 3]
    assert [taps.what_name[what] for what in taps.what] == ["ball", "ball", "rod"]
    assert f"{path}: 1 row left out: before the first of these." in told


def test_topics_with_as_many_messages_go_row_by_row(recorded, tmp_path):
    """A label that is published just after each sample is that sample's."""
    recorded["/label"] = [(n + 0.1, {"data": f"o{n // 100}"}) for n in range(200)]
    taps, told = load_mapped(bag(tmp_path / "a.mcap", recorded), STREAM.changed(what="/label/data"))

    assert [taps.what_name[what] for what in taps.what] == ["o0"] * 3 + ["o1"] * 3
    assert not any("last message" in each for each in told)


def test_a_label_after_all_samples_is_refused(recorded, tmp_path):
    recorded["/object"] = [(500, {"data": "ball"})]

    with pytest.raises(InputError, match=r"a\.mcap: /object/data: its first message is later than all of /skin\."):
        load_mapped(bag(tmp_path / "a.mcap", recorded), STREAM.changed(what="/object/data"))


def test_a_first_look_proposes_the_object_of_another_topic(recorded, tmp_path):
    recorded["/task/object"] = recorded.pop("/object")
    text = look([bag(tmp_path / "a.mcap", recorded)], TapMap())

    assert 'taps = "/skin/v"' in text
    assert 'what = "/task/object/data"  # texts of another topic; the last one before each row counts' in text
