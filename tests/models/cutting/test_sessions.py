"""Numbers of sessions by pauses and dates, and gaps in streams."""

import numpy as np
import pytest
from solidtouch.models.cutting.sessions import breaks, median_step, number_by_date, number_by_gap
from solidtouch.models.errors import InputError


def test_a_pause_longer_than_told_or_a_step_back_begins_a_session():
    assert number_by_gap([0.0, 1.0, 6.0, 11.1, 12.0, 3.0], 5.0).tolist() == [0, 0, 0, 1, 1, 2]


def test_a_file_begins_a_session_only_if_files_are_told():
    time, file = [0.0, 1.0, 2.0, 3.0], [0, 0, 1, 1]

    assert number_by_gap(time, 5.0).tolist() == [0, 0, 0, 0]
    assert number_by_gap(time, 5.0, file).tolist() == [0, 0, 1, 1]


@pytest.mark.parametrize(
    ("time", "seconds", "message"),
    [([0.0, np.nan], 1.0, "finite numbers"), ([0.0], 0.0, "positive number of seconds, got 0"), ([[0.0]], 1.0, "list")],
)
def test_pauses_that_cannot_be_found_are_refused(time, seconds, message):
    with pytest.raises(InputError, match=message):
        number_by_gap(time, seconds)


DATES = {
    "iso": ["2026-11-26", "2026-11-25", "2026-11-26"],
    "with time of day": ["2026-11-26T23:59:59", "2026-11-25 00:00", "2026-11-26 01:00"],
    "file names": ["rec_20261126_103000.csv", "rec_20261125103000.csv", "a/20261126.csv"],
    "german": ["26.11.2026 10:00", "25.11.2026", "26.11.2026"],
    "slashes": ["2026/11/26", "2026/11/25", "2026/11/26"],
    "numbers": [20261126, 20261125, 20261126],
    "seconds since 1970": [1795651200.5, 1795651199.0, 1795737599],
    "nanoseconds since 1970": np.array([1795651200, 1795651199, 1795737599]) * 10**9,
    "datetime64": np.array(["2026-11-26T10:00", "2026-11-25T23:59", "2026-11-26T00:00"], dtype="datetime64[s]"),
}


@pytest.mark.parametrize("kind", DATES)
def test_sessions_are_numbered_by_date(kind):
    assert number_by_date(DATES[kind]).tolist() == [1, 0, 1]


@pytest.mark.parametrize("text", ["11/12/2026", "2026-13-01", "run 5", "", "120261126", "2026-11-261", "1795651200"])
def test_what_is_no_date_is_refused(text):
    with pytest.raises(InputError, match=r"date: no date in .*expected one such as 2026-11-26"):
        number_by_date(["2026-11-26", text])


def test_a_missing_date_is_refused():
    with pytest.raises(InputError, match="a date is missing"):
        number_by_date(np.array(["NaT"], dtype="datetime64[D]"))


def test_a_gap_is_a_step_of_more_than_five_median_steps_or_back():
    time = np.cumsum([0.0, 1, 1, 5, 1, 5.01, 1, -1, 1, 1])

    assert np.flatnonzero(breaks(time, np.zeros(10, dtype=bool))).tolist() == [5, 7]


def test_where_streams_end_anyway_there_is_no_gap_and_no_step():
    time = np.array([0.0, 1, 100, 101, 200, 201])
    known = np.array([True, False, True, False, True, False])

    assert median_step(time, known) == 1.0
    assert not breaks(time, known).any()
    assert median_step(time[:1]) == np.inf
