"""The emulated fingertip: contact, lag, noise, and taps like the simulator's."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from solidtouch.hardware.emulator.finger import Finger, Pad
from solidtouch.hardware.simulator.physics import taxel_indentation_mm
from solidtouch.hardware.simulator.rig import SimulatedRig
from solidtouch.hardware.simulator.settings import PRESETS
from solidtouch.hardware.simulator.signal_chain import FULL_SCALE, SignalChain, session_nuisances
from solidtouch.models.errors import InputError

PAPER = PRESETS["paper"]
SURFACE_MM, FULL_MM = 1.0, 1.0 + PAPER.depth_mm


def held(settings, x_mm, y_mm, what=1, readings=40, **options):
    """Readings of a finger that is held somewhere, shape (readings, K)."""
    finger = Finger(settings, lambda _: (x_mm, y_mm), 0, 0, what, SURFACE_MM, **options)
    return np.array([finger.read(t / settings.rate_hz) for t in range(readings)])


@given(st.floats(-3, 20), st.floats(0, 3), st.integers(0, 4))
def test_contact_is_that_of_the_simulator(position_mm, depth_mm, what):
    """One reading's indentation equals that of `physics.py`."""
    pad = Pad(PAPER)
    expected = taxel_indentation_mm(
        PAPER, np.array([position_mm]), PAPER.rods[what].diameter_mm, np.array([[depth_mm]])
    )

    np.testing.assert_allclose(pad.indentation_mm(pad.gap_mm(position_mm, what), depth_mm), expected[0, 0], atol=1e-12)


def test_readings_are_those_of_the_signal_chain(exact):
    """Without noise a press reads what the simulator's chain makes of the same indentation."""
    y_mm = SURFACE_MM + exact.depth_mm * np.sin(np.linspace(0, np.pi, 60))
    finger = Finger(exact, lambda t: (8.0, y_mm[round(t * exact.rate_hz)]), 0, 0, 2, SURFACE_MM)
    counts = [finger.read(t / exact.rate_hz) for t in range(60)]

    depth_mm = np.maximum(y_mm - SURFACE_MM, 0.0)
    seen = taxel_indentation_mm(exact, np.array([8.0]), exact.rods[2].diameter_mm, depth_mm[np.newaxis])[0]
    chain = SignalChain(exact, session_nuisances(exact, 0, 0), np.random.SeedSequence(0))
    np.testing.assert_allclose(counts, chain.read(seen), atol=1)


@pytest.mark.parametrize(("y_mm", "what"), [(0.0, 1), (0.9, 1), (FULL_MM, None)])
def test_without_contact_the_finger_reads_idle(y_mm, what):
    """Away from the rod, or with nothing there, all taxels stay near their idle readings."""
    idle = FULL_SCALE - session_nuisances(PAPER, 0, 0).rail_counts

    assert np.abs(held(PAPER, 8.0, y_mm, what) - np.maximum(idle, 0)).max() < 10


def test_deeper_presses_read_more(exact):
    """The sum over taxels rises with depth."""
    sums = [held(exact, 8.0, y_mm)[-1].sum() for y_mm in (0.5, 1.2, 1.6, 2.0, 2.5, 3.0)]

    assert (np.diff(sums) > 0).all()


def test_contact_at_the_ends_is_weaker(exact):
    """A full press away from the best position indents less, as the simulator's does."""
    assert held(exact, 1.0, FULL_MM)[-1].max() < 0.5 * held(exact, 8.0, FULL_MM)[-1].max()


def test_rods_and_places_differ(exact):
    """Every rod at every place has its own pattern."""
    patterns = [tuple(held(exact, x_mm, FULL_MM, what)[-1]) for x_mm in (6.0, 8.0, 10.0) for what in range(5)]

    assert len(set(patterns)) == 15


@pytest.mark.parametrize("name", PRESETS)
def test_readings_are_whole_counts_of_eight_bits(name):
    """Whatever the preset and the load, readings are whole numbers from 0 to 255."""
    counts = held(PRESETS[name], 8.0, 50.0, readings=300)

    assert (counts == np.rint(counts)).all()
    assert counts.min() >= 0
    assert counts.max() == FULL_SCALE


def test_readings_repeat_with_their_seed():
    """The same seed and session read the same, others do not."""

    def read(seed, session):
        finger = Finger(PAPER, lambda _: (8.0, 2.0), seed, session, 1)
        return [finger.read(t / 50).tolist() for t in range(30)]

    assert read(3, 1) == read(3, 1)
    assert read(3, 1) != read(4, 1)
    assert read(3, 1) != read(3, 2)


def test_sample_and_hold_repeats_readings():
    """With `hold_samples` two readings in a row are one."""
    counts = held(PRESETS["hold2"], 8.0, 2.0)

    assert (counts[::2] == counts[1::2]).all()
    assert (counts[2::2] != counts[:-2:2]).any(axis=1).all()


def test_lag_goes_on_with_time_and_not_with_readings(exact):
    """After a long pause the foam has forgotten the last press."""
    y_mm = iter([3.0] * 20 + [0.0])
    finger = Finger(exact, lambda _: (8.0, next(y_mm)), 0, 0, 1)
    for t in range(20):
        finger.read(t / 50)

    np.testing.assert_array_equal(finger.read(60.0), held(exact, 8.0, 0.0)[0])


def test_each_press_goes_a_little_elsewhere():
    """Presses differ from one to the next, not within one."""
    settings = replace(PRESETS["ideal"], white_counts=0.0, tap_position_mm=0.5, lag_s=0.0)
    finger = Finger(settings, lambda t: (6.0, FULL_MM if t % 1 < 0.5 else 0.0), 0, 0, 1)
    presses = [[tuple(finger.read(tap + t / 50)) for t in range(50)][:25] for tap in range(6)]

    assert all(len(set(press)) == 1 for press in presses)
    assert len({press[0] for press in presses}) == 6


@pytest.mark.parametrize("what", [-1, 5])
def test_unknown_rods_are_refused(what):
    """There are only the rods of the settings."""
    with pytest.raises(InputError, match=f"Unknown object {what}; choose 0 to 4"):
        held(PAPER, 0.0, 0.0, what)


@pytest.mark.parametrize("position_mm", [4.0, 8.0, 11.0])
def test_taps_resemble_those_of_the_simulated_rig(position_mm):
    """Pressed like the simulator's finger, the peaks of its taps are alike."""
    settings = replace(PRESETS["nodrift"], highpass_hz=0.0)
    rig = SimulatedRig(settings, 1, 0, position_mm, 3)
    expected = np.mean([np.ptp(rig.tap(), axis=0) for _ in range(20)], axis=0)

    def place(time_s):
        phase = (time_s % 1.0 - settings.contact_start_s) / settings.contact_duration_s
        return position_mm, SURFACE_MM + settings.depth_mm * np.sin(np.pi * phase) * (0 < phase < 1)

    finger = Finger(settings, place, 1, 0, 3)
    counts = np.array([finger.read(t / 50) for t in range(1000)]).reshape(20, 50, -1)
    peaks = np.mean(np.ptp(counts, axis=1), axis=0)

    strong = expected > 30
    np.testing.assert_allclose(peaks[strong], expected[strong], rtol=0.35)
    assert np.abs(peaks - expected)[~strong].max(initial=0) < 15
    assert np.corrcoef(peaks, expected)[0, 1] > 0.95
