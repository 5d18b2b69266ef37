"""Recordings of the rig give back the taps that were made, and whatever a damaged file still holds."""

import json
import os
from itertools import accumulate

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from slow_cases import slow_but
from solidtouch.hardware.recording.collection import collect
from solidtouch.hardware.recording.recording import Recorder
from solidtouch.hardware.recording.settings import about_rig
from solidtouch.models.errors import InputError
from solidtouch.models.io import untrusted
from solidtouch.models.io.load import load_taps, read_recording
from solidtouch.models.io.rig import read_rig, taps_from_recording
from solidtouch.models.io.rig_reader import RecordingReader
from solidtouch.models.io.rig_recording import TOPICS


@pytest.fixture(scope="module")
def made(fake_rig, tmp_path_factory):
    """Two settling taps and 8 labelled ones, the second attempt rejected; the file and what the rig returned."""
    return _make(fake_rig, tmp_path_factory.mktemp("made") / "whole.mcap", fake_rig.fake_plan(), finish=True)


@pytest.fixture(scope="module")
def killed(fake_rig, tmp_path_factory):
    """Three taps in a file without an end."""
    plan = fake_rig.parse_plan('settle_taps = 0\npositions = [1.5, 2.5, 4.0]\nobjects = [{ name = "ball" }]')
    return _make(fake_rig, tmp_path_factory.mktemp("killed") / "killed.mcap", plan, finish=False)


@pytest.fixture(scope="module")
def unfiltered(fake_rig, tmp_path_factory):
    """The same without a high-pass."""
    plan = fake_rig.parse_plan('settle_taps = 0\npositions = [1.5, 2.5, 4.0]\nobjects = [{ name = "ball" }]')
    bench = fake_rig.parse_rig(fake_rig.RIG.replace("highpass_hz = 0.5", "highpass_hz = 0"))
    return _make(fake_rig, tmp_path_factory.mktemp("plain") / "killed.mcap", plan, finish=False, bench=bench)


def _make(fake_rig, path, plan, finish, bench=None):
    bench = bench or fake_rig.fake_settings()
    recorder = Recorder.create(path, about_rig(bench, "# bench", plan), lambda: 1_800_000_000 * 10**9)
    rig = fake_rig.FakeRig(recorder, bench, rejected=lambda n: n == 1).connect()
    collect(rig, plan.taps(), plan.objects, plan.settle_taps, fake_rig.FakeOperator(), recorder)
    whole = path.read_bytes()
    recorder.finish()
    if not finish:
        path.write_bytes(whole)
    return path, [(label, samples) for label, samples in rig.taps if label]


def same(tap, made):
    label, samples = made
    return {key: getattr(tap.label, key) for key in label} == label and np.array_equal(tap.samples, samples)


def test_a_recording_gives_back_the_taps_that_the_rig_returned(made):
    """To the last bit, although the high-pass ran through settling and rejected taps; those are left out."""
    path, taps = made
    read = read_rig(path)

    assert len(read.taps) == len(taps) == 8
    assert all(map(same, read.taps, taps))
    assert read.lost == ""


def test_the_tap_set_has_the_labels_and_tables_of_rig_and_plan(made, fake_rig):
    read = load_taps(made[0])

    assert read.taps.shape == (8, 7, 3)
    assert read.what_name == ["thin", "thick"]
    assert read.what.tolist() == [0, 0, 0, 0, 1, 1, 1, 1]
    assert read.where.tolist() == [1.5, 2.5, 3.5, 4.5] * 2
    assert read.trial.tolist() == list(range(8))
    assert set(read.session) == {4}
    assert read.preprocessing == fake_rig.fake_settings().preprocessing
    assert read.dataset["what_value"].values.tolist() == [4, 6.5]
    assert read.dataset["where_value"].values.tolist() == [2, 4]
    assert read.dataset["where_edges"].values.tolist() == [1, 3, 5]
    assert read.dataset["taxel_position"].values.tolist() == [[0, 1], [2, 3.5], [4, 5]]
    assert read.dataset["taps"].attrs["units"] == "counts"
    assert read.dataset.attrs["source"] == "recorded on fake bench, 2027-01-15 08:00:00 UTC"
    assert read.grid().shape == (2, 2)


def test_other_readers_find_messages_schemas_and_a_summary(made):
    """What the log viewers of robots need: an index of channels, and an object at the top of each JSON schema."""
    with made[0].open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        messages = list(reader.iter_messages(log_time_order=False))

    assert {channel.topic for channel in summary.channels.values()} == set(TOPICS)
    assert summary.statistics.message_count == len(messages)
    for schema in summary.schemas.values():
        assert schema.encoding == "jsonschema"
        assert json.loads(schema.data)["type"] == "object"
    for schema, _, message in messages:
        assert set(json.loads(schema.data)["required"]) <= set(json.loads(message.data))
    times = [message.log_time for _, _, message in messages]
    assert times == sorted(times)
    assert [message.sequence for _, _, message in messages] == list(range(len(messages)))


def test_a_file_cut_at_any_byte_gives_every_tap_before_the_cut(killed):
    """No length is an error, nothing that came before is missing, and every byte is either read or counted lost.

    Within the data of a message, where one cut is as another, only every seventh byte is tried.
    """
    path, taps = killed
    whole = path.read_bytes()
    ends = [end for entry, end in _entries_with_ends(path) if entry.topic == "/tap" and entry.content.accepted]
    assert len(ends) == len(taps) == 3
    cut = path.with_name("cut.mcap")
    cut.write_bytes(whole)
    borders = {end + more for _, end in _entries_with_ends(path) for more in range(-9, 32)}
    for size in range(len(whole), -1, -1):
        if size % 7 and size not in borders and size > 4000:
            continue
        os.truncate(cut, size)
        reader = RecordingReader(cut)
        entries = list(reader)
        accepted = sum(entry.topic == "/tap" and entry.content.accepted for entry in entries)

        assert accepted == sum(end <= size for end in ends)
        assert not reader.damaged
        assert not reader.finished
        if size in ends:
            assert reader.lost_bytes == 0
            assert [same(*pair) for pair in zip(read_rig(cut).taps, taps, strict=False)] == [True] * accepted


def _entries_with_ends(path):
    """Every message with the offset behind it: how much is left when the file ends there."""
    size = path.stat().st_size
    sizes = [9 + 22 + len(entry.data) for entry in RecordingReader(path)]
    begin = size - sum(sizes)
    return zip(RecordingReader(path), (begin + end for end in accumulate(sizes)), strict=True)


@given(tail=st.one_of(st.binary(max_size=200), st.integers(1, 5000).map(bytes)))
@settings(max_examples=100, deadline=None)
def test_garbage_behind_the_last_message_costs_nothing(killed, tail):
    path, taps = killed
    spoiled = path.with_name("tail.mcap")
    spoiled.write_bytes(path.read_bytes() + tail)
    read = read_rig(spoiled)

    assert len(read.taps) == len(taps)
    assert all(map(same, read.taps, taps))
    assert read.lost == (f"the last {len(tail)} bytes are damaged" if tail else "")


@pytest.mark.parametrize("recorded", slow_but(["killed"], ["killed", "unfiltered"]))
@given(data=st.data())
@settings(max_examples=150, deadline=None)
def test_a_flipped_bit_never_changes_a_tap(recorded, request, data):
    """Taps may be lost, and it is said, but those that are left are those that were made, in their order."""
    path, taps = request.getfixturevalue(recorded)
    whole = bytearray(path.read_bytes())
    first = next(end for entry, end in _entries_with_ends(path) if entry.topic == "/rig")
    place = data.draw(st.integers(first, len(whole) - 1))
    whole[place] ^= 1 << data.draw(st.integers(0, 7))
    spoiled = path.with_name("flip.mcap")
    spoiled.write_bytes(whole)
    read = read_rig(spoiled)

    left = iter(taps)
    assert all(any(same(tap, one) for one in left) for tap in read.taps)
    assert len(read.taps) == len(taps) or read.lost


@pytest.mark.parametrize("bit", range(8))
def test_a_message_that_became_another_record_is_missed(killed, bit):
    """The last one of a recording whose writer was killed; its opcode is changed."""
    path, taps = killed
    whole = bytearray(path.read_bytes())
    *_, (_, end), (last, _) = _entries_with_ends(path)
    assert (last.topic, whole[end]) == ("/tap", 5)
    whole[end] ^= 1 << bit
    spoiled = path.with_name("opcode.mcap")
    spoiled.write_bytes(whole)
    read = read_rig(spoiled)

    assert len(read.taps) == len(taps) - 1
    assert read.lost


def test_a_message_of_no_channel_is_damaged(killed):
    """The last tap of a recording whose writer was killed, as nothing comes after it that would miss it."""
    path, taps = killed
    whole = bytearray(path.read_bytes())
    *_, (_, end), (last, _) = _entries_with_ends(path)
    assert last.topic == "/tap"
    whole[end + 9 : end + 11] = (999).to_bytes(2, "little")  # behind opcode and length
    spoiled = path.with_name("channel.mcap")
    spoiled.write_bytes(whole)
    read = read_rig(spoiled)

    assert len(read.taps) == len(taps) - 1
    assert read.lost == "1 message before is damaged"


@pytest.mark.parametrize(("recorded", "trials"), [("unfiltered", [1, 2]), ("killed", [])])
def test_a_damaged_message_costs_its_own_tap(recorded, trials, request):
    """With a high-pass it costs all up to the next stream, as the state of the filter is lost."""
    path, _ = request.getfixturevalue(recorded)
    whole = path.read_bytes()
    presses = [end for entry, end in _entries_with_ends(path) if entry.topic == "/press"]
    spoiled = path.with_name("one.mcap")
    spoiled.write_bytes(whole[: presses[0] - 3] + b"?" + whole[presses[0] - 2 :])
    read = read_rig(spoiled)

    assert [tap.label.trial for tap in read.taps] == trials
    assert read.lost == "2 messages before are damaged"
    if trials:
        assert taps_from_recording(spoiled).dataset.attrs["source"].endswith("2 messages before are damaged")


def test_a_new_stream_begins_with_a_new_cutter(fake_rig, tmp_path):
    """A tap that was in progress when the stream ended is not completed by the frames of the next."""
    plan = fake_rig.fake_plan()
    path = tmp_path / "two.mcap"
    with Recorder.create(path, about_rig(fake_rig.fake_settings(), "", plan)) as recorder:
        first = fake_rig.FakeRig(recorder).connect()
        first.label = {"trial": 0, "what": 1, "where_mm": 1.5, "session": 0}
        first.tap()
        recorder.press(first.loop.now, first.label)
        second = fake_rig.FakeRig(recorder).connect()
        second.label = {"trial": 1, "what": 0, "where_mm": 2.5, "session": 0}
        second.tap()
    read = read_rig(path)

    assert [tap.label.trial for tap in read.taps] == [0, 1]
    assert all(map(same, read.taps, first.taps + second.taps))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a recording of the rig"),
        (b"\x89MCA", "not a recording of the rig"),
        (b"time_s,what", r"bad\.mcap: not an MCAP file"),
    ],
)
def test_a_file_that_is_no_recording_is_refused(tmp_path, content, message):
    path = tmp_path / "bad.mcap"
    path.write_bytes(content)

    with pytest.raises(InputError, match=message):
        load_taps(path)


def test_an_mcap_file_of_another_program_is_refused(tmp_path):
    """Compressed and with other topics."""
    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start()
        channel = writer.register_channel("/camera", "json", writer.register_schema("Camera", "jsonschema", b"{}"))
        writer.add_message(channel, 5, b"{}", 5)
        writer.finish()

    with pytest.raises(InputError, match=r"other\.mcap: not a recording of the rig: the header is missing"):
        load_taps(path)


def test_a_recording_in_chunks_is_read_too(made, tmp_path):
    """As other tools write it when they filter or merge files."""
    path, taps = made
    with path.open("rb") as file, (tmp_path / "chunks.mcap").open("wb") as target:
        writer = Writer(target, compression=CompressionType.NONE)
        writer.start()
        channels = {}
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            if channel.topic not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, channel.message_encoding, number)
            writer.add_message(channels[channel.topic], message.log_time, message.data, message.publish_time)
        writer.finish()

    assert all(map(same, read_rig(tmp_path / "chunks.mcap").taps, taps))
    assert len(read_rig(tmp_path / "chunks.mcap").taps) == len(taps)


def test_a_chunk_that_unpacks_to_too_much_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(untrusted, "_SMALL", 100_000)
    path = tmp_path / "chunk.mcap"
    with path.open("wb") as target:
        writer = Writer(target, compression=CompressionType.ZSTD)
        writer.start()
        channel = writer.register_channel("/x", "json", 0)
        writer.add_message(channel, 0, bytes(2_000_000), 0)
        writer.finish()

    with pytest.raises(InputError, match=r"chunk\.mcap: declares 2 MB of content in .*; more than 250 times"):
        load_taps(path)


def test_a_recording_without_labelled_taps_says_so(fake_rig, tmp_path):
    path = tmp_path / "none.mcap"
    with Recorder.create(path, about_rig(fake_rig.fake_settings())) as recorder:
        fake_rig.FakeRig(recorder).connect().tap()
    with path.open("ab") as file:
        file.write(b"12345")

    with pytest.raises(InputError, match="has no accepted, labelled tap; the last 5 bytes are damaged"):
        load_taps(path)


def test_a_message_of_lists_in_lists_is_damaged(fake_rig, tmp_path):
    path, deep = tmp_path / "deep.mcap", b"[" * 200_000 + b"]" * 200_000
    with Recorder.create(path, about_rig(fake_rig.fake_settings())) as recorder:
        recorder._keep("/event", 0, b'{"time_s": 1, "kind": "", "text": "", "details": {"a": %s}}' % deep)

    with pytest.raises(InputError, match="no accepted, labelled tap; 1 message before is damaged"):
        load_taps(path)


def test_files_that_cannot_be_read_are_named(tmp_path, made):
    with pytest.raises(InputError, match=r"gone\.mcap: cannot read: No such file"):
        load_taps(tmp_path / "gone.mcap")
    with pytest.raises(InputError, match=r"cannot read: Is a directory"):
        RecordingReader(tmp_path)
    with pytest.raises(InputError, match="a recording of the rig holds taps cut at each press"):
        read_recording(made[0])
