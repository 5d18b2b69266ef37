"""What came out of a run: the threshold up to which the test taps suffice."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from solidtouch.analysis.reproduce.results import Results


@pytest.mark.parametrize(
    ("used_up", "selected", "theta"),
    [
        ([0, 0, 0], [0, 0, 0.004], None),  # at the shown one too
        ([0, 0, 0], [0, 0.004, 0.006], 0.5),
        ([0, 0, 0.01], [0, 0, 0], 0.5),  # several data sets have no selections
        ([0, 0.2, 0.3], [0, 0, 0], 0.2),
        ([0.1, 0.2, 0.3], [0, 0, 0], None),
    ],
)
def test_fresh_taps_are_shown_where_they_suffice(used_up, selected, theta):
    """At the highest threshold below the one that is shown, if they do not there; shares are means of data sets."""
    of = [
        SimpleNamespace(played=SimpleNamespace(used_up=np.array([u, 0 * u]), selected=np.array([s, s])))
        for u, s in ((0 * np.array(used_up), np.array(selected)), (2 * np.array(used_up), np.array(selected)))
    ]
    passive = xr.Dataset(coords={"theta": [0.2, 0.5, 0.9]})
    results = Results(None, (), (), of, None, SimpleNamespace(passive=passive), 0, None)
    assert results.enough == theta
    assert results.used_up == pytest.approx(used_up[-1])
