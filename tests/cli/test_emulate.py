"""`solidtouch emulate`: a bench for other programs, which leaves only its rig.toml behind."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from solidtouch.cli.emulate import fault_of, switch_on
from solidtouch.hardware.emulator.faults import Switches
from solidtouch.hardware.emulator.shared_clock import SharedClock, SocketConnection
from solidtouch.hardware.link.port import Port
from solidtouch.hardware.rig.settings import load_rig
from solidtouch.models.errors import InputError


@contextmanager
def emulating(folder, *options) -> Iterator[subprocess.Popen]:
    """The command in a process of its own, ready."""
    words = [sys.executable, "-m", "solidtouch.cli", "emulate", "--out", str(folder), *options]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        process.said = [process.stdout.readline() for _ in range(2)]
        yield process
    finally:
        process.kill()
        process.communicate()


def assert_ends(process, folder, number, code):
    """A signal ends it, and it leaves only its settings."""
    process.send_signal(number)

    assert process.wait(10) == code
    assert "Traceback" not in process.stderr.read()
    assert list(folder.iterdir()) == [folder / "rig.toml"]


def test_it_serves_until_ctrl_c(tmp_path):
    folder = tmp_path / "bench"
    with emulating(folder, "--preset", "ideal") as process:
        assert f"solidtouch rig check {folder / 'rig.toml'}" in process.said[1]
        rig = load_rig(folder / "rig.toml")
        with SocketConnection(rig.emulator.control) as connection:
            clock = SharedClock(connection)
            port = Port(rig.stage.port)
            port.open()
            port.write(b"$I\n")
            clock.wait([port], 1.0)

            assert port.read().startswith(b"[VER:")
            assert clock.control({"object": 4})["object_name"] == "12 mm rod"

            port.close()
        assert_ends(process, folder, signal.SIGINT, 0)


def test_in_real_time_it_is_driven_by_the_clock_of_the_host_and_a_second_one_leaves_it_alone(
    tmp_path, host_clock, command
):
    with emulating(tmp_path, "--real-time", "--sensor", "lines", "--fault", "reset_on_open:times=1") as process:
        second = command("emulate", "--out", tmp_path)

        assert second.code == 2
        assert "control: another emulator is running there" in second.err

        rig = load_rig(tmp_path / "rig.toml")
        sensor, stage = Port(rig.sensor.port), Port(rig.stage.port)
        sensor.open()
        host_clock.wait([sensor], host_clock.now() + 5.0)

        assert sensor.read()
        assert not rig.emulator.shared_clock

        with SocketConnection(rig.emulator.control) as connection:
            assert connection.control({})["faults"] == ["reset_on_open"]

            stage.open()

            assert connection.control({})["open"]["stage"]

        stage.close()
        sensor.close()
        assert_ends(process, tmp_path, signal.SIGTERM, 143)


@pytest.fixture
def host_clock():
    from solidtouch.hardware.link.loop import HostClock

    return HostClock()


@pytest.mark.parametrize("value", ["text", "9" * 5000, "[" * 100_000])
def test_a_parameter_that_is_no_json_is_text(value):
    assert fault_of(f"jump:size={value},times=2") == ("jump", {"size": value, "times": 2})


def test_the_faults_are_listed_without_a_folder(command):
    done = command("emulate", "--fault", "list")

    assert done.code == 0
    assert "second_reader" in done.out
    assert "32" in done.out


@pytest.mark.parametrize(("folder", "problem"), [("none", "no such folder"), ("", "not the folder of an emulator")])
def test_orders_to_a_folder_without_an_emulator_name_it(folder, problem, command, tmp_path):
    done = command("emulate", "fault", tmp_path / folder, "freeze")

    assert (done.code, f"{tmp_path / folder}: {problem}" in done.err) == (2, True)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--preset", "none"], "Unknown preset 'none'"),
        (["--fault", "jump"], "Unknown fault 'jump'"),
        (["--fault", "late:delay_s"], "--fault late:delay_s: expected key=value, got 'delay_s'"),
        (["--fault", "late:times=many"], "--fault late:times=many: invalid parameters."),
        (["--sensor", "eye"], "--sensor is wrong: 'eye' is not one of"),
    ],
)
def test_what_cannot_be_emulated_is_said(command, tmp_path, options, sentence):
    done = command("emulate", "--out", tmp_path / "bench", *options)

    assert done.code == 2
    assert sentence in done.err
    assert not (tmp_path / "bench").exists()


def test_a_path_too_long_for_a_socket_is_refused_before_anything_is_made(command, tmp_path):
    folder = tmp_path / ("x" * 100)
    done = command("emulate", "--out", folder)

    assert done.code == 2
    assert "a socket path may have at most 107 bytes" in done.err
    assert not folder.exists()


def test_a_fault_is_told_in_one_word():
    switches = Switches()
    switch_on(switches, "late:delay_s=0.2,times=3,port=sensor")
    switch_on(switches, "lost_ok")

    assert list(switches) == ["late", "lost_ok"]
    assert switches.strikes("late", 0.0, "sensor") == {"delay_s": 0.2}


@pytest.mark.parametrize("words", ["late:=", "late:name=2", "late:times=x", "late:rate=2", ":", "late:port=door"])
def test_words_that_tell_no_fault_are_refused(words):
    with pytest.raises(InputError, match=r"[Ff]ault"):
        switch_on(Switches(), words)
