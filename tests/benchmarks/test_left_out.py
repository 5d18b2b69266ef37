"""The study of intervals for sessions left out shifts each taxel by itself, or all by the same."""

import numpy as np
import pytest

from benchmarks.studies.intervals import left_out
from benchmarks.studies.intervals.coverage import coverage


@pytest.mark.parametrize(
    ("shifts", "between", "within"), [("none", 0.0, 0.0), ("each taxel", 0.0, 1.0), ("all taxels", 1.0, 0.0)]
)
def test_a_session_shifts_all_classes_by(shifts, between, within):
    """Variances of what all taxels of a session share, and of what each has besides."""
    taps = left_out.draw(60, shifts, 1, first=3)
    np.testing.assert_array_equal(np.unique(taps.session), np.arange(3, 63))
    mean = np.array([taps.taps[taps.session == session].mean(axis=(0, 1)) for session in range(3, 63)])
    mean -= left_out._LEVEL.mean(axis=(0, 1))
    shared = mean.mean(axis=1)
    noise = 0.05
    assert shared.var(ddof=1) == pytest.approx(between + within / left_out.TAXELS, abs=0.5 * between + noise)
    assert (mean - shared[:, None]).var() == pytest.approx(within * (1 - 1 / left_out.TAXELS), abs=0.2 * within + noise)


@pytest.mark.parametrize("how", [left_out.FIXED, left_out.REFITTED])
def test_states_hold_what_all_taxels_share(how):
    """Each kind of shift has rows of its own, and `session:` gains most where all taxels share it."""
    rows, gain = [], {}
    for shifts in left_out.SHIFTS:
        found = left_out.measured(how, 3, shifts, 1)
        gain[shifts] = found["difference", False].value
        sets = {key: [one, one._replace(value=one.value + 1)] for key, one in found.items()}
        rows += [(how, shifts, 3, *key, coverage(both, both[0].value)) for key, both in sets.items()]
    assert gain["all taxels"] > 2 > max(gain["each taxel"], gain["none"])
    lines = left_out.document(rows).splitlines()[2:]
    assert [line.split(" | ")[1] for line in lines] == [shifts for shifts in left_out.SHIFTS for _ in range(3)]
    assert all(line.split(" | ")[4].startswith("1.000") for line in lines)
