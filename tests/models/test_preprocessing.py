"""One preparation of samples, off line and live."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from solidtouch.models.cutting.tap_cutter import TapCutter
from solidtouch.models.errors import InputError
from solidtouch.models.preprocessing import Preprocessing

BAD = {
    "no samples": ({"samples": 0}, "samples must be an integer of at least 1, got 0"),
    "samples in words": ({"samples": "four"}, "samples must be an integer of at least 1, got 'four'"),
    "rate 0": ({"samples": 4, "rate_hz": 0.0}, "rate_hz must be positive, got 0.0"),
    "rate nan": ({"samples": 4, "rate_hz": np.nan}, "rate_hz must be finite"),
    "rate inf": ({"samples": 4, "rate_hz": np.inf}, "rate_hz must be finite"),
    "tare kind": ({"samples": 4, "tare": "each"}, "tare must be none, stream or tap, got 'each'"),
    "tare without samples": ({"samples": 4, "tare": "tap"}, "tare='tap' does not match tare_samples=0"),
    "samples without tare": ({"samples": 4, "tare_samples": 2}, "does not match tare_samples=2"),
    "tare negative": (
        {"samples": 4, "tare": "tap", "tare_samples": -2},
        "tare_samples must be an integer of at least 0, got -2",
    ),
    "tare too long": ({"samples": 4, "tare": "tap", "tare_samples": 5}, "tare_samples=5 exceeds samples=4"),
    "highpass negative": ({"samples": 4, "highpass_hz": -1.0}, "must not be negative"),
    "highpass nan": ({"samples": 4, "highpass_hz": np.nan}, "highpass_hz must be finite"),
    "highpass without rate": ({"samples": 4, "highpass_hz": 1.0}, "needs a sampling rate above 2.0 Hz"),
    "highpass too high": ({"samples": 4, "highpass_hz": 5.0, "rate_hz": 10.0}, "needs a sampling rate above 10.0 Hz"),
    "trigger kind": ({"samples": 4, "trigger": "touch"}, "trigger must be none, clock, contact or press"),
    "contact without level": ({"samples": 4, "trigger": "contact"}, "does not match trigger_level=0.0"),
    "level without contact": (
        {"samples": 4, "trigger": "clock", "trigger_level": 1.0},
        "does not match trigger_level",
    ),
    "level nan": ({"samples": 4, "trigger": "contact", "trigger_level": np.nan}, "trigger_level must be finite"),
    "pre without contact": ({"samples": 4, "trigger": "clock", "pre_samples": 1}, "needs a contact or press trigger"),
    "level with press": ({"samples": 4, "trigger": "press", "trigger_level": 1.0}, "does not match trigger_level"),
    "pre of a press too long": ({"samples": 4, "trigger": "press", "pre_samples": 4}, "smaller than samples=4"),
    "pre too long": (
        {"samples": 4, "trigger": "contact", "trigger_level": 1.0, "pre_samples": 4},
        "must be smaller than samples=4",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_contradicting_fields_are_refused(case):
    fields, message = BAD[case]
    with pytest.raises(InputError, match=message):
        Preprocessing(**fields)


@pytest.mark.parametrize("text", ["", "5", "null", "[]", "{", '{"j": 4}', "{}"])
def test_other_text_is_no_record(text):
    with pytest.raises(InputError, match="Not a preprocessing record"):
        Preprocessing.from_json(text)


RECORDS = st.builds(
    lambda samples, tare, highpass, contact, level, pre: Preprocessing(
        samples=samples,
        rate_hz=40.0,
        tare=tare,
        tare_samples=0 if tare == "none" else min(samples, 3),
        highpass_hz=highpass,
        trigger="contact" if contact else "clock",
        trigger_level=level if contact else 0.0,
        pre_samples=min(pre, samples - 1) if contact else 0,
    ),
    st.integers(1, 6),
    st.sampled_from(["none", "stream", "tap"]),
    st.sampled_from([0.0, 0.5, 12.0]),
    st.booleans(),
    st.sampled_from([-2.0, 1.0, 3.0]),
    st.integers(0, 4),
)
STREAMS = hnp.arrays(np.float64, st.tuples(st.integers(1, 60), st.integers(1, 3)), elements=st.integers(-5, 5))


@given(record=RECORDS)
def test_a_record_survives_its_text(record):
    assert Preprocessing.from_json(record.to_json()) == record
    assert not record.differences(record)


@given(record=RECORDS, stream=STREAMS, cuts=st.lists(st.integers(0, 60), max_size=12))
@settings(max_examples=150, deadline=None)
def test_any_split_of_a_stream_gives_the_same_taps(record, stream, cuts):
    """Frames may arrive one by one, in any pieces, or all at once."""
    whole, pieces = TapCutter(record), TapCutter(record)
    at_once = whole.push(stream)
    piecewise = [
        tap for part in np.split(stream, sorted(min(c, len(stream)) for c in cuts)) for tap in pieces.push(part)
    ]
    whole.finish()
    pieces.finish()

    assert [tap.start for tap in piecewise] == [tap.start for tap in at_once]
    assert whole.incomplete == pieces.incomplete
    for one, other in zip(at_once, piecewise, strict=True):
        np.testing.assert_array_equal(one.samples, other.samples)
        assert one.samples.shape == (record.samples, stream.shape[1])


def naive_contacts(stream, record):
    """Start frames, by a walk over the frames as the docstring of `Preprocessing` reads."""
    starts, armed, frame, lost = [], True, 0, 0
    while frame < len(stream):
        load = (stream[frame] / record.trigger_level).max()
        if armed and load >= 1:
            armed = False
            begin = frame - record.pre_samples
            if begin < 0:
                lost += 1
            elif begin + record.samples > len(stream):
                lost += 1
                break
            else:
                starts.append(begin)
                frame = begin + record.samples - 1
                armed = (stream[frame] / record.trigger_level).max() < 0.5
        elif load < 0.5:
            armed = True
        frame += 1
    return starts, lost


@given(stream=STREAMS, level=st.sampled_from([-3.0, 2.0]), samples=st.integers(1, 6), pre=st.integers(0, 5))
@settings(max_examples=200, deadline=None)
def test_contacts_are_those_of_a_walk_over_the_frames(stream, level, samples, pre):
    record = Preprocessing(samples=samples, trigger="contact", trigger_level=level, pre_samples=min(pre, samples - 1))
    cutter = TapCutter(record)
    taps = cutter.push(stream)
    cutter.finish()

    assert ([tap.start for tap in taps], cutter.incomplete) == naive_contacts(stream, record)
    for tap in taps:
        np.testing.assert_array_equal(tap.samples, stream[tap.start : tap.start + samples])


@given(stream=STREAMS, offset=st.integers(-100, 100))
def test_a_tare_removes_a_constant_offset(stream, offset):
    for tare in ("stream", "tap"):
        record = Preprocessing(samples=4, tare=tare, tare_samples=2, trigger="clock")
        plain, shifted = (TapCutter(record).push(frames) for frames in (stream, stream + offset))

        for one, other in zip(plain, shifted, strict=True):
            np.testing.assert_allclose(one.samples, other.samples, atol=1e-9)


def test_a_highpass_starts_in_its_steady_state():
    """A constant stream is 0 from its first frame, a step decays."""
    record = Preprocessing(samples=50, rate_hz=50.0, highpass_hz=1.0, trigger="clock")
    stream = np.full((100, 2), 7.0)
    stream[50:, 1] += 1.0

    first, second = TapCutter(record).push(stream)

    np.testing.assert_allclose(first.samples, 0.0, atol=1e-9)
    np.testing.assert_allclose(second.samples[:, 0], 0.0, atol=1e-9)
    assert second.samples[0, 1] > 0.9
    assert abs(second.samples[-1, 1]) < 0.01


def test_a_record_without_trigger_cuts_nothing():
    with pytest.raises(InputError, match="clock, contact or press trigger"):
        TapCutter(Preprocessing(samples=4))


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        (np.zeros(3), r"shape \(n, K\) .*got \(3,\)"),
        (np.zeros((3, 5)), "Frames have 5 taxels, earlier ones 2"),
        (np.array([[0.0, 0.0], [0.0, np.nan]]), "Frame 1 has a NaN"),
        (np.array([[0.0, -np.inf]]), "Frame 0 has a NaN"),
        (np.zeros((3, 0)), "at least one taxel"),
    ],
)
def test_frames_that_do_not_follow_are_refused(frames, message):
    cutter = TapCutter(Preprocessing(samples=4, trigger="clock"))
    cutter.push(np.zeros((1, 2)))

    with pytest.raises(InputError, match=message):
        cutter.push(frames)


def test_frames_without_taxels_are_refused_from_the_start():
    with pytest.raises(InputError, match="at least one taxel"):
        TapCutter(Preprocessing(samples=4, trigger="clock")).push(np.zeros((3, 0)))


def test_memory_stays_bounded_on_a_long_stream():
    """Between taps at most a tap and the frames before it are kept."""
    record = Preprocessing(samples=5, trigger="contact", trigger_level=2.0, pre_samples=2)
    cutter = TapCutter(record)
    for _ in range(50):
        cutter.push(np.zeros((100, 3)))

        assert len(cutter._kept) <= record.samples


def test_differences_name_the_field_and_both_values():
    here, there = Preprocessing(samples=4), Preprocessing(samples=4, rate_hz=50.0)

    assert here.differences(there) == ["rate_hz is None here and 50.0 there"]


@pytest.mark.parametrize(("between", "starts"), [(1.99, [1, 4]), (2.0, [1]), (2.01, [1])])
def test_the_next_contact_needs_a_fall_below_half_the_level(between, starts):
    """At half the level the trigger is not armed yet."""
    cutter = TapCutter(Preprocessing(samples=2, trigger="contact", trigger_level=4.0))
    taps = cutter.push(np.array([[0.0], [4.0], [4.0], [between], [4.0], [4.0]]))

    assert [tap.start for tap in taps] == starts


@pytest.mark.parametrize(("last", "starts"), [(1.99, [1, 3]), (2.0, [1]), (3.99, [1])])
def test_a_tap_that_ends_above_half_the_level_does_not_arm_the_trigger(last, starts):
    """Its last sample counts like any frame behind it."""
    cutter = TapCutter(Preprocessing(samples=2, trigger="contact", trigger_level=4.0))
    taps = cutter.push(np.array([[0.0], [4.0], [last], [4.0], [4.0]]))

    assert [tap.start for tap in taps] == starts


PRESSES = st.builds(
    lambda samples, tare, highpass, pre: Preprocessing(
        samples=samples,
        rate_hz=40.0,
        tare=tare,
        tare_samples=0 if tare == "none" else min(samples, 3),
        highpass_hz=highpass,
        trigger="press",
        pre_samples=min(pre, samples - 1),
    ),
    st.integers(1, 6),
    st.sampled_from(["none", "stream", "tap"]),
    st.sampled_from([0.0, 0.5, 12.0]),
    st.integers(0, 4),
)


def pressed(record, stream, presses, cuts=()):
    """The taps of a stream, pressed before some frames and pushed in pieces."""
    cutter, taps, at = TapCutter(record), [], 0
    for stop in sorted({*presses, *cuts, len(stream)}):
        taps += cutter.push(stream[at:stop])
        at = stop
        if stop in presses:
            cutter.press()
    cutter.finish()
    return taps, cutter.incomplete


@given(record=PRESSES, stream=STREAMS, data=st.data())
@settings(max_examples=150, deadline=None)
def test_any_split_of_a_pressed_stream_gives_the_same_taps(record, stream, data):
    """Frames may arrive one by one, in any pieces, or all at once between two presses."""
    places = st.sets(st.integers(0, len(stream)), max_size=6)
    presses = data.draw(places)
    at_once, lost = pressed(record, stream, presses)
    pieces, lost_in_pieces = pressed(record, stream, presses, data.draw(places))

    assert [tap.start for tap in pieces] == [tap.start for tap in at_once]
    assert lost == lost_in_pieces
    for one, other in zip(at_once, pieces, strict=True):
        np.testing.assert_array_equal(one.samples, other.samples)


def naive_presses(record, frames, presses):
    """Start frames and the number of taps lost, press by press as the docstring of `press` reads."""
    first = record.tare_samples if record.tare == "stream" else 0
    starts, lost = [], 0
    for press, following in pairwise([*presses, frames]):
        begin = press - record.pre_samples
        if begin < 0 or press < first or begin + record.samples > following:
            lost += 1
        else:
            starts.append(begin)
    return starts, lost


@given(record=PRESSES, stream=STREAMS, data=st.data())
@settings(max_examples=150, deadline=None)
def test_a_press_starts_the_tap_that_holds_the_frames_before_it(record, stream, data):
    """Presses before there are enough frames, or less than a tap before the next press or the end, give no tap."""
    presses = sorted(data.draw(st.sets(st.integers(0, len(stream)), max_size=6)))
    taps, lost = pressed(record, stream, presses)

    assert ([tap.start for tap in taps], lost) == naive_presses(record, len(stream), presses)
    if record.tare == "none" and not record.highpass_hz:
        for tap in taps:
            np.testing.assert_array_equal(tap.samples, stream[tap.start : tap.start + record.samples])


def test_without_a_press_there_is_no_tap():
    taps, lost = pressed(Preprocessing(samples=2, trigger="press"), np.ones((9, 2)), [])

    assert (taps, lost) == ([], 0)


def test_a_second_press_gives_up_the_tap_in_progress():
    stream = np.arange(12.0)[:, np.newaxis]
    taps, lost = pressed(Preprocessing(samples=4, trigger="press", pre_samples=1), stream, [3, 5])

    assert [tap.samples[:, 0].tolist() for tap in taps] == [[4.0, 5.0, 6.0, 7.0]]
    assert lost == 1


@pytest.mark.parametrize("highpass_hz", [0.5, 12.0])
def test_the_highpass_runs_on_between_presses(highpass_hz):
    """A pressed tap is the window of the same stream filtered as a whole."""
    stream = np.random.default_rng(1).normal(size=(60, 3)).cumsum(axis=0)
    record = Preprocessing(samples=5, rate_hz=40.0, highpass_hz=highpass_hz, trigger="press", pre_samples=2)
    whole = Preprocessing(samples=60, rate_hz=40.0, highpass_hz=highpass_hz, trigger="clock")
    (filtered,) = TapCutter(whole).push(stream)
    taps, _ = pressed(record, stream, [10, 31, 50])

    assert [tap.start for tap in taps] == [8, 29, 48]
    for tap in taps:
        np.testing.assert_allclose(tap.samples, filtered.samples[tap.start : tap.start + 5], atol=1e-9)


@pytest.mark.parametrize("trigger", ["clock", "contact"])
def test_a_press_means_nothing_to_another_trigger(trigger):
    cutter = TapCutter(Preprocessing(samples=2, trigger=trigger, trigger_level=float(trigger == "contact")))

    with pytest.raises(InputError, match=f"needs trigger='press', not '{trigger}'"):
        cutter.press()


def test_a_stream_that_is_pressed_is_kept_no_longer_than_needed():
    """However long nothing is pressed, only the frames that a press would take back are kept."""
    cutter = TapCutter(Preprocessing(samples=6, trigger="press", pre_samples=2))
    for _ in range(50):
        cutter.push(np.zeros((100, 3)))

        assert len(cutter._kept) <= 2


@pytest.mark.parametrize(
    "text",
    ["[" * 100_000, f'{{"samples": {"9" * 5_000}}}', f'{{"samples": 3, "rate_hz": 1, "highpass_hz": {"9" * 400}}}'],
)
def test_a_record_that_would_exhaust_a_parser_is_none(text):
    with pytest.raises(InputError) as caught:
        Preprocessing.from_json(text)
    assert len(str(caught.value)) < 1200


NEWER = {
    "sensor rate 0": ({"sensor_hz": 0.0, "rate_hz": 1.0}, "sensor_hz must be positive, got 0.0"),
    "sensor rate nan": ({"sensor_hz": np.nan, "rate_hz": 1.0}, "sensor_hz must be finite"),
    "sensor rate alone": ({"sensor_hz": 100.0}, "sensor_hz needs rate_hz"),
    "odd ratio": ({"sensor_hz": 99.98, "rate_hz": 50.0}, "Cannot resample from 99.98 Hz to 50 Hz"),
    "one taxel": ({"taxels": 3}, "taxels must be a list of numbers of taxels, got 3"),
    "taxels in words": ({"taxels": "12"}, "taxels must be a list of numbers of taxels, got '12'"),
    "no taxel": ({"taxels": ()}, "taxels must be at least one"),
    "taxel twice": ({"taxels": (1, 1)}, r"in increasing order, got \(1, 1\)"),
    "taxels in another order": ({"taxels": (2, 1)}, r"in increasing order, got \(2, 1\)"),
    "negative taxel": ({"taxels": (-1, 1)}, "taxels must be an integer of at least 0, got -1"),
    "half a taxel": ({"taxels": (0.5, 1)}, "taxels must be an integer of at least 0, got 0.5"),
}


@pytest.mark.parametrize("case", NEWER)
def test_rates_and_taxels_that_cannot_be_are_refused(case):
    fields, message = NEWER[case]
    with pytest.raises(InputError, match=message):
        Preprocessing(samples=4, **fields)


def test_a_record_of_before_is_read_and_written_unchanged():
    """Files without resampling and with all taxels keep their text."""
    before = (
        '{"samples": 50, "rate_hz": 50.0, "tare": "none", "tare_samples": 0, "highpass_hz": 0.1, "trigger": "clock", '
        '"trigger_level": 0.0, "pre_samples": 0}'
    )

    assert Preprocessing.from_json(before).to_json() == before
    assert Preprocessing.from_json(before) == Preprocessing(50, 50.0, highpass_hz=0.1, trigger="clock")


def test_a_record_with_another_rate_and_some_taxels_survives_its_text():
    record = Preprocessing(samples=4, rate_hz=50.0, sensor_hz=1000.0, taxels=(0, 3))

    assert Preprocessing.from_json(record.to_json()) == record
    assert hash(record)
    other = Preprocessing(samples=4, rate_hz=50.0)
    assert record.differences(other) == ["taxels is (0, 3) here and None there"]  # the sensor may have any rate


def test_a_sensor_of_the_same_rate_needs_no_resampling():
    assert Preprocessing(samples=4, rate_hz=50.0, sensor_hz=50.0) == Preprocessing(samples=4, rate_hz=50.0)
