"""Times of files in seconds, however they are written."""

import numpy as np
import pytest
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.times import in_seconds

AT = 1795687200.25  # 2026-11-26 10:00:00.25 in Greenwich


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("2026-11-26 10:00:00.25", AT),
        ("2026-11-26T10:00:00.250000Z", AT),
        ("2026-11-26T10:00:00.25+00:00", AT),
        ("2026-11-26 11:00:00.25+0100", AT),
        ("2026-11-26T04:30:00.25-05:30", AT),
        ("2026/11/26 10:00:00.25", AT),
        ("26.11.2026 10:00:00,25", AT),
        ("26.11.2026_10:00", AT - 0.25),
        ("2026-11-26", AT - 36000.25),
        ("26.11.2026", AT - 36000.25),
        ("9:05:07.5", 32707.5),
        ("10:00:00.123456789", 36000.123456789),
        ("23:59", 86340.0),
        ("", np.nan),
        ("NaT", np.nan),
    ],
)
def test_clocks_and_dates(text, seconds):
    assert in_seconds("time", "t", np.array([text]), "s").tolist() == pytest.approx([seconds], nan_ok=True, abs=1e-6)


@pytest.mark.parametrize(
    "text", ["11/12/2026 10:00", "26-11-2026", "10:00:00 AM", "tomorrow", "25:00:00", "10:61", "30.02.2026", "10"]
)
def test_what_is_no_time_is_refused(text):
    """Also an order of day and month that nobody knows."""
    with pytest.raises(InputError, match=r"time \(--time\): t holds .*, not numbers or times such as 2026-11-26 10:00"):
        in_seconds("time", "t", np.array(["9:00", text]), "s")


def test_numbers_have_a_unit():
    assert in_seconds("time", "t", np.array([1500]), "ms").tolist() == [1.5]
    with pytest.raises(InputError, match="t is in 'min'; say its unit with --time-unit"):
        in_seconds("time", "t", np.array([1500]), "min")
