"""Presses by a recorded signal and by events."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from solidtouch.models.cutting.presses import presses_of_column, presses_of_events
from solidtouch.models.errors import InputError

SIGNALS = {
    "truth": [False, True, True, False, True],
    "numbers": [0, 1, 1, 0, 1],
    "range": [-4.0, 6.0, 5.0, -2.0, 1.1],
    "text": ["false", "true", "TRUE", "False", "True"],
    "words": ["no", " yes", "yes", "", "Yes "],
    "numbers as text": ["0", "1", "1.0", "0", "1"],
    "unknown is low": [0, 1, 1, np.nan, 1],
}


@pytest.mark.parametrize("kind", SIGNALS)
def test_a_press_begins_where_the_signal_rises_above_half_of_its_range(kind):
    found = presses_of_column(SIGNALS[kind])

    assert found.row.tolist() == [1, 4]
    assert found.outside == 0


@pytest.mark.parametrize(("between", "rows"), [(0.6, [1]), (0.5, [1]), (0.3, [1]), (0.25, [1, 3]), (0.0, [1, 3])])
def test_noise_about_half_begins_no_second_press(between, rows):
    """The signal has to fall to a quarter of its range before."""
    assert presses_of_column([0.0, 1.0, between, 0.9, 0.8]).row.tolist() == rows


def test_exactly_half_is_not_above():
    assert presses_of_column([0.0, 1.0, 2.0]).row.tolist() == [2]


def test_a_stream_that_begins_pressed_has_no_press_there():
    """Whatever the stream before it ended with."""
    signal = [1, 1, 0, 1, 1, 0, 0, 1, 0]

    assert presses_of_column(signal).row.tolist() == [3, 7]
    found = presses_of_column(signal, [0, 3, 4, 6, 7])
    assert found.row.tolist() == []
    assert found.outside == 4


@given(st.lists(st.integers(0, 8), min_size=2, max_size=40), st.sets(st.integers(1, 39)))
def test_presses_are_those_of_a_walk_over_the_frames(values, starts):
    starts = sorted({0, *(start for start in starts if start < len(values))})
    low, high = min(values), max(values)
    if low == high:
        return
    rows, outside, armed = [], 0, True
    for row, value in enumerate(values):
        part = (value - low) / (high - low)
        if row in starts:
            armed = part <= 0.5
            outside += not armed
        elif armed and part > 0.5:
            rows.append(row)
            armed = False
        elif part <= 0.25:
            armed = True

    found = presses_of_column(values, starts)
    assert found.row.tolist() == rows
    assert found.outside == outside


@pytest.mark.parametrize(
    ("signal", "message"),
    [
        ([1, 1, 1], "button: always 1, so no press begins"),
        ([np.nan, np.nan], "button: always 0, so no press begins"),
        (["up", "down"], "button: must hold numbers or true and false, got 'down'"),
        ([[0, 1]], "button: must have one value for each frame"),
        ([], "button: must have one value for each frame"),
    ],
)
def test_signals_without_presses_are_refused(signal, message):
    with pytest.raises(InputError, match=message):
        presses_of_column(signal, name="button")


CLOCK = np.array([10.0, 11, 12, 13, 30, 31, 32])  # a pause behind the fourth frame
ONE = np.zeros(7, dtype=int)


def test_an_event_is_at_the_first_frame_that_is_not_before_it():
    found = presses_of_events([31.5, 9.5, 12.0, 12.1], ONE, time=CLOCK)

    assert found.row.tolist() == [0, 2, 3, 6]
    assert found.outside == 0


@pytest.mark.parametrize("at", [8.9, 13.1, 20.0, 32.1, -1e9, 1e9])
def test_events_before_after_and_between_streams_are_outside(at):
    found = presses_of_events([11.0, at], ONE, time=CLOCK)

    assert found.row.tolist() == [1]
    assert found.outside == 1


def test_events_by_number_count_in_their_file():
    found = presses_of_events([2, 0, 3, -1, 2], [0, 0, 0, 4, 4, 4, 4], of=[0, 4, 4, 0, 9])

    assert found.row.tolist() == [2, 3, 6]
    assert found.outside == 2


def test_events_by_time_find_their_file_where_clocks_do_not_overlap():
    file = [0, 0, 0, 0, 1, 1, 1]

    assert presses_of_events([31.0, 11.0], file, time=CLOCK).row.tolist() == [1, 5]


@pytest.mark.parametrize(
    ("events", "file", "time", "message"),
    [
        ([1.5], ONE, None, "numbers of frames must be whole; those in seconds need the time of each frame"),
        ([np.nan], ONE, None, "a list of finite numbers"),
        ([[1.0]], ONE, CLOCK, "a list of finite numbers"),
        ([1.0], [0, 0, 1], None, "2 files; each event needs the file"),
        ([1.0], [0, 0, 1], [0.0, 1.0, 0.5], "2 files; each event needs the file"),
        ([1.0], [0, 1, 0], [0.0, 1.0, 2.0], "2 files; each event needs the file"),
        ([1.0], [0, 0, 0], [0.0, 1.0, 0.5], "times of frames must increase"),
    ],
)
def test_events_that_cannot_be_placed_are_refused(events, file, time, message):
    with pytest.raises(InputError, match=message):
        presses_of_events(events, file, time=time)


def test_times_of_events_may_be_rounded_otherwise_than_those_of_frames():
    """As where 70 * 0.01 is not 0.7."""
    clock = np.round(np.arange(100) / 100, 2)
    at = np.arange(100) * 0.01
    assert (at != clock).any()
    found = presses_of_events(at, np.zeros(100), time=clock)
    assert found.row.tolist() == list(range(100))
    assert presses_of_events([0.7001], np.zeros(100), time=clock).row.tolist() == [71]
