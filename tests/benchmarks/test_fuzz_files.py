"""Damaged files are made at random, and how their reader ends is counted."""

import random
import sys
from operator import ne
from pathlib import Path

import pytest
from solidtouch.hardware.recording.recording import Recorder
from solidtouch.hardware.recording.settings import about_rig
from solidtouch.models.io.rig_reader import RecordingReader
from solidtouch.models.setting_file import Setting

from benchmarks.checks import fuzz_commands, fuzz_files
from benchmarks.page import check_block


def dice(seed):
    return random.Random(seed)  # noqa: S311 - no secret


CONTENT = b'{"power": 12.5, "bins": 100, "model": "histogram"}' * 4


def test_mutations_differ_and_follow_the_seed():
    def made(seed):
        generator = dice(seed)
        return [fuzz_files.mutated(CONTENT, generator) for _ in range(50)]

    assert made(1) == made(1) != made(2)
    assert len(set(made(1)) - {CONTENT}) > 45


def test_an_empty_file_can_be_damaged_further():
    assert [fuzz_files.mutated(b"", dice(seed)) for seed in range(20)]


def test_one_file_of_a_store_is_damaged(tmp_path):
    store = tmp_path / "x.zarr"
    store.mkdir()
    for name in "abc":
        (store / name).write_bytes(CONTENT)
    fuzz_files.damaged(store, tmp_path / "case.zarr", dice(1))

    assert [path.read_bytes() == CONTENT for path in sorted(store.iterdir())] == [True] * 3
    assert sorted(path.read_bytes() == CONTENT for path in (tmp_path / "case.zarr").iterdir()) == [False, True, True]


def test_one_message_of_a_recording_is_damaged(fake_rig, tmp_path):
    """The checksums match, as in files of other programs, so that what is in it is read."""
    path, case = tmp_path / "taps.mcap", tmp_path / "case.mcap"
    with Recorder.create(path, about_rig(fake_rig.fake_settings())) as recorder:
        rig = fake_rig.FakeRig(recorder).connect()
        rig.tap()
        rig.tap()
    whole = list(RecordingReader(path))
    for seed in range(20):
        fuzz_files.damage_recording(path, case, dice(seed))
        reader = RecordingReader(case)
        entries = list(reader)
        assert sum(not entry.intact for entry in entries) == reader.damaged <= 1
        assert sum(map(ne, [entry.data for entry in entries], [entry.data for entry in whole])) <= 2
        assert case.read_bytes() != path.read_bytes()


@pytest.mark.slow
def test_damaged_settings_are_refused_or_accepted(tmp_path):
    Setting().save(tmp_path / "setting.json")
    ends = fuzz_files.fuzz("setting", tmp_path / "setting.json", 20, dice(3), tmp_path / "kept")

    assert ends.total() == 20
    assert set(ends) <= {"accepted", "refused"}
    assert ends["refused"] > 10
    assert [path.name for path in tmp_path.iterdir()] == ["setting.json"]


@pytest.mark.skipif(sys.platform == "win32", reason="the reader is a shell script")
def test_bad_ends_are_counted_and_their_files_kept(tmp_path, monkeypatch):
    """A reader that raises, then dies; its successors take too long."""
    script = tmp_path / "reader"
    script.write_text(
        f"#!/bin/sh\necho ready\nread x\nif [ -e {tmp_path}/died ]; then exec sleep 60; fi\n"
        f"echo traceback KeyError at x.py:3\nread x\ntouch {tmp_path}/died\n"
    )
    script.chmod(0o755)
    monkeypatch.setattr(fuzz_files.sys, "executable", str(script))
    (tmp_path / "taps.csv").write_bytes(CONTENT)
    ends = fuzz_files.fuzz("csv", tmp_path / "taps.csv", 4, dice(4), tmp_path / "kept", 0.2)

    assert ends == {"traceback": 1, "crash": 1, "hang": 2}
    assert sorted(path.name for path in (tmp_path / "kept").iterdir()) == [
        "csv-0-traceback.csv",
        "csv-1-crash.csv",
        "csv-2-hang.csv",
        "csv-3-hang.csv",
    ]


def test_the_tables_have_a_place_in_the_page():
    check_block(Path(__file__).parents[2] / "docs/reference/results.md", "files", "commands")


def test_lines_change_in_words_and_options_of_their_command():
    known = fuzz_commands.options()
    words = ["emulate", "object", "bench", "2"]
    lines = [fuzz_commands.mutated(words, dice(seed), known) for seed in range(200)]

    assert all(line.split()[0] in known for line in fuzz_commands.LINES)
    assert len(set(map(tuple, lines)) - {tuple(words)}) > 150
    assert any("--help" in line for line in lines)
    assert fuzz_commands.mutated(words, dice(1), known) == fuzz_commands.mutated(words, dice(1), known)
