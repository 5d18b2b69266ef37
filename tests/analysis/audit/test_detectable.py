"""Detectable factors are those at which simulated tests have the wanted power."""

import numpy as np
import pytest
from solidtouch.analysis.audit.detectable import Design, detectable, detectable_factor, enough
from solidtouch.analysis.stats.detection import LEVEL, POWER
from solidtouch.inference.trials.records import tap_table
from solidtouch.models.errors import InputError
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.setting_file import Setting
from solidtouch.models.taps import TapSet


def factors(rng, expected, cluster=1, f=1.0, n=40_000):
    """Wrong over expected decisions where each error comes `cluster` times."""
    return cluster * rng.poisson(f * expected / cluster, size=n) / expected


@pytest.mark.parametrize(("expected", "cluster"), [(4, 1), (12, 1), (50, 1), (40, 4), (60, 10)])
def test_the_power_at_the_detectable_factor_is_the_wanted_one(rng, expected, cluster):
    """Within .06, for counts of independent errors and of errors that come in clusters."""
    right = factors(rng, expected, cluster)
    f = detectable_factor(right)
    power = (factors(rng, expected, cluster, f) > np.quantile(right, 1 - LEVEL)).mean()
    assert power == pytest.approx(POWER, abs=0.06)


def test_more_data_detect_less(rng):
    """The table has a row for each design, and factors that fall with sessions and taps."""
    designs = [Design(1, 5), Design(1, 20), Design(3, 20), Design(3, 60)]
    rows = detectable(lambda design: factors(rng, 0.6 * design.sessions * design.taps), designs)
    assert [row.design for row in rows] == designs
    assert all(row.factor > row.right > 1 for row in rows)
    assert (np.diff([row.factor for row in rows]) < 0).all()
    assert rows[0].factor > 2.5
    assert rows[-1].factor < 1.4


def test_infinite_factors_count_by_their_rank(rng):
    """Few of them raise what a right model may give; where they are more than the level, nothing is detected."""
    right = factors(rng, 20, n=1000)
    (plain,), (few,), (many,) = (
        detectable(lambda _, share=share: np.append(right, np.full(int(1000 * share), np.inf)), [Design(1, 20)])
        for share in (0.0, 0.02, 0.2)
    )
    assert few.right > plain.right
    assert plain.factor < few.factor < np.inf
    assert (many.right, many.factor) == (np.inf, np.inf)


def test_a_given_critical_factor_is_used(rng):
    right = factors(rng, 20)
    assert detectable_factor(right, critical=2.0) > detectable_factor(right)
    assert detectable_factor(right, power=0.01) == 1.0


def test_without_wrong_decisions_nothing_is_detected():
    assert detectable_factor(np.zeros(50)) == np.inf
    assert detectable_factor(np.r_[np.zeros(99), 1e-3], critical=5.0) == np.inf


@pytest.mark.parametrize("values", [[1.0], [1.0, -0.1], [1.0, np.nan], [[1.0, 2.0]]])
def test_what_is_no_factor_is_refused(values):
    with pytest.raises(InputError, match="two or more non-negative factors"):
        detectable_factor(values)


@pytest.fixture
def few(make_model, rng):
    """A model of four objects and six taps of each."""
    model = make_model(L=1, M=4, K=2, J=2, B=5, seed=1)
    what = np.repeat(np.arange(4), 6)
    names = [name for (name,) in model.grid.what_members]
    taps = TapSet.from_arrays(rng.normal(size=(24, 2, 2)), what, names, preprocessing=Preprocessing(samples=2))
    return model, tap_table(model, taps)


def test_a_design_of_a_fitted_model_detects_less_with_more_taps(few):
    """By simulation from the model itself; as many taps in fewer sessions detect as much."""
    model, table = few
    rows = enough(model, table, Setting.of(threshold=0.8, power="none"), "passive", 500, 0, 40)
    factor = {row.design: row.factor for row in rows}
    assert len(rows) == 9
    assert factor[Design(3, 20)] == factor[Design(1, 60)]
    assert factor[Design(10, 60)] < factor[Design(1, 20)] < factor[Design(1, 6)]
