"""Scores of models after fixed numbers of contacts, on tables whose answers are known or can be counted."""

import itertools

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import t
from solidtouch.analysis.compare.classes import (
    CALIBRATION_BINS,
    CALIBRATIONS,
    MEANS,
    _alike,
    _bins,
    _by_class,
    _draw,
    class_interval_sentence,
    class_scores,
)
from solidtouch.analysis.stats.contacts import accuracy
from solidtouch.analysis.stats.pairing import with_intervals
from solidtouch.inference.trials.records import TapTable
from solidtouch.inference.trials.resampling import Spread
from solidtouch.models.errors import InputError
from solidtouch.models.grid import tap_pool

L, M, S, N = 3, 2, 4, 90


def random_table(seed=0, states=1, skill=1.0, N=N):
    """Taps of all classes in turn under random likelihoods that speak for the true class; prior not flat."""
    rng = np.random.default_rng(seed)
    where, what = np.arange(N) % L, np.arange(N) // L % M
    log_likelihood = rng.normal(size=(N, L, states * M))
    log_likelihood[np.arange(N), where, what] += skill
    prior = rng.normal(size=(L, states * M))
    return TapTable(log_likelihood, tap_pool(where, what, (L, M)), prior - logsumexp(prior))


def labels(N=N):
    return np.arange(N) % L, np.arange(N) // L % M


@pytest.fixture
def tables():
    """Three models of the same taps; the last carries states."""
    return {"plain": random_table(0), "sharp": random_table(1, skill=2.0), "stateful": random_table(2, states=S)}


def brute_force(table, taps, where, what):
    """Every mean of one contact per tap, by loops over taps, classes and states in the linear domain."""
    rows = []
    for tap, l, m in zip(taps, where, what, strict=True):
        joint = np.zeros((L, M))
        for i in range(L):
            for h in range(table.log_prior.shape[1]):
                joint[i, h % M] += np.exp(table.log_prior[i, h] + table.log_likelihood[tap, i, h])
        joint /= joint.sum()
        truth = np.zeros((L, M))
        truth[l, m] = 1
        of_what, of_where = joint.sum(axis=0), joint.sum(axis=1)
        rows.append(
            {
                "log_score_joint": np.log(joint[l, m]),
                "log_score_what": np.log(of_what[m]),
                "brier_joint": ((joint - truth) ** 2).sum(),
                "brier_what": ((of_what - truth.sum(axis=0)) ** 2).sum(),
                "accuracy_joint": np.unravel_index(joint.argmax(), joint.shape) == (l, m),
                "accuracy_where": of_where.argmax() == l,
                "accuracy_what": of_what.argmax() == m,
                "impossible": joint[l, m] == 0,
                "no_class_left": False,
                "top_what": of_what.max(),
                "top_where": of_where.max(),
            }
        )
    return {key: np.array([row[key] for row in rows], dtype=float) for key in rows[0]}


def test_one_contact_scores_are_those_of_every_tap_by_brute_force(tables):
    """Means over all taps, with states summed out."""
    scores = class_scores(tables, seed=0, contacts=(1,), resamples=5)

    assert scores.log_score_joint.dims == ("model", "contacts")
    assert scores.sequences.item() == N
    for name, table in tables.items():
        expected = brute_force(table, np.arange(N), *labels())
        for key in MEANS:
            np.testing.assert_allclose(scores[key].sel(model=name).item(), expected[key].mean(), err_msg=key)


def test_the_calibration_error_is_the_distance_of_belief_and_accuracy_in_equal_bins(tables):
    """Nine taps a bin, of 90 by increasing belief."""
    scores = class_scores(tables, seed=0, contacts=(1,), resamples=5)
    expected = brute_force(tables["stateful"], np.arange(N), *labels())

    for part in ("what", "where"):
        order = np.argsort(expected[f"top_{part}"])
        gap = (expected[f"accuracy_{part}"] - expected[f"top_{part}"])[order].reshape(CALIBRATION_BINS, -1)
        value = scores[f"calibration_{part}"].sel(model="stateful").item()
        assert value == pytest.approx(np.abs(gap.mean(axis=1)).mean())


def test_identical_states_change_nothing(tables):
    """Whatever their prior: they tell nothing of the class."""
    table = tables["plain"]
    share = np.log([0.5, 0.3, 0.2])
    split = np.concatenate([table.log_prior + s for s in share], axis=1)
    same = table._replace(log_likelihood=np.tile(table.log_likelihood, (1, 1, 3)), log_prior=split)
    scores = class_scores({"plain": table, "split": same}, seed=3, contacts=(1, 4), resamples=20)

    for name in (*MEANS, *CALIBRATIONS):
        np.testing.assert_allclose(scores[f"{name}_difference"].sel(model="split"), 0.0, atol=1e-12)


def test_accuracy_of_one_contact_is_that_of_the_report(tables):
    """`contacts.accuracy` counts the same hits."""
    row = accuracy(tables["sharp"], seed=0, contacts=(1,))[0]
    scores = class_scores(tables, seed=0, contacts=(1,), resamples=5).sel(model="sharp")

    for i, part in enumerate(("joint", "where", "what")):
        assert scores[f"accuracy_{part}"].item() == pytest.approx(row.weight @ row.hits[:, i] / row.weight.sum())


def test_classes_count_by_their_taps():
    """Five taps of one class at one score, two of another at another, after one contact and after two."""
    where, what = np.array([0, 0, 0, 0, 0, 1, 1]), np.zeros(7, dtype=int)
    belief = np.where(where == 0, 0.8, 0.3)
    log_likelihood = np.log(np.stack([belief, 1 - belief], axis=1))[:, :, np.newaxis]
    table = TapTable(log_likelihood, tap_pool(where, what, (2, 1)), np.log(np.full((2, 1), 0.5)))
    scores = class_scores({"a": table}, seed=0, contacts=(1, 2), resamples=5)
    two = [np.log(0.64 / (0.64 + 0.04)), np.log(0.49 / (0.09 + 0.49))]

    np.testing.assert_allclose(
        scores.log_score_joint[0], [(5 * np.log(0.8) + 2 * np.log(0.7)) / 7, (5 * two[0] + 2 * two[1]) / 7]
    )
    assert scores.classes.values.tolist() == [2, 2]


def test_sequences_hold_distinct_taps_of_one_class_and_session():
    """And each session has its share of the draws."""
    where, what = labels()
    session = np.arange(N) // 54
    sequences = _draw(_by_class(tap_pool(where, what, (L, M)), session), 4, np.random.default_rng(0))

    assert all(len(set(row)) == 4 for row in sequences.taps)
    assert (where[sequences.taps] == sequences.where[:, np.newaxis]).all()
    assert (what[sequences.taps] == sequences.what[:, np.newaxis]).all()
    assert (np.ptp(session[sequences.taps], axis=1) == 0).all()
    np.testing.assert_allclose(np.bincount(sequences.where * M + sequences.what, sequences.weight), 15.0)
    share = np.bincount(session[sequences.taps[:, 0]], sequences.weight)
    np.testing.assert_allclose(share, np.bincount(session))


def test_without_sessions_sequences_mix_them():
    """Taps of class (0, 0) come from both ends of the recording."""
    sequences = _draw(_by_class(tap_pool(*labels(), (L, M)), np.zeros(N)), 4, np.random.default_rng(0))

    assert np.ptp(sequences.taps[(sequences.where == 0) & (sequences.what == 0)], axis=1).max() > 54


def test_numbers_of_contacts_that_too_few_classes_have_are_left_out(tables):
    """Fifteen taps a class, eight at most of one session."""
    session = np.arange(N) % 4 // 2
    assert class_scores(tables, 0, (30, 9, 1, 9), resamples=5).contacts.values.tolist() == [9, 1]
    parted = {name: table._replace(session=session) for name, table in tables.items()}
    assert class_scores(parted, 0, (1, 9), resamples=5).contacts.values.tolist() == [1]
    with pytest.raises(InputError, match="Too few classes have test taps for sequences of 16, 20 taps"):
        class_scores(tables, 0, (16, 20))


def test_what_is_drawn_for_one_number_does_not_depend_on_the_others(tables):
    """But on the seed."""
    alone, among, other = (
        class_scores(tables, seed, n, resamples=9).sel(contacts=4) for seed, n in ((0, (4,)), (0, (1, 4)), (1, (4,)))
    )

    assert alone.drop_vars("contacts").identical(among.drop_vars("contacts"))
    assert not np.allclose(alone.log_score_joint, other.log_score_joint)


def test_zero_beliefs_are_infinite_scores_and_stay_so(tables):
    """In the score, in resamples that hold the class, and in the difference; of two such models that is NaN."""
    impossible = tables["plain"].log_likelihood.copy()
    impossible[0, 0, 0] = -np.inf
    zero = tables["plain"]._replace(log_likelihood=impossible)
    scores = class_scores({"plain": tables["plain"], "zero": zero, "too": zero}, 0, (1,), resamples=400)
    scores = scores.isel(contacts=0).sel(model="zero")

    assert scores.log_score_joint.item() == -np.inf
    assert scores.log_score_joint_low.item() == -np.inf
    assert np.isfinite(scores.log_score_joint_high.item())
    assert scores.log_score_joint_difference.item() == -np.inf
    assert np.isfinite(scores.log_score_what.item())
    assert scores.impossible.item() == pytest.approx(1 / N)
    to_zero = class_scores(
        {"too": zero, "plain": tables["plain"], "zero": zero}, 0, (1,), resamples=40, reference="zero"
    )
    assert to_zero.log_score_joint_difference.values[:, 0].tolist()[1] == np.inf
    assert np.isnan(to_zero.log_score_joint_difference.sel(model=["too", "zero"])).all()


def test_taps_that_are_impossible_under_every_class_count_as_wrong_in_a_column_of_their_own(tables):
    """Nothing is believed: no score is NaN, the object is not right, the Brier score is that of no belief at all."""
    nowhere = tables["sharp"].log_likelihood.copy()
    nowhere[4] = -np.inf
    broken = tables["sharp"]._replace(log_likelihood=nowhere)

    scores = class_scores({"plain": tables["plain"], "broken": broken}, 0, (1,), resamples=20).sel(contacts=1)
    assert scores.no_class_left.values.tolist() == [0, pytest.approx(1 / N)]
    assert scores.impossible.values[1] >= 1 / N
    assert scores.log_score_joint.values[1] == -np.inf
    alone = class_scores({"nothing": tables["sharp"]._replace(log_likelihood=np.full_like(nowhere, -np.inf))}, 0, (1,))
    for name, value in (("accuracy_what", 0), ("accuracy_joint", 0), ("brier_joint", 1), ("brier_what", 1)):
        assert alone[name].item() == pytest.approx(value)
    assert alone.no_class_left_low.item() > 0.5


def test_long_sequences_stay_in_the_log_domain():
    """Twenty taps of 300 nats each: beliefs underflow, scores do not."""
    where = np.repeat([0, 1], 20)
    log_likelihood = np.zeros((40, 2, 1))
    log_likelihood[np.arange(40), 1 - where, 0] = 300.0
    table = TapTable(log_likelihood, tap_pool(where, 0 * where, (2, 1)), np.log(np.full((2, 1), 0.5)))
    scores = class_scores({"wrong": table}, 0, (20,), resamples=5)

    assert scores.log_score_joint.item() == pytest.approx(-6000.0)
    assert scores.impossible.item() == 0


def test_intervals_are_those_of_taps_drawn_anew_within_classes(tables):
    """Accuracies of six classes, 15 taps each, resampled here by loops; wider by 15 over 14 in variance."""
    scores = class_scores({"plain": tables["plain"]}, seed=0, contacts=(1,), resamples=1500)
    scores = scores.sel(model="plain").isel(contacts=0)
    hits = brute_force(tables["plain"], np.arange(N), *labels())["accuracy_joint"]
    where, what = labels()
    by_class = [hits[(where == l) & (what == m)] for l in range(L) for m in range(M)]
    rng = np.random.default_rng(5)
    means = sum(own[rng.integers(15, size=(20000, 15))].mean(axis=1) for own in by_class) / 6

    low, high = hits.mean() + np.sqrt(15 / 14) * (np.quantile(means, [0.025, 0.975]) - means.mean())
    assert scores.accuracy_joint_low.item() == pytest.approx(low, abs=0.015)
    assert scores.accuracy_joint_high.item() == pytest.approx(high, abs=0.015)
    assert high - low > 0.15


def test_sessions_are_drawn_anew_where_several_test():
    """Taps that agree within their session leave a mean as unsure as that of three sessions; as one, far less."""
    rng = np.random.default_rng(3)
    where, session = np.tile([0, 1], 30), np.repeat([0, 1, 2], 20)
    belief = np.array([0.9, 0.6, 0.4])[session] + 0.01 * rng.random(60)
    log_likelihood = np.log(np.stack([np.where(where == i, belief, 1 - belief) for i in (0, 1)], axis=1))[:, :, None]
    table = TapTable(log_likelihood, tap_pool(where, 0 * where, (2, 1)), np.log(np.full((2, 1), 0.5)))
    widths = []
    for one in (table, table._replace(session=session)):
        scores = class_scores({"a": one}, 0, (1,), resamples=400).isel(contacts=0, model=0)
        widths.append(float(scores.log_score_joint_high - scores.log_score_joint_low))

    assert widths[1] > 2 * widths[0]


def test_a_resample_without_enough_taps_is_undefined():
    """Two sessions of which one has too few for six taps: a sixth of the resamples hold only that one."""
    where, session = np.tile([0, 1], 22), np.repeat([0, 1], 22)
    table = TapTable(
        np.random.default_rng(0).normal(size=(44, 2, 1)),
        tap_pool(where, 0 * where, (2, 1)),
        np.log(np.full((2, 1), 0.5)),
        session=np.where(session == 1, 1, 0),
    )
    short = table._replace(session=np.where(np.arange(44) < 40, 0, 1))
    for one, defined in ((table, True), (short, False)):
        scores = class_scores({"a": one}, 0, (6, 1), resamples=80).isel(model=0)
        assert scores.contacts.values.tolist() == [6, 1]
        assert np.isfinite(scores.log_score_joint).all()
        assert np.isfinite(scores.log_score_joint_low).values.tolist() == [defined, True]


def test_differences_pair_over_taps():
    """A model that is better by the same score for every tap differs from another without any spread."""
    where = np.repeat([0, 1, 2], 5)
    belief = np.tile([0.1, 0.3, 0.5, 0.7, 0.9], 3)

    def table(belief):
        log_likelihood = np.log(np.repeat(((1 - belief) / 2)[:, np.newaxis, np.newaxis], 3, axis=1))
        log_likelihood[np.arange(15), where, 0] = np.log(belief)
        return TapTable(log_likelihood, tap_pool(where, 0 * where, (3, 1)), np.full((3, 1), -np.log(3)))

    scores = class_scores({"half": table(belief / 2), "all": table(belief)}, 0, (1,), reference="all", resamples=50)
    half = scores.sel(model="half").isel(contacts=0)

    assert half.log_score_joint_high - half.log_score_joint_low > 0.4
    for suffix in ("", "_low", "_high"):
        assert half[f"log_score_joint_difference{suffix}"].item() == pytest.approx(-np.log(2))
    assert scores.attrs["reference"] == "all"


def test_the_interval_of_a_calibration_error_reaches_down_to_none():
    """Resampling noise alone cannot make a calibrated model look miscalibrated; a plain percentile interval would."""
    samples = np.concatenate([[0.04], 0.057 + 0.01 * np.linspace(-2, 2, 99)])[np.newaxis]
    biased = with_intervals("x", samples, ("model",), 0, {}, Spread(1.0), biased=True)
    plain = with_intervals("x", samples, ("model",), 0, {}, Spread(1.0))

    assert plain.x_low.item() == pytest.approx(0.04 - 1.98 * 0.0117, abs=1e-3)
    assert plain.x_high.item() == pytest.approx(0.04 + 1.98 * 0.0117, abs=1e-3)
    assert biased.x_low.item() == pytest.approx(plain.x_low.item() - 0.017)
    assert biased.x_high.item() == plain.x_high.item()


def test_equal_beliefs_share_a_calibration_bin():
    """Otherwise the order of the file would decide."""
    bins = _bins(*_alike(np.array([[1.0, 0.2, 1.0, 0.4, 1.0, 1.0]]).T), np.ones(6))

    assert len(set(bins[[0, 2, 4, 5]])) == 1
    assert bins[1] < bins[3] < bins[0]
    assert _bins(*_alike(np.full((7, 1), 0.5)), np.ones(7)).tolist() == [CALIBRATION_BINS // 2] * 7


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda _: {}, "No model to compare"),
        (lambda t: {**t, "other": random_table(0, N=60)}, "'plain' and 'other' have different test taps"),
        (
            lambda t: {"odd": t["plain"]._replace(log_prior=np.zeros((L, M + 1)))},
            r"model 'odd' has likelihoods of shape \(90, 3, 2\) and a prior of shape \(3, 3\)",
        ),
    ],
)
def test_tables_that_cannot_be_compared_are_refused(tables, change, message):
    """By name."""
    with pytest.raises(InputError, match=message):
        class_scores(change(tables), 0)


def test_bad_arguments_are_refused(tables):
    """Each in a sentence."""
    with pytest.raises(InputError, match="'none' is not one of the models plain, sharp, stateful"):
        class_scores(tables, 0, reference="none")
    with pytest.raises(InputError, match="at least one resample, got 0"):
        class_scores(tables, 0, resamples=0)
    with pytest.raises(InputError, match="at least one contact, got 0"):
        class_scores(tables, 0, contacts=(0,))


def test_the_sentence_says_what_the_intervals_hold():
    """What is drawn anew."""
    assert "a quarter of the test taps of each class, or one test session at a time" in class_interval_sentence()


def test_a_difference_is_told_from_none_and_two_that_never_erred_are_not():
    """Of 50 decisions each: an error of a half against a quarter, and none against none."""
    rng = np.random.default_rng(0)
    shares = np.array([[0.25], [0.5], [0.0], [0.0]]) + np.array([[0.01], [0.01], [0.0], [0.0]]) * rng.normal(
        size=(4, 60)
    )
    options = {"limits": (0.0, 1.0), "independent": 50.0}
    one = with_intervals("x", shares[:2], ("model",), 0, {}, Spread(1.0), **options)
    none = with_intervals("x", shares[2:], ("model",), 0, {}, Spread(1.0), **options)

    assert 0.1 < one.x_difference_low[1] < one.x_difference[1] < one.x_difference_high[1] < 0.4
    margin = t.isf(0.025, 58) * np.sqrt(2) / 50
    assert none.x_difference_high.values.tolist() == pytest.approx([0, margin])
    assert none.x_difference_low.values.tolist() == pytest.approx([0, -margin])


@pytest.mark.parametrize(("n", "few"), [(100, True), (1000, False)])
def test_few_errors_leave_one_more_in_doubt(n, few):
    """Of 100 decisions 2 and 4 are wrong in every resample alike, or of 1000 20 and 40: then only the former count."""
    share = np.array([[0.02], [0.04]])
    deviation = np.tile([-1, 1], 30) * np.sqrt(share * (1 - share) / n * 59 / 60)
    samples = np.concatenate([share, share + deviation], axis=1)
    data = with_intervals("x", samples, ("model",), 0, {}, Spread(1.0), limits=(0.0, 1.0), independent=float(n))
    alone = Spread(1.0).interval(samples[1] - samples[0])
    margin = t.isf(0.025, 59) * np.sqrt(2) / n

    wider = np.hypot((alone[1] - alone[0]) / 2, margin if few else 0.0)
    assert data.x_difference_high[1].item() == pytest.approx(0.02 + wider, rel=1e-3)
    assert data.x_difference_low[1].item() == pytest.approx(0.02 - wider, rel=1e-3)


def test_beliefs_that_differ_by_rounding_share_a_bin():
    """Otherwise the order of sums would decide how many of the most certain beliefs each bin holds."""
    belief, weight = np.random.default_rng(0).choice([0.2, 1.0], size=500), np.ones(500)
    rounded = belief + np.random.default_rng(1).choice([-(2.0**-53), 0.0, 2.0**-52], size=500)

    alike = _alike(np.stack([rounded, belief], axis=1))
    np.testing.assert_array_equal(_bins(alike[0], weight), _bins(alike[1], weight))


def test_steps_are_differences_to_the_next_smaller_model(rng):
    """With the ends that it has as the reference; none of the smallest, nor where a value is missing."""
    samples = rng.normal(size=(4, 3, 21)) * 0.1 + rng.permuted(np.tile(np.arange(4.0)[:, None], 3), axis=0)[..., None]
    samples[2, 0] = np.nan
    found = with_intervals("x", samples, ("model", "n"), 0, {}, Spread(1.0), steps=True)
    for n in range(3):
        order = [int(m) for m in np.argsort(samples[:, n, 0]) if np.isfinite(samples[m, n, 0])]
        assert np.isnan(found.x_step.values[order[0], n])
        for below, above in itertools.pairwise(order):
            alone = with_intervals("x", samples, ("model", "n"), below, {}, Spread(1.0))
            for end in ("", "_low", "_high"):
                wanted = alone[f"x_difference{end}"].values[above, n]
                assert found[f"x_step{end}"].values[above, n] == pytest.approx(wanted)
    assert np.isnan(found.x_step_low.values[2, 0])
    assert set(with_intervals("x", samples, ("model", "n"), 0, {}, Spread(1.0))) == {
        name for name in found if "step" not in str(name)
    }
