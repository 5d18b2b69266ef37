"""The rig commands as a new user types them, on an emulated bench that another thread serves."""

import os
import resource
import shutil
import signal
import threading
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from mcap.reader import make_reader
from slow_cases import slow_but
from solidtouch.hardware.emulator.emulated_bench import emulated_bench
from solidtouch.hardware.emulator.rig_file import write_rig
from solidtouch.hardware.emulator.service import Service
from solidtouch.hardware.simulator.settings import PRESETS
from solidtouch.models.io.rig import read_rig
from solidtouch.models.taps import TapSet

SETTINGS = replace(PRESETS["paper"], start_mm=6.0, end_mm=9.0)
PLAN = """
taps_per_position = 2
settle_taps = 1
positions = { start_mm = 6.0, end_mm = 9.0, spacing_mm = 1.0 }
objects = [{ name = "4 mm rod", size_mm = 4 }, { name = "12 mm rod", size_mm = 12 }]
"""
TAPS = 12


@contextmanager
def serving(folder, homed=True, real_time=False):
    """A bench in its folder; `places` are all places of the finger at which the sensor was read."""
    with emulated_bench(folder, SETTINGS, seed=3, homed=homed, shared_clock=not real_time) as bench:
        emulation, stopping = bench.emulation, threading.Event()
        write_rig(folder / "rig.toml", bench.rig, list(emulation.objects))
        (folder / "plan.toml").write_text(PLAN)
        read, places = emulation.finger.read, []

        def watched(time_s):
            places.append(emulation.state()["place_mm"])
            return read(time_s)

        emulation.finger.read = watched
        with Service(emulation, Path(bench.rig.emulator.control), real_time) as service:
            thread = threading.Thread(target=service.run, args=(stopping.is_set,))
            thread.start()
            try:
                yield SimpleNamespace(folder=folder, rig=bench.rig, emulation=emulation, places=places)
            finally:
                stopping.set()
                thread.join()


@pytest.fixture
def bench(tmp_path, monkeypatch):
    """A bench whose folder is the current one."""
    monkeypatch.chdir(tmp_path)
    with serving(tmp_path) as bench:
        yield bench


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """A model of what the bench's finger feels, fitted to a recording of it."""
    from solidtouch.cli.collect import collect
    from solidtouch.cli.fit import fit

    folder = tmp_path_factory.mktemp("model")
    with serving(folder):
        collect(folder / "rig.toml", folder / "plan.toml", folder / "a.mcap")
        fit([folder / "a.mcap"], folder / "model.nc", split="parity")
    return folder / "model.nc"


@contextmanager
def no_larger_files(size):
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def once_deep(bench, act):
    """Does something once when the finger is on an object for the first time."""
    read, done = bench.emulation.finger.read, []

    def watched(time_s):
        if bench.emulation.state()["place_mm"][1] > 1.5 and not done:
            done.append(True)
            act()
        return read(time_s)

    bench.emulation.finger.read = watched


def is_off(bench):
    return bench.emulation.state()["place_mm"][1] <= bench.rig.tap.clear_mm + 0.01


def index_of(path):
    with path.open("rb") as file:
        return make_reader(file, validate_crcs=True).get_summary()


def names(folder):
    return {path.name for path in folder.iterdir()}


def test_from_a_new_bench_to_a_decision(tmp_path, monkeypatch, command):
    """Check, collect, convert, fit and perceive, on the rig and on its recording; the devices are left at rest."""
    monkeypatch.chdir(tmp_path)
    with serving(tmp_path, homed=False) as bench:
        found = names(tmp_path)
        before_homing = command("rig", "check", "rig.toml", "--seconds", 1)
        assert (before_homing.code, "home the stage first (--home)" in " ".join(before_homing.out.split())) == (1, True)
        refused = command("collect", "rig.toml", "plan.toml", "--out", "a.mcap")
        assert (refused.code, "home it (--home)" in refused.err) == (3, True)
        checked = command("rig", "check", "rig.toml", "--home")
        assert (checked.code, "No problems found." in checked.out) == (0, True)
        bench.emulation.control({"object": 1})
        touched = command("rig", "approach", "rig.toml")
        assert (touched.code, touched.out.startswith("The object begins at y = ")) == (0, True)
        assert touched.out.splitlines()[-1] == "Finger off the object at y = 0.0 mm."
        assert is_off(bench)
        moved = len(bench.places)
        refused = command("rig", "approach", "rig.toml", "--at", 99)
        assert (refused.code, "--at 99 is outside the range, " in refused.err) == (2, True)
        assert len(bench.places) == moved
        bench.emulation.control({"object": None})
        untouched = command("rig", "approach", "rig.toml", "--at", bench.rig.range.start_mm)
        assert (untouched.code, "! nothing was touched" in untouched.out) == (1, True)
        assert names(tmp_path) == found

        collected = command("collect", "rig.toml", "plan.toml", "--out", "a.mcap")
        assert (collected.code, f"a.mcap: {TAPS} taps" in collected.out) == (0, True)
        assert command("convert", "a.mcap", "a.nc").code == 0
        assert command("fit", "a.mcap", "--split", "parity", "--out", "m.nc").code == 0

        base = ["perceive", "m.nc", "--shadow", "--deadline", 4]
        for rig in ("rig.toml", "replay:a.mcap"):
            seen = command(*base, "--rig", rig, "--object", "12 mm rod", "--start", 1)
            assert seen.code == 0
            assert "engine numpyro shadowed by numpy" in seen.out
            assert "Truth: 12 mm rod at" in seen.out
        assert is_off(bench)
        assert bench.emulation.control({})["open"] == {"stage": False, "sensor": False}
        assert names(tmp_path) == found | {"a.mcap", "a.nc", "m.nc"}

    taps = TapSet.load("a.nc")
    assert taps.trial.tolist() == list(range(TAPS))
    assert taps.dataset["what_value"].values.tolist() == [4.0, 12.0]
    thin, thick = (taps.taps[taps.what == what].max() for what in (0, 1))
    assert thick > thin  # the emulator did change the object


COMMANDS = {
    "check": ["rig", "check", "rig.toml"],
    "collect": ["collect", "rig.toml", "plan.toml", "--out", "a.mcap"],
    "perceive": ["perceive", "MODEL", "--rig", "rig.toml", "--record", "a.mcap", "--engine", "numpy"],
}


def words(name, model):
    return [model if word == "MODEL" else word for word in COMMANDS[name]]


@pytest.mark.parametrize("name", COMMANDS)
def test_a_wrong_key_is_named(name, bench, model, command):
    text = (bench.folder / "rig.toml").read_text()
    (bench.folder / "rig.toml").write_text(text.replace("depth_mm", "deep_mm"))
    done = command(*words(name, model))

    assert done.code == 2
    assert "rig.toml: tap" in done.err
    assert done.err.count("\n") == 1
    assert not bench.places


@pytest.mark.parametrize("name", COMMANDS)
def test_an_emulator_that_is_not_there_is_one_sentence(name, tmp_path, model, command, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with serving(tmp_path):
        pass
    before = names(tmp_path)
    done = command(*words(name, model))

    assert done.code == 3
    assert "control: no emulator answers; start one with `solidtouch emulate`." in done.err
    assert done.err.count("\n") == 1
    assert names(tmp_path) == before


FULL = {
    "no byte fits": (lambda _: no_larger_files(100), "writing failed"),
    "no room for all taps": (
        lambda patch: patch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=1000)),
        "are free on the disk",
    ),
}


@pytest.mark.parametrize("name", ["collect", "perceive"])
@pytest.mark.parametrize("case", FULL)
def test_a_disk_without_room_is_found_before_the_first_move(case, name, bench, model, command, monkeypatch):
    before, place = names(bench.folder), bench.emulation.state()["place_mm"]
    fill, sentence = FULL[case]
    with fill(monkeypatch) or no_larger_files(1 << 30):
        done = command(*words(name, model))

    assert done.code == 2
    assert sentence in done.err
    assert names(bench.folder) == before
    assert not bench.places
    assert bench.emulation.state()["place_mm"] == place


@pytest.mark.parametrize("name", ["collect", "perceive"])
def test_a_file_that_cannot_be_made_is_found_before_the_first_move(name, bench, model, command):
    done = command(*(str(word).replace("a.mcap", "plan.toml/a.mcap") for word in words(name, model)))

    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "cannot write: plan.toml is a file, expected a folder" in done.err
    assert not bench.places


def test_a_disk_that_gets_full_stops_a_collection_that_can_go_on(bench, command):
    with no_larger_files(200_000):
        done = command(*words("collect", None))

    assert done.code == 2
    assert "a.mcap: writing failed" in done.err
    assert done.err.splitlines()[-1] == "Finger off the object at y = 0.0 mm."
    assert is_off(bench)
    kept = len(read_rig("a.mcap").taps)
    assert 0 < kept < TAPS
    assert f"a.mcap: {kept} of {TAPS} taps recorded" in " ".join(done.err.split())
    assert command(*words("collect", None), "--resume").code == 0
    assert [tap.label.trial for tap in read_rig("a.mcap").taps] == list(range(TAPS))


SIGNALS = [(name, *ends) for name in ("collect", "perceive") for ends in ((signal.SIGINT, 130), (signal.SIGTERM, 143))]


@pytest.mark.parametrize(("name", "number", "code"), slow_but([SIGNALS[0], SIGNALS[3]], SIGNALS))
def test_a_signal_in_the_middle_of_a_press_takes_the_finger_off_and_ends_the_file(
    name, number, code, bench, model, command
):
    once_deep(bench, lambda: os.kill(os.getpid(), number))
    done = command(*words(name, model))

    assert done.code == code
    assert "interrupted" in done.err
    assert done.err.splitlines()[-1] == "Finger off the object at y = 0.0 mm."
    assert "Traceback" not in done.err
    assert max(y for _, y in bench.places) > 1.5
    assert is_off(bench)
    assert index_of(bench.folder / "a.mcap").statistics.message_count > 0
    assert names(bench.folder) >= {"a.mcap"}
    assert not [name for name in names(bench.folder) if name.startswith(".")]


def test_what_is_perceived_is_recorded(bench, model, command):
    """Trials go on from episode to episode, places are those of the moves, and the samples those of the decision."""
    base = ["perceive", model, "--rig", "rig.toml", "--record", "p.mcap", "--engine", "numpy", "--theta", 1]
    done = command(*base, "--deadline", 3, "--episodes", 2, "--start", "6.2mm")

    assert done.code == 0
    assert "p.mcap: 6 taps; convert them with `solidtouch convert p.mcap TAPS.nc`" in done.out
    recorded = read_rig("p.mcap")
    assert recorded.about.objects == ["4 mm rod", "12 mm rod"]
    assert recorded.about.sizes_mm == [4.0, 12.0]
    assert [tap.label.trial for tap in recorded.taps] == list(range(6))
    assert recorded.taps[0].label.where_mm == pytest.approx(6.2)
    assert {tap.label.where_mm for tap in recorded.taps} <= {6.2, 7.2, 8.2}
    assert command("convert", "p.mcap", "p.nc").code == 0
    assert np.array_equal(TapSet.load("p.nc").taps[4], recorded.taps[4].samples)
    assert index_of(bench.folder / "p.mcap") is not None

    read = len(bench.places)
    again = command(*base)
    assert (again.code, "p.mcap: already exists; use --force to overwrite it" in again.err) == (2, True)
    assert len(bench.places) == read
    assert command(*base, "--deadline", 1, "--force").code == 0
    assert len(read_rig("p.mcap").taps) == 1


def test_an_object_that_the_model_does_not_know_is_recorded_by_its_name(bench, model, command):
    base = ["perceive", model, "--rig", "rig.toml", "--record", "p.mcap", "--engine", "numpy", "--deadline", 1]
    done = command(*base, "--object", "8 mm rod")

    assert done.code == 0
    assert "Truth: 8 mm rod at" in done.out
    assert bench.emulation.state()["object_name"] == "8 mm rod"
    assert command("convert", "p.mcap", "p.nc").code == 0
    assert [TapSet.load("p.nc").what_name[what] for what in TapSet.load("p.nc").what] == ["8 mm rod"]


REFUSED = {
    "object": (["--rig", "rig.toml", "--object", "7 mm rod"], "--object must be one of 4 mm rod, 12 mm rod, 6 mm rod"),
    "start": (["--rig", "rig.toml", "--start", "3mm"], "3 mm is outside the range of emulated, 6 to 9 mm"),
    "simulated": ([], "--record requires a rig.toml as --rig, got 'simulated'"),
    "replay": (["--rig", "replay:a.mcap"], "requires a rig.toml as --rig, got 'replay:a.mcap'"),
    "suffix": (["--rig", "rig.toml", "--record", "p.bag"], "--record must name an .mcap file"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_recorded_is_said_before_anything_moves(case, bench, model, command):
    options, sentence = REFUSED[case]
    before = names(bench.folder)
    done = command("perceive", model, "--record", "p.mcap", "--engine", "numpy", *options)

    assert (done.code, done.err.count("\n")) == (2, 1)
    assert sentence in done.err
    assert not bench.places
    assert names(bench.folder) == before


@pytest.mark.slow
def test_without_emulator_only_a_named_object_is_known(tmp_path, monkeypatch, model, command):
    """On the clock of the host, with a rig.toml that knows of no emulator."""
    monkeypatch.chdir(tmp_path)
    with serving(tmp_path, real_time=True):
        text = (tmp_path / "rig.toml").read_text()
        (tmp_path / "rig.toml").write_text(text.partition("[emulator]")[0])
        base = ["perceive", model, "--rig", "rig.toml", "--engine", "numpy", "--deadline", 1, "--record"]
        unnamed = command(*base, "p.mcap")
        named = command(*base, "q.mcap", "--object", 1)

    assert (unnamed.code, named.code) == (0, 0)
    assert "p.mcap: 1 presses of an unknown object, not convertible to a tap set" in unnamed.out
    assert "q.mcap: 1 taps" in named.out
    refused = command("convert", "p.mcap", "p.nc")
    assert (refused.code, "no accepted, labelled tap" in refused.err) == (2, True)


def test_ctrl_c_during_a_check_says_where_the_finger_is(bench, command):
    read = bench.emulation.finger.read

    def interrupted(time_s):
        bench.emulation.finger.read = read
        os.kill(os.getpid(), signal.SIGINT)
        return read(time_s)

    bench.emulation.finger.read = interrupted
    done = command("rig", "check", "rig.toml", "--seconds", 1)

    assert (done.code, done.err.splitlines()[-1]) == (130, "Finger off the object at y = -29.0 mm.")
