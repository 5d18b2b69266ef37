"""Remedies are tuned on sessions that they are not measured on, and what they buy is what their beliefs say."""

from dataclasses import replace
from functools import partial

import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from slow_cases import slow_but
from solidtouch.analysis.audit import remedies
from solidtouch.analysis.audit.remedies import BASELINE, FINER, MODELS, count_remedies, make_remedies, no_change
from solidtouch.analysis.audit.remedy_scores import count_measurements, lost, measure
from solidtouch.analysis.audit.verdict import worthwhile
from solidtouch.analysis.stats.decisions import spread_of
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import PAPER_RODS, preset
from solidtouch.inference.trials.resampling import USED_UP_SELECTED
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.generic import fit, source
from solidtouch.models.measurement.registry import register
from solidtouch.models.setting_file import Setting

RIG = replace(preset("paper"), rods=PAPER_RODS[:3], start_mm=6.0, end_mm=10.0, spacing_mm=0.125)
SETTING = Setting.of(bins=40, threshold=0.9)
TAPS = 4
ALL = [BASELINE, "exponent", "falling exponent", *MODELS, "gaussian", FINER]


@pytest.fixture(scope="module")
def sessions():
    """Three simulated sessions, 4 x 3 classes of 8 taps."""
    return [simulate_session(RIG, 1, session) for session in range(3)]


@pytest.fixture(scope="module")
def made(sessions):
    """Every remedy, those that are refused, and how often progress was told of."""
    told = []
    remedies, refused = make_remedies(
        no_change(SETTING, sessions[0], sessions[0].grid()),
        sessions[0],
        [sessions[1]],
        TAPS,
        0,
        told.append,
        ["gaussian"],
    )
    return remedies, refused, sum(told)


few = partial(measure, simulations=9)
"""With few data sets of a right model."""


@pytest.fixture(scope="module")
def measured(made, sessions):
    """What they buy on the third session."""
    return measure(made[0], sessions[2], TAPS, 200, 0, lambda _: None)


def test_every_remedy_changes_one_thing(made):
    """The setting as it is comes first, unchanged; the others differ from it in what they are called after."""
    remedies, refused, told = made
    assert [remedy.name for remedy in remedies] == ALL
    assert refused == []
    assert told == count_remedies(["gaussian"])
    changes = {
        remedy.name: {
            name
            for name, value in remedy.setting.values().items()
            if name != "note" and value != SETTING.values()[name]
        }
        for remedy in remedies
    }
    assert changes.pop(BASELINE) == set()
    assert changes.pop("exponent") <= {"power"}
    assert changes.pop("falling exponent") <= {"power", "saturation"}
    assert changes.pop(FINER) == {"where_cell"}
    assert all("model" in change and change <= {"model", "power"} for change in changes.values())
    assert {name: MODELS[name][0] for name in MODELS} | {"gaussian": "gaussian"} == {
        remedy.name: remedy.setting.model for remedy in remedies if "model" in changes.get(remedy.name, ())
    }


@pytest.mark.slow
def test_a_function_is_fitted_as_the_setting_says_and_tuned(sessions, monkeypatch):
    """Its table says what its first sentence says; one that cannot be fitted is refused."""

    def level(where, what, taps=None, *, M, J, K):
        """A level for each object."""
        with numpyro.plate("M", M, dim=-2), numpyro.plate("K", K, dim=-1):
            loc = numpyro.sample("loc", dist.Normal(0.0, 3.0))
        with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
            numpyro.sample("taps", dist.Normal(loc[what][:, None], 1.0), obs=taps)

    def fails(where, what, taps=None): ...

    monkeypatch.setattr(remedies, "MODELS", {})
    monkeypatch.setattr(source, "_registered", {})
    methods, posterior = [], fit.posterior
    monkeypatch.setattr(fit, "posterior", lambda fit, method: methods.append(method) or posterior(fit, method))
    setting = Setting(fit=SETTING.fit.changed(method="map"), play=SETTING.play)
    names = [register(level), register(fails)]
    train, tune = sessions[:2]
    found, refused = make_remedies(
        no_change(setting, train, train.grid()), train, [tune], TAPS, 0, lambda _: None, names
    )

    (own,) = (remedy for remedy in found if remedy.name == "level")
    assert (own.title, own.model.name) == ("A level for each object", "level")
    assert own.setting.fit.power != "J"
    assert methods == ["map"]
    assert [one.name for one in refused] == ["fails"]


def test_models_are_at_the_power_that_their_setting_says(made):
    """Each setting accepts its model, so that `perceive` takes both."""
    for remedy in made[0]:
        remedy.setting.check_model(remedy.model, "model.nc", "setting.json")
        assert remedy.model.grid is remedy.grid or remedy.model.grid.shape == remedy.grid.shape


def test_the_finer_grid_has_twice_as_many_positions(made):
    finer = made[0][-1]
    assert finer.grid.shape == (8, 3)
    assert finer.setting.where_cell == "0.5mm"
    assert all(remedy.grid.shape == (4, 3) for remedy in made[0][:-1])


@pytest.mark.slow
def test_a_fixation_point_stays_where_it_is(measured, sessions, monkeypatch):
    """On the finer grid it has another index; in measurements it is the setting's, not the middle."""
    monkeypatch.setattr(remedies, "MODELS", {name: MODELS[name] for name in [*MODELS][:1]})
    at_end = SETTING.changed(fixation=3)
    grid = sessions[0].grid()
    made, _ = make_remedies(no_change(at_end, sessions[0], grid), sessions[0], [sessions[1]], TAPS, 0, lambda _: None)
    assert [remedy.setting.play.fixation for remedy in made] == [3] * 4 + [6]
    found = few(made[:1], sessions[2], TAPS, 200, 0, lambda _: None)
    assert found.taps != measured.taps
    assert found.scores[0].taps != measured.scores[0].taps


def test_training_taps_do_not_tune(made, sessions):
    """Other tuning sessions give other exponents with the same tables."""
    others, _ = make_remedies(
        no_change(SETTING, sessions[0], sessions[0].grid()), sessions[0], [sessions[0]], TAPS, 0, lambda _: None
    )
    tuned, again = made[0][1], others[1]
    np.testing.assert_array_equal(tuned.model.counts, again.model.counts)
    assert again.setting.fit.power > 1.2 * tuned.setting.fit.power


def test_what_taps_do_not_allow_is_refused_with_a_reason(make_taps):
    """Profiles need samples, covariance taxels, finer classes several places; the others still come."""
    sets = [make_taps(sessions=1, J=1, K=1, seed=seed) for seed in range(2)]
    told = []
    remedies, refused = make_remedies(
        no_change(Setting.of(bins=20), sets[0], sets[0].grid()), sets[0], sets[1:], TAPS, 0, told.append
    )
    assert [remedy.name for remedy in remedies] == [BASELINE, "exponent", "falling exponent", "session state"]
    reasons = {item.name: item.reason for item in refused}
    assert list(reasons) == ["time-indexed", "taxel covariance", FINER]
    assert "more than one sample" in reasons["time-indexed"]
    assert "more than one taxel" in reasons["taxel covariance"]
    assert "Position classes have no width" in reasons[FINER]
    assert sum(told) == count_remedies()


def test_places_that_do_not_vary_need_no_finer_grid():
    """All taps of a class at its centre leave finer classes empty."""
    centred = replace(RIG, position_spread_mm=0.0)
    sets = [simulate_session(centred, 1, session) for session in range(2)]
    _, refused = make_remedies(no_change(SETTING, sets[0], sets[0].grid()), sets[0], sets[1:], TAPS, 0, lambda _: None)
    assert [(item.name, "lie at the same position" in item.reason) for item in refused] == [(FINER, True)]


def test_a_remedy_compared_with_itself_gains_nothing(made, sessions):
    """Neither in log score nor in errors, and nothing is lost against it.

    What trials that ran out of taps would have come to is not known, not even that it is the same.
    """
    base = made[0][0]
    told = []
    found = few([base, base._replace(name="the same")], sessions[2], TAPS, 200, 0, told.append)
    same = found.scores[1]
    assert same.gain == (0, 0, 0)
    assert same.sure_gain == 0
    for change, low, high in (same.error_change, same.where_error_change):
        assert change == 0
        assert low == -high <= 0
    assert (
        same._replace(name=BASELINE, gain=None, sure_gain=None, error_change=None, where_error_change=None)
        == (found.scores[0])
    )
    assert lost(found)["model"] is None
    assert sum(told) == 4 + 9 == count_measurements([base, base], 9)


@pytest.mark.parametrize("factor", slow_but([1 + 1e-14], [1 + 1e-14, 1 - 1e-14]))
def test_a_gain_by_rounding_is_none(made, sessions, factor):
    """A remedy whose exponent differs in the last digits gains nothing either way, and so does not help."""
    base = made[0][0]
    near = base._replace(name="near", model=replace(base.model, power=factor / 50))
    found = few([base, near], sessions[2], TAPS, 200, 0, lambda _: None)
    assert found.scores[1].log_score != found.scores[0].log_score
    assert (found.scores[1].gain, found.scores[1].sure_gain) == ((0, 0, 0), 0)
    assert not worthwhile(found, found.scores[1])
    assert lost(found)["model"] is None


def test_scores_after_one_tap_are_those_of_bayes_rule(made, sessions):
    """With one tap per class the score is the mean log belief in the object by the paper's equations written out."""
    base, sharper = made[0][0], made[0][1]
    test = sessions[2]
    one = test.select(
        [np.flatnonzero((test.what == m) & (np.floor(test.where) == 6 + l))[0] for l in range(4) for m in range(3)]
    )
    found = few([base, sharper], one, TAPS, 100, 0, lambda _: None)
    assert found.n == 1
    model = base.model
    where, what = one.indices(base.grid)

    def score(exponent):
        scores = []
        for i, tap in enumerate(one.taps):
            bins = np.clip(np.searchsorted(model.edges, tap, side="right") - 1, 0, 39)
            log = np.zeros((4, 3))
            for l, m in np.ndindex(4, 3):
                log[l, m] = exponent * model.log_prob[l, m][np.arange(12), bins].sum()
            belief = np.exp(log - log.max())
            scores.append(np.log(belief[:, what[i]].sum() / belief.sum()))
        return float(np.mean(scores))

    assert found.scores[0].log_score[0] == pytest.approx(score(1 / 50))
    assert found.scores[1].log_score[0] == pytest.approx(score(sharper.setting.fit.power))
    assert found.scores[1].gain[0] == pytest.approx(found.scores[1].log_score[0] - found.scores[0].log_score[0])
    assert where.tolist() == np.repeat(np.arange(4), 3).tolist()


def test_gains_are_differences_of_scores_on_the_same_sequences(measured):
    """For every remedy with the classes of the setting as it is; intervals hold the estimate, at both levels."""
    base, *others = measured.scores
    assert [score.name for score in others] == ALL[1:]
    assert base.gain is None
    assert base.sure_gain is None
    for score in others:
        value, low, high = score.gain
        assert low <= value <= high
        assert score.sure_gain <= value
        if score.name != FINER:
            assert value == pytest.approx(score.log_score[0] - base.log_score[0])


def test_a_gain_is_less_sure_among_more_remedies(made, measured, sessions):
    """The level holds for all of them together: the same gain, with a lower sure end."""
    alone, among = measure(made[0][:2], sessions[2], TAPS, 200, 0, lambda _: None).scores[1], measured.scores[1]
    assert alone.gain == among.gain
    assert alone.sure_gain > among.sure_gain


def test_errors_are_compared_at_the_reaction_time_of_the_setting_as_it_is(measured):
    """At its threshold, or the highest below at which test taps suffice; its own error there is that at it."""
    own = measured.played.sel(model=BASELINE, policy=measured.policy)
    used_up = own["used_up"].sel(theta=measured.theta)
    assert measured.theta < SETTING.play.threshold
    assert used_up[0] == 0
    assert spread_of(measured.played).center(used_up.values) < 2 * USED_UP_SELECTED
    at = own.sel(theta=measured.theta).isel(resample=0)
    assert measured.policy == "active"
    assert measured.taps == pytest.approx(float(at["taps"]))
    assert measured.scores[0].error[0] == pytest.approx(float(at["what_error"]))
    compared = [score for score in measured.scores[1:] if score.error_change is not None]
    assert len(compared) >= 3
    for score in compared:
        value, low, high = score.error_change
        assert low <= value <= high
        if score.name != FINER:
            assert value == pytest.approx(score.error[0] - measured.scores[0].error[0])


def test_what_is_lost_is_the_gain_of_the_best(measured):
    """Of the remedies with the same classes that surely err less, the one that errs least, its interval turned round.

    One that cannot be compared at that reaction time, one with other classes and one that may err as often are none.
    """
    changes = {
        "exponent": (-0.2, -0.3, -0.1),
        "falling exponent": (-0.3, -0.7, 0.1),
        "time-indexed": (-0.25, -0.3, -0.05),
        FINER: (-0.5, -0.6, -0.4),
    }
    base, *others = measured.scores
    made = measured._replace(scores=[base, *(s._replace(error_change=changes.get(s.name)) for s in others)])
    found = lost(made)
    assert {name: found[name] for name in ("model", "error", "low", "high")} == {
        "model": "time-indexed",
        "error": 0.25,
        "low": 0.05,
        "high": 0.3,
    }
    curve = measured.played.sel(model="time-indexed", policy="active").isel(resample=0)
    enough = curve["taps"].values[curve["what_error"].values <= base.error[0]]
    assert found["taps"] == (pytest.approx(measured.taps - enough.min()) if len(enough) else None)
    nothing = made._replace(scores=[base, *(s._replace(error_change=None) for s in others)])
    assert lost(nothing) == {"model": None, "error": 0.0, "low": None, "high": None, "taps": None}


def test_a_passive_setting_is_measured_passive(made, sessions):
    base = made[0][0]
    passive = base._replace(setting=SETTING.changed(passive=True))
    assert few([passive], sessions[2], TAPS, 100, 0, lambda _: None).policy == "passive"


def test_results_repeat_with_the_seed(made, sessions):
    """Of both the tuning and the measurement."""
    some = made[0][:2]
    one, again, other = (few(some, sessions[2], TAPS, 100, seed, lambda _: None).scores for seed in (3, 3, 4))
    assert one == again
    assert one != other


def test_taps_of_unknown_classes_cannot_be_measured_on(made, sessions):
    """Those outside the range of the training taps."""
    far = sessions[2].dataset.assign_coords(where=("tap", sessions[2].where + 100, {"units": "mm"}))
    with pytest.raises(InputError, match="No measuring tap belongs to a class that all remedies were trained with"):
        measure(made[0][:2], type(sessions[2])(far), TAPS, 100, 0, lambda _: None)
