"""The power learned on sessions left out in turn or held out, and with it how many taps count."""

from dataclasses import replace

import numpy as np
import pytest
from solidtouch.hardware.simulator.model_rig import draw_taps
from solidtouch.inference.filter import log_fold, share
from solidtouch.inference.trials.records import tap_table
from solidtouch.inference.tuning.tempering import LEAST, MOST, best_power, fit_tempered, learn_power, learn_saturation
from solidtouch.models.errors import InputError
from solidtouch.models.io.model_file import load_model
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.settings import FitSettings

L, M, J, K, B, REPEATS = 3, 2, 6, 5, 7, 4
SETTINGS = FitSettings(bins=B, gain_sd=0.05, offset_sd=0.3)


@pytest.fixture(scope="module")
def taps(make_taps):
    """Three sessions, each with an offset of its own, so that a belief at power 1 is too sure."""
    taps = make_taps(L, M, J, K, sessions=3, repeats=REPEATS)
    dataset = taps.dataset.copy(deep=True)
    dataset["taps"] += 0.8 * (dataset["session"] - 1.0)
    return type(taps)(dataset)


def naive_score(name, taps, exponent, n):
    """Mean log belief in the true class after the first n taps of each class and session, in plain loops.

    A class counts by its taps in the session.
    """
    total, weight = [], []
    for session in np.unique(taps.session):
        rest, left_out = taps.select(taps.session != session), taps.select(taps.session == session)
        model = fit_model(name, rest, taps.grid(), SETTINGS.changed(power=float(exponent))).model
        table = tap_table(model, left_out)
        where, what = left_out.indices(model.grid)
        for l, m in np.ndindex(L, M):
            log_belief = model.log_prior.copy()
            for i in np.flatnonzero((where == l) & (what == m))[:n]:
                log_belief = log_belief + table.log_likelihood[i]
            log_belief = log_fold(log_belief - np.logaddexp.reduce(log_belief.ravel()), M)
            total.append(log_belief[l, m])
            weight.append(np.sum((where == l) & (what == m)))
    return np.average(total, weights=weight)


@pytest.mark.parametrize("name", ["histogram", "profile", "session"])
def test_the_curve_is_the_mean_log_belief_of_left_out_taps(taps, name):
    """After all taps of a class and session, at each exponent."""
    learned = learn_power(name, taps, taps.grid(), SETTINGS, REPEATS, 0)

    assert learned.sessions == (0, 1, 2)
    for i in (0, len(learned.exponents) // 2, -1):
        expected = naive_score(name, taps, learned.exponents[i], REPEATS)
        assert learned.score[i] == pytest.approx(expected, rel=1e-9)


def test_classes_count_by_their_taps(taps):
    """Also where they have different numbers of them in a session, one tap or all."""
    uneven = taps.select((taps.session > 0) | (taps.what == 0) | (taps.trial < taps.trial.max() / 2))
    learned = learn_power("histogram", uneven, taps.grid(), SETTINGS, 9, 0)
    where, what = uneven.indices(taps.grid())

    assert len(set(np.bincount((uneven.session * L + where) * M + what))) > 1
    assert learned.score[7] == pytest.approx(naive_score("histogram", uneven, learned.exponents[7], 9), rel=1e-9)


@pytest.mark.parametrize("name", ["histogram", "gaussian", "session:gaussian"])
def test_no_exponent_around_the_learned_one_scores_higher(taps, name):
    """On the curve, which holds it, and beside it."""
    learned = learn_power(name, taps, taps.grid(), SETTINGS, REPEATS, 0)
    top = int(learned.score.argmax())

    assert LEAST < learned.power < MOST
    assert learned.exponents[top] == learned.power
    assert (np.diff(learned.exponents) > 0).all()
    for factor in (0.98, 1.02):
        assert naive_score(name, taps, factor * learned.power, REPEATS) < learned.score[top]


def test_the_score_after_one_tap_is_that_of_every_tap(taps):
    """A sequence of one tap is each tap once."""
    learned = learn_power("gaussian", taps, taps.grid(), SETTINGS, 1, 0)
    scores = []
    for session in range(3):
        model = fit_model("gaussian", taps.select(taps.session != session), taps.grid(), SETTINGS.changed(power="none"))
        left_out = taps.select(taps.session == session)
        where, what = left_out.indices(taps.grid())
        log_joint = learned.power * model.model.log_likelihood(left_out.taps)
        evidence = np.logaddexp.reduce(log_joint.reshape(len(left_out), -1), axis=1)
        scores.append(log_joint[np.arange(len(left_out)), where, what] - evidence)

    assert learned.score.max() == pytest.approx(np.concatenate(scores).mean(), rel=1e-9)


def test_more_taps_count_less_each(taps):
    """What the taps of a session have in common is counted once only."""
    powers = [learn_power("gaussian", taps, taps.grid(), SETTINGS, n, 0).power for n in (1, REPEATS)]

    assert powers[1] < 0.7 * powers[0]


def test_independent_samples_keep_their_power(make_model):
    """Taps drawn from the model itself deserve a power near 1; a hundred copies of each sample a hundredth of it."""
    from solidtouch.models.preprocessing import Preprocessing
    from solidtouch.models.taps import TapSet, concatenate

    source = make_model(L=3, M=4, K=2, J=5, B=4, taps=40, seed=1)
    parts = [
        draw_taps(source.grid, source.probabilities, source.edges, source.preprocessing, 60, 7, session)
        for session in range(2)
    ]
    taps = concatenate(parts)
    settings = FitSettings(edges=source.edges, bins=4, pseudocount=0.5)
    once = learn_power("histogram", taps, taps.grid(), settings, 2, 0).power
    dataset = taps.dataset.isel(sample=np.tile(np.arange(5), 100))
    dataset.attrs["preprocessing"] = Preprocessing(samples=500).to_json()
    often = learn_power("histogram", TapSet(dataset), taps.grid(), settings, 2, 0).power

    assert 0.7 < once <= 1
    assert often == pytest.approx(once / 100, rel=0.1)


def test_the_seed_decides_which_taps_are_taken(taps):
    curves = [learn_power("gaussian", taps, taps.grid(), SETTINGS, 2, seed).score for seed in (0, 0, 1)]

    np.testing.assert_array_equal(curves[0], curves[1])
    assert not np.array_equal(curves[0], curves[2])


def test_a_sequence_longer_than_a_session_takes_all_its_taps(taps):
    few, many = (learn_power("gaussian", taps, taps.grid(), SETTINGS, n, 0) for n in (REPEATS, 50))

    assert few.power == many.power
    np.testing.assert_array_equal(few.score, many.score)


def test_the_power_ignored_is_that_of_the_settings(taps):
    powers = [learn_power("gaussian", taps, taps.grid(), SETTINGS.changed(power=p), 3, 0).power for p in ("JK", "none")]

    assert powers[0] == powers[1]


def test_classes_of_one_session_cannot_be_learned_from(taps):
    """They are left out with the session; where that leaves nothing, this is said."""
    some = taps.select((taps.session > 0) | (taps.what == 0))
    apart = taps.select((taps.session == 0) == (taps.what == 0)).select

    assert learn_power("histogram", some, taps.grid(), SETTINGS, 3, 0).sessions == (0, 1, 2)
    only = apart(np.flatnonzero(taps.session[(taps.session == 0) == (taps.what == 0)] < 2))
    with pytest.raises(InputError, match="needs at least one class with taps in two training sessions"):
        learn_power("histogram", only, taps.grid(), SETTINGS, 3, 0)


def test_one_session_is_too_few(taps):
    with pytest.raises(InputError, match=r"needs at least two training sessions, .* got session 2 only"):
        learn_power("histogram", taps.select(taps.session == 2), taps.grid(), SETTINGS, 3, 0)


def test_impossible_taps_are_refused(taps):
    """No power makes them possible; a pseudocount does."""
    with pytest.raises(InputError, match="sequences of held-out taps are impossible under their own class"):
        learn_power("histogram", taps, taps.grid(), SETTINGS.changed(pseudocount=0.0, bins=60), 3, 0)


def test_no_taps_are_refused(taps):
    with pytest.raises(InputError, match="taps must be at least 1, got 0"):
        learn_power("histogram", taps, taps.grid(), SETTINGS, 0, 0)


def test_a_model_is_fitted_with_the_learned_power(taps, tmp_path):
    """To all sessions; its file says the number and how it was found."""
    settings = SETTINGS.changed(power="learned:3", seed=4)
    fitted, learned = fit_tempered("profile", taps, taps.grid(), settings, "taps.nc: all.")
    fitted.model.save(tmp_path / "model.nc")
    loaded = load_model(tmp_path / "model.nc")

    assert learned.power == fitted.model.power
    assert learned.power == learn_power("profile", taps, taps.grid(), settings, 3, 4).power
    assert loaded.power == learned.power
    assert loaded.trained_on == f"taps.nc: all. {learned.sentence}"
    assert "learned on sessions 0, 1, 2, left out in turn" in learned.sentence
    assert f"true class, −{-learned.score.max():.3g}, after" in learned.sentence
    assert "after 3 taps of a class" in learned.sentence
    np.testing.assert_array_equal(
        loaded.log_likelihood(taps.taps),
        fit_model("profile", taps, taps.grid(), settings.changed(power=learned.power)).model.log_likelihood(taps.taps),
    )


def test_other_powers_are_kept(taps):
    fitted, learned = fit_tempered("histogram", taps, taps.grid(), SETTINGS.changed(power="JK"), "all")

    assert learned is None
    assert (fitted.model.power, fitted.model.trained_on) == ("JK", "all")


def held_out_score(model, taps, exponent, n, power=1.0):
    """Mean log belief in the true class, read at a power, after the first n taps of each class; in plain loops."""
    where, what = taps.indices(model.grid)
    total, weight = [], []
    table = tap_table(replace(model, power=float(exponent)), taps)
    for session, l, m in np.ndindex(3, L, M):
        own = np.flatnonzero((where == l) & (what == m) & (taps.session == session))
        if not len(own):
            continue
        log_belief = power * (model.log_prior + table.log_likelihood[own[:n]].sum(axis=0))
        log_belief = log_fold(log_belief - np.logaddexp.reduce(log_belief.ravel()), M)
        total.append(log_belief[l, m])
        weight.append(len(own))
    return np.average(total, weights=weight)


@pytest.fixture(scope="module")
def fitted(taps):
    """Models of the first session."""
    train = taps.select(taps.session == 0)
    return {name: fit_model(name, train, taps.grid(), SETTINGS).model for name in ("histogram", "profile", "session")}


@pytest.mark.parametrize("name", ["histogram", "profile", "session"])
@pytest.mark.parametrize("power", ["J", 0.7])
def test_the_best_power_of_a_model_is_found_on_held_out_taps(fitted, taps, name, power):
    """Whatever its own is, and however the sessions are divided into sets."""
    model, held_out = replace(fitted[name], power=power), taps.select(taps.session > 0)
    learned = best_power(model, [held_out], REPEATS, 0)
    apart = best_power(model, [taps.select(taps.session == s) for s in (1, 2)], REPEATS, 0)

    assert learned.sessions == (1, 2)
    assert learned.power == pytest.approx(apart.power)
    assert learned.score.max() == pytest.approx(held_out_score(model, held_out, learned.power, REPEATS), rel=1e-9)
    for factor in (0.98, 1.02):
        assert held_out_score(model, held_out, factor * learned.power, REPEATS) < learned.score.max()
    assert "learned on sessions 1, 2: it has the highest" in learned.sentence


def test_leaving_out_in_turn_is_the_best_power_of_each_fit(taps):
    """Of two sessions, where both models have the same data on either side."""
    first = taps.select(taps.session == 0)
    both = type(taps)(first.dataset.copy(deep=True))
    both.dataset["session"] = ("tap", np.repeat([0, 1], len(first) // 2)[np.argsort(np.argsort(first.trial))])
    model = fit_model("histogram", both.select(both.session == 1), taps.grid(), SETTINGS).model
    alone = best_power(model, [both.select(both.session == 0)], 9, 0)
    other = fit_model("histogram", both.select(both.session == 0), taps.grid(), SETTINGS).model
    back = best_power(other, [both.select(both.session == 1)], 9, 0)
    learned = learn_power("histogram", both, taps.grid(), SETTINGS, 9, 0)

    assert learned.score[0] == pytest.approx((alone.score[0] + back.score[0]) / 2)


def test_a_power_under_a_saturation_is_judged_as_beliefs_are_read(taps):
    """Half as many taps that count deserve twice the power, as the prior is flat."""
    plain = learn_power("histogram", taps, taps.grid(), SETTINGS, REPEATS, 0)
    limited = learn_power("histogram", taps, taps.grid(), SETTINGS.changed(saturation=REPEATS / 2), REPEATS, 0)

    assert limited.power == pytest.approx(2 * plain.power, rel=1e-3)
    assert limited.score.max() == pytest.approx(plain.score.max(), rel=1e-6)


@pytest.mark.parametrize("name", ["histogram", "profile", "session"])
def test_scores_of_a_saturation_are_those_of_beliefs_read(fitted, taps, name):
    """After one tap of each and after all of a class."""
    model, held_out = fitted[name], taps.select(taps.session > 0)
    learned = learn_saturation(model, [held_out], (REPEATS,), 0)
    read = held_out_score(model, held_out, learned.power, REPEATS, share(REPEATS, learned.saturation))

    assert learned.sessions == (1, 2)
    assert learned.contacts == (REPEATS,)
    assert learned.score == pytest.approx([read], rel=1e-9)
    assert (
        learned.score[0]
        >= held_out_score(model, held_out, best_power(model, [held_out], REPEATS, 0).power, REPEATS) - 1e-6
    )


@pytest.mark.parametrize("name", ["histogram", "session"])
def test_no_pair_around_the_learned_one_scores_higher(fitted, taps, name):
    """Nor any of a grid over all that may be learned, by more than the search's last step leaves."""
    model, held_out = fitted[name], taps.select(taps.session > 0)
    learned = learn_saturation(model, [held_out], (1, REPEATS), 0)

    def score(power, saturation):
        where, what = held_out.indices(model.grid)
        single = model.log_prior + power / model.exponent * model.log_likelihood(held_out.taps)
        single = log_fold(single - np.logaddexp.reduce(single.reshape(len(single), -1), axis=1)[:, None, None], M)
        one = single[np.arange(len(single)), where, what].mean()
        return (one + held_out_score(model, held_out, power, REPEATS, share(REPEATS, saturation))) / 2

    best = score(learned.power, learned.saturation)
    assert 1 < learned.saturation < REPEATS
    assert best == pytest.approx(learned.score.mean(), rel=1e-9)
    assert best > score(learned.constant_power, np.inf)
    assert learned.constant_score.mean() == pytest.approx(score(learned.constant_power, np.inf), rel=1e-9)
    for power in np.geomspace(LEAST, MOST, 15):
        for saturation in (1.0, 1.5, 2.0, 3.0, REPEATS):
            assert score(power, saturation) <= best + 1e-6
    for factor in (0.98, 1.02):
        assert score(factor * learned.power, learned.saturation) < best
        assert score(learned.power, factor * learned.saturation) < best
        assert score(factor * learned.constant_power, np.inf) < score(learned.constant_power, np.inf)


def test_independent_taps_need_no_saturation(make_model):
    """Taps drawn from the model itself, more of them than sequences hold, count in full."""
    model = make_model(L=3, M=4, K=2, J=5, B=4, taps=40, seed=1)
    taps = draw_taps(model.grid, model.probabilities, model.edges, model.preprocessing, 150, 7)
    learned = learn_saturation(model, [taps], (1, 2, 5), 0)

    assert learned.power > 0.8
    assert learned.saturation > 4
    assert learned.score.mean() - learned.constant_score.mean() < 0.005


def test_one_number_of_contacts_asks_for_no_saturation(fitted, taps):
    """An exponent says all there is to say."""
    learned = learn_saturation(fitted["histogram"], [taps.select(taps.session == 1)], (1,), 0)

    assert learned.saturation == np.inf
    assert learned.power == learned.constant_power
    assert learned.score == learned.constant_score
    assert "and no cap learned on session 1:" in learned.sentence


def test_longer_sequences_than_a_class_has_taps_repeat_some(fitted, taps):
    """By the seed, and they score otherwise than each tap once."""
    held_out = [taps.select(taps.session == 1)]
    first, again, other = (learn_saturation(fitted["histogram"], held_out, (1, 9), seed) for seed in (0, 0, 1))
    whole = learn_saturation(fitted["histogram"], held_out, (1, REPEATS), 0)

    assert (first.power, first.saturation) == (again.power, again.saturation)
    assert first.score[1] != other.score[1]
    assert first.score[1] != whole.score[1]
    assert "over sequences of 1, 9 taps of a class" in first.sentence


def test_what_cannot_be_learned_from_is_refused(fitted, taps):
    model = fitted["histogram"]
    other = type(taps)(taps.dataset.assign(what_name=("what_class", ["cup", "ball"])))
    with pytest.raises(InputError, match="No held-out tap belongs to a trained class"):
        best_power(model, [other], 3, 0)
    with pytest.raises(InputError, match="No held-out tap belongs to a trained class"):
        learn_saturation(model, [])
    with pytest.raises(InputError, match="contacts must have at least one number of taps"):
        learn_saturation(model, [taps], ())
    with pytest.raises(InputError, match="taps must be at least 1, got 0"):
        learn_saturation(model, [taps], (1, 0))
    with pytest.raises(InputError, match="taps must be at least 1, got 0"):
        best_power(model, [taps], 0, 0)
    with pytest.raises(InputError, match="impossible under their own class"):
        learn_saturation(replace(model, pseudocount=0.0), [taps.select(taps.session == 2)])
