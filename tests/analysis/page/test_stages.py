"""Checks with their seconds."""

import numpy as np
from solidtouch.analysis.page.stages import timed_check


def test_checks_are_timed():
    check = timed_check("a", "b", lambda: ("c", True))

    assert check[:4] == ("a", "b", "c", True)
    assert 0 <= check.seconds < 1
    assert np.isfinite(check.seconds)
