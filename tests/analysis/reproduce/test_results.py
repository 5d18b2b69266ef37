"""What came out of a run: the threshold up to which the test taps suffice."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from solidtouch.analysis.experiment.settings import ExperimentSettings
from solidtouch.analysis.reproduce.results import Results
from solidtouch.inference.trials.records import tap_table
from solidtouch.inference.trials.resampling import Spread
from solidtouch.models.settings import FitSettings
from solidtouch.models.splits import split


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


def test_folds_have_wider_intervals_than_data_sets():
    """They share training sessions; the resamples of a single one have a factor of their own."""

    def factors(studies, simulated):
        own = SimpleNamespace(played=SimpleNamespace(spread=Spread(np.nan), fresh_spread=Spread(3.0)))
        results = Results(SimpleNamespace(simulated=simulated), None, (), [own] * studies, None, None, 0, None)
        return results.spread.factor, results.fresh_spread.factor

    assert factors(3, None) == pytest.approx(2 * [np.sqrt(2.5)])
    assert factors(3, "paper") == (1.0, 1.0)
    assert factors(1, None) == pytest.approx((np.nan, 3.0), nan_ok=True)


@pytest.mark.parametrize(("model", "has_p"), [("histogram", True), ("gaussian", False)])
def test_the_example_has_p_values_where_the_model_gives_them(make_taps, model, has_p):
    """As `perceive` prints them for such a model."""
    taps = make_taps(sessions=2, repeats=10)
    settings = ExperimentSettings(model=model, fit=FitSettings(bins=12))
    (fold,) = split(taps, taps.grid(), "sessions").folds
    fitted = settings.fitted(fold.train, taps.grid())
    first = SimpleNamespace(name="taps", model=fitted, test=fold.test, table=tap_table(fitted, fold.test))
    request = SimpleNamespace(settings=settings, split=SimpleNamespace(folds=(fold,)))
    shown = str(Results(request, taps.grid(), (), [first], None, None, 1, None).example.html)

    assert ('"p":null' in shown) != has_p
    assert re.search(r'"p":[\d.]', shown) is not None or not has_p
