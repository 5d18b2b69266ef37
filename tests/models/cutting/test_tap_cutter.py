"""Taps of a stream with everything on: taxels, another rate, tare, high-pass and triggers."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solidtouch.models.cutting.resampling import Resampler
from solidtouch.models.cutting.tap_cutter import TapCutter
from solidtouch.models.errors import InputError
from solidtouch.models.preprocessing import Preprocessing

RATES = [None, 40.0, 100.0, 30.0, 400.0 / 3]
RECORDS = st.builds(
    lambda samples, sensor, tare, highpass, trigger, pre, taxels: Preprocessing(
        samples=samples,
        rate_hz=40.0,
        tare=tare,
        tare_samples=0 if tare == "none" else min(samples, 3),
        highpass_hz=highpass,
        trigger=trigger,
        trigger_level=1.0 if trigger == "contact" else 0.0,
        pre_samples=0 if trigger == "clock" else min(pre, samples - 1),
        sensor_hz=sensor,
        taxels=taxels,
    ),
    st.integers(1, 8),
    st.sampled_from(RATES),
    st.sampled_from(["none", "stream", "tap"]),
    st.sampled_from([0.0, 0.5]),
    st.sampled_from(["clock", "contact", "press"]),
    st.integers(0, 4),
    st.sampled_from([None, (0, 2), (1,)]),
)


def cut(record, stream, presses=(), cuts=()):
    """The taps of a stream, pressed before some frames and pushed in pieces, and what was lost."""
    cutter, taps, at = TapCutter(record), [], 0
    for stop in sorted({*presses, *cuts, len(stream)}):
        taps += cutter.push(stream[at:stop])
        at = stop
        if stop in presses:
            cutter.press()
    cutter.finish()
    return taps, cutter.incomplete, cutter.overlapping


def waves(frames, seed):
    """Frames of three taxels that rise and fall slowly."""
    noise = np.random.default_rng(seed).normal(size=(frames, 3))
    return noise.cumsum(axis=0) / 2 + 100 * noise[:1]


@given(record=RECORDS, frames=st.integers(1, 250), seed=st.integers(0, 99), data=st.data())
@settings(max_examples=150, deadline=None)
def test_frame_by_frame_gives_the_bits_of_the_whole_stream(record, frames, seed, data):
    stream = waves(frames, seed)
    places = st.sets(st.integers(0, frames), max_size=6)
    presses = data.draw(places) if record.trigger == "press" else ()
    at_once, *lost = cut(record, stream, presses)

    for cuts in (range(frames), data.draw(places)):
        pieces, *lost_in_pieces = cut(record, stream, presses, cuts)
        assert [(tap.start, tap.frame) for tap in pieces] == [(tap.start, tap.frame) for tap in at_once]
        assert lost_in_pieces == lost
        for one, other in zip(at_once, pieces, strict=True):
            np.testing.assert_array_equal(one.samples, other.samples)


@given(record=RECORDS, frames=st.integers(1, 250), seed=st.integers(0, 99), data=st.data())
@settings(max_examples=200, deadline=None)
def test_taxels_and_rate_are_changed_before_all_else(record, frames, seed, data):
    """As if the sensor had the chosen taxels and the rate of the record."""
    stream = waves(frames, seed)
    presses = data.draw(st.sets(st.integers(0, frames), max_size=6)) if record.trigger == "press" else set()
    plain = replace(record, sensor_hz=None, taxels=None)
    chosen = stream if record.taxels is None else stream[:, record.taxels]
    ratio, resampled = 1, chosen
    if record.sensor_hz is not None:
        resampler = Resampler(record.sensor_hz, 40.0)
        ratio, resampled = resampler.ratio, resampler(chosen)
    later = [math.ceil(press * ratio) for press in sorted(presses)]
    expected = (
        [] if len(set(later)) < len(later) else cut(plain, resampled, [p for p in later if p <= len(resampled)])[0]
    )
    taps, *_ = cut(record, stream, presses)

    if not later or len(set(later)) == len(later):
        assert [tap.start for tap in taps] == [tap.start for tap in expected]
        for one, other in zip(taps, expected, strict=True):
            np.testing.assert_array_equal(one.samples, other.samples)
    for tap in taps:
        if record.trigger == "press":
            assert tap.frame in presses
            assert tap.start + record.pre_samples == math.ceil(tap.frame * ratio)
        else:
            assert tap.frame == (tap.start + record.pre_samples) // ratio


def test_a_press_waits_for_the_frames_behind_its_last_sample():
    """And the next press does not take a finished tap away, even if it is not out yet."""
    record = Preprocessing(samples=4, rate_hz=10.0, sensor_hz=20.0, trigger="press", pre_samples=1)
    cutter = TapCutter(record)
    assert cutter.push(np.zeros((9, 1))) == []
    cutter.press()  # at sample 5, so the tap is 4 to 7
    assert cutter.push(np.ones((7, 1))) == []
    cutter.press()  # at sample 8
    taps = [tap for _ in range(19) for tap in cutter.push(np.ones((1, 1)))]
    late = [tap for _ in range(6) for tap in cutter.push(np.ones((1, 1)))]

    assert [(tap.start, tap.frame) for tap in taps] == [(4, 9)]
    assert [(tap.start, tap.frame) for tap in late] == [(7, 16)]
    assert cutter.incomplete == 0


def test_a_press_in_a_tap_gives_it_up_and_is_counted():
    record = Preprocessing(samples=4, rate_hz=10.0, sensor_hz=20.0, trigger="press", pre_samples=1)
    taps, incomplete, overlapping = cut(record, np.zeros((99, 1)), [9, 14, 97])

    assert [tap.frame for tap in taps] == [14]
    assert (incomplete, overlapping) == (2, 1)


def test_a_taxel_that_is_left_out_is_not_looked_at():
    """Neither for contact nor for whether its values are numbers."""
    record = Preprocessing(samples=2, trigger="contact", trigger_level=5.0, taxels=(0, 2))
    stream = np.zeros((12, 3))
    stream[3, 1], stream[5, 1], stream[8, 2] = 9.0, np.nan, 9.0
    taps, *_ = cut(record, stream)

    assert [tap.samples.tolist() for tap in taps] == [[[0, 9], [0, 0]]]


def test_frames_that_lack_a_taxel_are_refused():
    with pytest.raises(InputError, match="Frames have 3 taxels, but taxel 3 is used"):
        TapCutter(Preprocessing(samples=2, trigger="clock", taxels=(0, 3))).push(np.zeros((2, 3)))


@pytest.mark.parametrize("trigger", ["clock", "contact", "press"])
def test_memory_is_bounded_at_another_rate(trigger):
    record = Preprocessing(
        samples=5, rate_hz=50.0, sensor_hz=1000.0, trigger=trigger, trigger_level=float(trigger == "contact")
    )
    cutter = TapCutter(record)
    for _ in range(200):
        cutter.push(np.zeros((40, 3)))
        if trigger == "press":
            cutter.press()

        assert len(cutter._kept) + len(cutter._begun) <= 25
        assert len(cutter._resampler._kept) <= 2 * 200 + 40
