"""The whole emulated bench, driven as a rig by the drivers and as a CAN adapter by a program of others."""

import threading
from dataclasses import replace

import can
import numpy as np
import pytest
from solidtouch.hardware.emulator.emulated_bench import emulated_bench
from solidtouch.hardware.emulator.service import Service
from solidtouch.hardware.emulator.shared_clock import SocketConnection
from solidtouch.hardware.errors import PositionUnknown
from solidtouch.hardware.journal import NoJournal
from solidtouch.hardware.rig.open_rig import build_rig, connected, open_rig
from solidtouch.hardware.simulator.settings import PRESETS

PAPER = PRESETS["paper"]


def taps(bench, objects, home=False):
    """One tap of each object at one place, and the rig time that all took."""
    samples = []
    with connected(build_rig(bench.rig, bench.clock, NoJournal()), home) as rig:
        rig.go(7.5)
        for what in objects:
            bench.clock.control({"object": what})
            samples.append(rig.tap())
    return samples


@pytest.mark.parametrize("homed", [True, False])
def test_the_finger_begins_where_it_is_put(tmp_path, homed):
    with emulated_bench(tmp_path, homed=homed, place_mm=(7.0, -1.5)) as bench:
        np.testing.assert_allclose(bench.emulation.place_mm, (7.0, -1.5), atol=0.01)


@pytest.mark.parametrize("kind", ["icub", "lines"])
def test_a_rig_taps_on_it(tmp_path, kind):
    with emulated_bench(tmp_path, kind=kind, homed=True) as bench:
        air, thick = taps(bench, [None, 4])

    assert thick.shape == (50, 12)
    assert np.abs(air).max() < 10
    assert 50 < thick.max() < 200
    assert np.abs(thick[:10]).max() < 10  # before the press


def test_the_same_seed_gives_the_same_bytes(tmp_path):
    def run(seed, session=0):
        with emulated_bench(tmp_path, seed=seed, session=session, homed=True) as bench:
            return taps(bench, [2])[0]

    first = run(5)

    np.testing.assert_array_equal(first, run(5))
    assert not np.array_equal(first, run(6))
    assert not np.array_equal(first, run(5, session=1))


def test_over_a_socket_it_is_the_same_rig(tmp_path):
    with emulated_bench(tmp_path, seed=5, homed=True) as bench:
        here = taps(bench, [2])[0]
    with (
        emulated_bench(tmp_path, seed=5, homed=True) as bench,
        Service(bench.emulation, tmp_path / "control") as service,
    ):
        stopping = threading.Event()
        thread = threading.Thread(target=service.run, args=(stopping.is_set,))
        thread.start()
        try:
            with open_rig(bench.rig, NoJournal()) as rig, SocketConnection(tmp_path / "control") as other:
                rig.go(7.5)
                other.control({"object": 2})
                there = rig.tap()
        finally:
            stopping.set()
            thread.join()

    np.testing.assert_array_equal(here, there)


def test_after_power_up_it_needs_homing(tmp_path):
    with emulated_bench(tmp_path) as bench:
        with pytest.raises(PositionUnknown, match="position unknown; clear the path of the stage"):
            taps(bench, [])

        assert taps(bench, [0], home=True)[0].shape == (50, 12)


def test_other_sizes_work_too(tmp_path):
    settings = replace(PAPER, taxels=PAPER.taxels[:7], rods=PAPER.rods[:3], start_mm=5.0, end_mm=11.0, cell_mm=1.5)
    with emulated_bench(tmp_path, replace(settings, spacing_mm=0.25, rate_hz=25.0), homed=True) as bench:
        (tap,) = taps(bench, [2])

    assert tap.shape == (25, 7)


def test_a_program_of_others_reads_the_adapter_in_real_time(tmp_path):
    with (
        emulated_bench(tmp_path, shared_clock=False) as bench,
        Service(bench.emulation, tmp_path / "control", real_time=True) as service,
    ):
        stopping = threading.Event()
        thread = threading.Thread(target=service.run, args=(stopping.is_set,))
        thread.start()
        try:
            frames = read_with_python_can(bench.rig.sensor.port)
        finally:
            stopping.set()
            thread.join()
    heads = [frame for frame in frames if frame.data[0] == 0x40]
    tails = [frame for frame in frames if frame.data[0] == 0xC0]

    assert len(frames) == 20
    assert {frame.arbitration_id for frame in frames} == {0x4E0}
    assert {frame.dlc for frame in frames} == {8}
    assert len(heads) == len(tails) == 10
    assert all(abs(value - 240) < 15 for frame in heads for value in frame.data[1:])


def read_with_python_can(port):
    """Starts the board as its manual says, and reads 20 frames."""
    start = [[0x4D, 1, 20, 240], [0x50, 0, 0, 0, 1, 0, 0x22], [0x07, 0]]
    with can.Bus(interface="slcan", channel=port, bitrate=1_000_000, sleep_after_open=0) as bus:
        for data in start:
            bus.send(can.Message(arbitration_id=0x20E, data=data, is_extended_id=False))
        frames = [bus.recv(timeout=2.0) for _ in range(20)]
        bus.send(can.Message(arbitration_id=0x20E, data=[0x07, 1], is_extended_id=False))
    return frames
