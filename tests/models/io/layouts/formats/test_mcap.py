"""MCAP files of robots, written by the library of the format."""

import json

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer
from mcap_ros2._dynamic import serialize_dynamic
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.formats import mcap
from solidtouch.models.io.layouts.formats.contents import TextTable
from solidtouch.models.io.layouts.formats.mcap import open_mcap
from solidtouch.models.io.layouts.mapping import TapMap
from solidtouch.models.io.layouts.tap_set import load_mapped

DEFINITION = """Header header
float64[] position
uint8[] image
Point[] points
string name
================
MSG: a/Header
builtin_interfaces/Time stamp
================
MSG: a/Point
float32 x
float32 y
"""
ENCODE = serialize_dynamic("a/msg/Skin", DEFINITION)["a/msg/Skin"]
BEGIN = 1_700_000_000


def ros(i):
    return ENCODE(
        {
            "header": {"stamp": {"sec": i, "nanosec": 500_000_000}},
            "position": [float(i)] * (1 + i % 2),
            "image": bytes([i, 2]),
            "points": [{"x": float(i), "y": 2.0}] * 3,
            "name": f"rod {i}",
        }
    )


def written(folder, number=5, data=None, compression=CompressionType.ZSTD):
    path = folder / "t.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=300, compression=compression)
        writer.start()
        skin = writer.register_channel("/skin", "json", writer.register_schema("s", "jsonschema", b"{}"))
        other = writer.register_channel("/other", "protobuf", 0)
        robot = writer.register_channel(
            "/robot", "cdr", writer.register_schema("a/msg/Skin", "ros2msg", DEFINITION.encode())
        )
        for i in range(number):
            time = (BEGIN + i) * 10**9
            row = {"taxels": [i, i + 1.5], "what": "rod", "p": {"x": i}}
            writer.add_message(skin, time, data or json.dumps(row).encode(), time + 10**9)
            writer.add_message(other, time, b"x", time)
            writer.add_message(robot, time, ros(i), time)
        writer.add_metadata("about", {"licence": "CC0"})
        writer.finish()
    return path


@pytest.mark.parametrize("held", [1, 1 << 22])
def test_topics_are_groups_of_variables_with_a_row_for_each_message(tmp_path, monkeypatch, held):
    """However many messages are held at a time."""
    monkeypatch.setattr(mcap, "_BYTES", held)
    contents = open_mcap(written(tmp_path), TextTable())
    names = ["/skin/taxels", "/skin/what", "/robot/position", "/robot/image", "/robot/points.x", "/robot/name"]
    found, numbers = contents.read(names, ["/skin/p.x", "/skin/log_time", "/skin/publish_time"])

    assert list(contents.variables)[:5] == [
        "/skin/log_time",
        "/skin/publish_time",
        "/skin/taxels",
        "/skin/what",
        "/skin/p.x",
    ]
    assert [contents.variables[name].shape for name in names[:3]] == [(5, 2), (5,), (5, None)]
    assert contents.variables["/robot/log_time"].unit == "s"
    assert contents.attributes == {"about.licence": "CC0"}
    assert contents.unreadable == {"/other": "messages of encoding protobuf with a schema of encoding none"}
    assert found["/skin/taxels"].tolist() == [[i, i + 1.5] for i in range(5)]
    assert found["/skin/what"].tolist() == ["rod"] * 5
    assert [each.tolist() for each in found["/robot/position"]] == [[i] * (1 + i % 2) for i in range(5)]
    assert found["/robot/image"].tolist() == [[i, 2] for i in range(5)]
    assert found["/robot/points.x"].tolist() == [[i] * 3 for i in range(5)]
    assert found["/robot/name"].tolist() == [f"rod {i}" for i in range(5)]
    assert numbers.tolist() == [[i, BEGIN + i, BEGIN + i + 1] for i in range(5)]
    assert contents.read([], ["/robot/header.stamp"])[1].tolist() == [[i + 0.5] for i in range(5)]


def test_only_the_first_messages_are_read_to_look_at_them(tmp_path, monkeypatch):
    monkeypatch.setattr(mcap, "_BYTES", 400)
    path = written(tmp_path, 50)
    contents = open_mcap(path, TextTable(), 3)
    read = contents.read([], ["/skin/p.x"])[1][:, 0].tolist()

    assert contents.variables["/skin/p.x"].shape == (len(read),)
    assert read == list(range(len(read)))
    assert 5 < len(read) < 50
    assert contents.unreadable["the rest of the file"].startswith("its first 1.2")
    assert len(open_mcap(path, TextTable()).read([], ["/skin/p.x"])[1]) == 50


def test_messages_of_ros_1_are_refused_with_what_converts_them(tmp_path):
    path = tmp_path / "t.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("std_msgs/Float64", "ros1msg", b"float64 data")
        writer.add_message(writer.register_channel("/skin", "ros1", schema), 0, b"x" * 8, 0)
        writer.finish()
    with pytest.raises(InputError, match=r"/skin: messages of ROS 1 are not read; rosbags-convert --src IN\.bag"):
        open_mcap(path, TextTable())


def test_columns_are_of_one_topic(tmp_path):
    with pytest.raises(InputError, match=r"/skin/p\.x and /robot/log_time are not of one topic"):
        open_mcap(written(tmp_path), TextTable()).read([], ["/skin/p.x", "/robot/log_time"])


def test_what_cannot_be_decoded_is_listed(tmp_path, monkeypatch):
    assert "not JSON" in open_mcap(written(tmp_path, data=b"{"), TextTable()).unreadable["/skin"]
    monkeypatch.setitem(__import__("sys").modules, "mcap_ros2.decoder", None)
    contents = open_mcap(written(tmp_path), TextTable())
    with pytest.raises(InputError, match=r"/robot cannot be read: .*pip install 'solidtouch\[formats\]'"):
        contents.named("/robot")


def test_a_file_that_breaks_off_is_read_up_to_there(tmp_path):
    path = written(tmp_path, 50)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 3])
    contents = open_mcap(path, TextTable())
    read = contents.read([], ["/skin/p.x"])[1]

    assert "bytes are damaged" in contents.unreadable["the end of the file"]
    told = load_mapped(path, TapMap(taxels="/skin/p.x", tap="row")).told
    assert told[0].startswith(f"{path}: The last ")
    assert 0 < len(read) < 50
    assert read[:, 0].tolist() == list(range(len(read)))


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0\r\n", b"hello hello", b"\x89MCAP0\r\n1234567890"])
def test_a_file_without_messages_is_refused(tmp_path, content):
    path = tmp_path / "t.mcap"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"no messages that can be read|not an MCAP file"):
        open_mcap(path, TextTable())


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.ZSTD])
def test_damaged_files_end_in_a_sentence_or_hold_intact_messages(tmp_path, compression):
    """And where one is missing, that is listed."""
    content, rng = written(tmp_path, compression=compression).read_bytes(), np.random.default_rng(3)
    path, read, whole = tmp_path / "damaged.mcap", 0, [[i, i + 1.5] for i in range(5)]
    for _ in range(100):
        damaged = bytearray(content)
        damaged[rng.integers(len(damaged))] = rng.integers(256)
        path.write_bytes(damaged)
        try:
            contents = open_mcap(path, TextTable())
            found, _ = contents.read(list(contents.variables))
        except InputError as error:
            assert str(error).endswith(".")  # noqa: PT017
            continue
        taxels = found.get("/skin/taxels", np.empty((0, 2))).tolist()
        assert all(each in whole for each in taxels)
        assert len(taxels) == len(whole) or contents.unreadable.keys() - {"/other"}
        read += len(taxels) > 0
    assert read > 10
