"""Beliefs that decisions use: to a power where evidence saturates, everywhere the same, and summed over states."""

from dataclasses import replace
from itertools import cycle, pairwise

import numpy as np
import pytest
from slow_cases import slow_but
from solidtouch.analysis.compare.classes import class_scores
from solidtouch.analysis.stats.contacts import accuracy
from solidtouch.hardware.replay import ReplayRig
from solidtouch.inference.engines.engine import make_engine
from solidtouch.inference.episode import perceive, steps
from solidtouch.inference.filter import fold, log_fold, share, temper
from solidtouch.inference.moves.control import fixation, passive
from solidtouch.inference.trials import gpu as device
from solidtouch.inference.trials.records import TapTable, TrialPlan, plan_trials, tap_table, trial_uniforms
from solidtouch.inference.trials.run import run_trials
from solidtouch.inference.trials.tally import tally_trials
from solidtouch.models.errors import InputError
from solidtouch.models.grid import tap_pool
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.settings import FitSettings, PlaySettings

L, M, TRIALS, DEADLINE, SEED = 5, 3, 14, 17, 6
THETAS = (0.9, 0.35, 1.0, 0.6, 0.0, 0.97)
SATURATIONS = (0.4, 1.0, 3.5, 9.0)
VARIANTS = [
    (0.0, "uniform"),
    (0.0, "clamp"),
    (0.3, "uniform_what"),
    (0.0, "prior"),
    (0.6, "circular"),
    (1.0, "uniform"),
]


@pytest.fixture(scope="module")
def taps(make_taps):
    """Taps of all classes, which lie near each other."""
    taps = make_taps(L, M, 4, 2, repeats=4, sessions=2)
    dataset = taps.dataset.copy(deep=True)
    dataset["taps"] *= 0.8
    return type(taps)(dataset)


@pytest.fixture(scope="module")
def models(taps):
    """A model without states and one with 21."""
    settings = FitSettings(bins=9, pseudocount=0.5, power=0.3, gain_sd=0.1, offset_sd=0.3)
    return {name: fit_model(name, taps, taps.grid(), settings).model for name in ("histogram", "session")}


@pytest.fixture(scope="module")
def plan():
    rng = np.random.default_rng(3)
    place, held, point = (rng.integers(n, size=TRIALS) for n in (L, M, L))
    return TrialPlan(place, held, point, rng.permutation(100)[:TRIALS], 0 * held)


def softmax(values):
    p = np.exp(values - values.max())
    return p / p.sum()


def rig_of(taps, model, where, what, stream):
    uniforms = trial_uniforms(SEED, stream, DEADLINE).tolist()
    return ReplayRig(taps, model.grid, int(where), int(what), iter(uniforms))


def test_the_share_falls_once_there_are_too_many_taps():
    """From there on the evidence of all taps together stays that of `saturation` of them."""
    assert [share(n, 2.5) for n in (0, 1, 2, 3, 10)] == [1, 1, 1, 2.5 / 3, 0.25]
    assert {share(n, np.inf) for n in (0, 1, 10**9)} == {1.0}
    assert share(1, 0.4) == 0.4


def test_a_tempered_belief_is_its_power_normalised(rng):
    """Impossible classes stay impossible, and at power 1 nothing is touched."""
    belief = rng.dirichlet(np.ones(6), size=4).reshape(4, 2, 3)
    belief[1, 0, 2] = 0.0
    with np.errstate(divide="ignore"):
        log_belief = np.log(belief)
    powers = belief**0.3

    np.testing.assert_allclose(
        np.exp(temper(log_belief, 0.3)), powers / powers.sum(axis=(1, 2), keepdims=True), rtol=1e-12
    )
    assert temper(log_belief, 1.0) is log_belief


@pytest.mark.parametrize("name", ["histogram", "session"])
@pytest.mark.parametrize("saturation", SATURATIONS)
def test_a_passive_belief_is_the_mean_evidence_counted_so_often(models, taps, name, saturation):
    """softmax(s_n (log prior + sum of log-likelihoods)), summed over the states, also before the next tap."""
    model = replace(models[name], saturation=saturation)
    made = list(steps(rig_of(taps, model, 1, 2, 5), make_engine("numpy", model), 1.0, passive(), 12))
    carried = model.log_prior
    for step in made:
        before = (
            softmax(min(1, saturation / max(step.number - 1, 1)) * carried) if step.number > 1 else softmax(carried)
        )
        carried = carried + model.log_likelihood(step.tap[np.newaxis])[0]
        after = softmax(min(1, saturation / step.number) * carried)
        states = after.reshape(L, -1, M)

        np.testing.assert_allclose(np.exp(step.log_belief), states.sum(axis=1), atol=1e-12)
        np.testing.assert_allclose(np.exp(step.log_state), states.sum(axis=(0, 2)), atol=1e-12)
        np.testing.assert_allclose(np.exp(step.log_predicted), before.reshape(L, -1, M).sum(axis=1), atol=1e-12)
    episode = perceive(rig_of(taps, model, 1, 2, 5), make_engine("filter", model), 1.0, passive(), 12)
    np.testing.assert_allclose(np.exp(episode.log_beliefs), [np.exp(step.log_belief) for step in made], atol=1e-12)


@pytest.mark.parametrize("saturation", [1.0, 3.5])
def test_what_is_carried_through_taps_and_moves_is_not_touched(models, taps, saturation):
    """An active belief is the power of what the engine says of the same taps and moves without a saturation."""
    model = replace(models["histogram"], saturation=saturation)
    engine = make_engine("numpy", models["histogram"], "clamp")
    made = list(steps(rig_of(taps, model, 0, 1, 7), make_engine("numpy", model, "clamp"), 1.0, fixation(3), 9))
    carried, _ = engine.update(model.log_prior, made[0].tap)
    for before, after in pairwise(made):
        carried, evidence = engine.update(engine.shift(carried, before.move), after.tap)
        np.testing.assert_allclose(
            np.exp(after.log_belief), softmax(share(after.number, saturation) * carried), atol=1e-12
        )
        assert after.log_evidence == evidence
    assert any(step.move for step in made[1:])


@pytest.mark.parametrize(
    ("saturation", "theta_x", "border"),
    slow_but(
        [(3.5, 0.0, "clamp"), (0.4, 0.3, "uniform_what"), (3.5, 0.0, "prior")],
        [*((saturation, *variant) for saturation, variant in zip(cycle([0.4, 3.5]), VARIANTS)), (3.5, *VARIANTS[0])],
    ),
)
def test_trials_are_episodes_on_the_same_taps(models, taps, plan, saturation, theta_x, border):
    """Every trial at every threshold is `perceive` with the numbers of its stream."""
    for name in ("histogram", "session")[: 1 if border == "prior" else 2]:
        model = replace(models[name], saturation=saturation)
        table = tap_table(model, taps)
        trials = run_trials(
            table, plan, THETAS, play=PlaySettings(theta_x=theta_x, border=border, deadline=DEADLINE), seed=SEED
        )
        engine = make_engine("filter", model, border)
        for i, (where, what, point, stream, _) in enumerate(zip(*plan, strict=True)):
            for h, theta in enumerate(THETAS):
                rig = rig_of(taps, model, where, what, stream)
                episode = perceive(rig, engine, theta, fixation(int(point), theta_x), DEADLINE)
                expected = (episode.taps, episode.what, episode.where, rig.where_index, episode.stopped)

                assert expected == tuple(field[i, h] for field in trials[:5])
                belief = np.exp(episode.log_beliefs[-1]).sum(axis=0).max()
                assert belief == pytest.approx(trials.belief[i, h], abs=1e-9)


def test_the_cases_above_are_not_trivial(models, taps, plan):
    """A saturation delays decisions, lowers beliefs and changes moves; some trials stop and some do not."""
    played = {
        saturation: run_trials(
            tap_table(replace(models["histogram"], saturation=saturation), taps),
            plan,
            THETAS,
            play=PlaySettings(theta_x=0.8, deadline=DEADLINE),
            seed=SEED,
        )
        for saturation in (*SATURATIONS, np.inf)
    }
    taps_taken = [trials.taps[:, 0].mean() for trials in played.values()]

    assert taps_taken == sorted(taps_taken, reverse=True)
    assert len(set(taps_taken)) > 3
    assert 0 < played[3.5].stopped[:, 0].mean() < 1
    assert played[1.0].belief[:, 2].mean() < played[9.0].belief[:, 2].mean() < played[np.inf].belief[:, 2].mean()
    assert (played[1.0].true_where[:, 2] != played[np.inf].true_where[:, 2]).any()


@pytest.mark.parametrize(
    ("saturation", "theta_x", "border"), slow_but([(3.5, 0.6, "clamp")], [(0.4, 0.0, "uniform"), (3.5, 0.6, "clamp")])
)
def test_arrays_decide_as_loops_do(monkeypatch, models, taps, plan, saturation, theta_x, border):
    """The code for graphics processors, in slots that are refilled."""
    pytest.importorskip("jax")
    monkeypatch.setitem(device._SLOTS, "cpu", 7)
    table = tap_table(replace(models["histogram"], saturation=saturation), taps)
    options = {"play": PlaySettings(theta_x=theta_x, border=border, deadline=DEADLINE), "seed": SEED}
    loops, arrays = (run_trials(table, plan, THETAS, device=name, **options) for name in ("cpu", "xla-cpu"))

    for name in loops._fields:
        compare = np.testing.assert_allclose if name == "belief" else np.testing.assert_array_equal
        compare(getattr(arrays, name), getattr(loops, name), err_msg=name)


@pytest.mark.parametrize("saturation", [DEADLINE, np.inf])
def test_a_saturation_that_no_trial_reaches_changes_no_bit(models, taps, plan, saturation):
    table = tap_table(models["histogram"], taps)
    plain, other = (
        run_trials(one, plan, THETAS, play=PlaySettings(theta_x=0.0, deadline=DEADLINE), seed=SEED)
        for one in (TapTable(*table[:3]), table._replace(saturation=float(saturation)))
    )

    for name in plain._fields:
        np.testing.assert_array_equal(getattr(other, name), getattr(plain, name), err_msg=name)


def test_tallies_are_of_the_same_trials(models, taps):
    table = tap_table(replace(models["histogram"], saturation=2.0), taps)
    counts = tally_trials(table, (0.6,), 200, play=PlaySettings(theta_x=0.0, deadline=DEADLINE), seed=SEED)
    trials = run_trials(
        table, plan_trials(table.pool, 200, SEED), (0.6,), play=PlaySettings(theta_x=0.0, deadline=DEADLINE), seed=SEED
    )

    assert counts.belief[0] == pytest.approx(trials.belief.sum())
    np.testing.assert_array_equal(counts.taps[0], np.bincount(trials.taps[:, 0], minlength=len(counts.taps[0])))


def test_classes_far_below_double_precision_come_back():
    """After n taps of 700 nats each against a class, its share of n0 = .001 taps is 0.7 nats below the others'."""
    log_likelihood = np.array([[[0.0, -700.0, -1400.0]], [[-700.0, 0.0, -1400.0]]])
    pool = tap_pool([0, 0], [0, 1], (1, 3))
    plan = TrialPlan(*(np.array([[0, 0], [0, 1], [0, 0], [0, 1], [0, 0]])))
    table = TapTable(log_likelihood, pool, np.log(np.full((1, 3), 1 / 3)), 1e-3)
    trials = run_trials(table, plan, (1.0,), play=PlaySettings(theta_x=1.0, deadline=30))
    expected = softmax(1e-3 * np.array([0.0, -700.0, -1400.0])).max()

    np.testing.assert_allclose(trials.belief[:, 0], expected, rtol=1e-12)
    assert trials.what[:, 0].tolist() == [0, 1]


def test_scores_after_contacts_are_of_beliefs_as_they_are_read(models, taps):
    """Of every tap once and of pairs; what is right does not depend on it where there are no states."""
    tables = {str(n): tap_table(replace(models["histogram"], saturation=n), taps) for n in (0.5, 1.0, np.inf)}
    scores = class_scores(tables, 0, (1, 2), resamples=1)
    table = tables["inf"]
    where, what = taps.indices(taps.grid())
    beliefs = np.array([softmax(0.5 * (table.log_prior + row)) for row in table.log_likelihood])
    score = scores["log_score_joint"]

    assert float(score.sel(model="0.5", contacts=1)) == pytest.approx(
        np.log(beliefs[np.arange(len(what)), where, what]).mean()
    )
    assert float(score.sel(model="1.0", contacts=1)) == float(score.sel(model="inf", contacts=1))
    assert float(score.sel(model="1.0", contacts=2)) != float(score.sel(model="inf", contacts=2))
    np.testing.assert_array_equal(scores["accuracy_joint"].sel(model="0.5"), scores["accuracy_joint"].sel(model="inf"))
    pairs = [accuracy(tables[name], 0, (2,))[0].hits[:, 0] for name in ("0.5", "inf")]
    np.testing.assert_array_equal(*pairs)


@pytest.mark.parametrize("saturation", [0.0, -1.0, np.nan])
def test_what_is_no_number_of_taps_is_refused(models, taps, plan, saturation):
    message = "saturation must be a positive number of taps"
    with pytest.raises(InputError, match=message):
        replace(models["session"], saturation=saturation)
    with pytest.raises(InputError, match=message):
        fit_model("gaussian", taps, taps.grid(), FitSettings(saturation=saturation))
    with pytest.raises(InputError, match=message):
        run_trials(
            tap_table(models["histogram"], taps)._replace(saturation=saturation),
            plan,
            THETAS,
            play=PlaySettings(theta_x=0.0),
        )


@pytest.mark.parametrize("states", [1, 4])
def test_states_of_an_object_add_up(rng, states):
    belief = rng.random((5, L, states * M))
    folded = np.zeros((5, L, M))
    for h in range(states * M):
        folded[:, :, h % M] += belief[:, :, h]

    np.testing.assert_allclose(fold(belief, M), folded)
    np.testing.assert_allclose(np.exp(log_fold(np.log(belief), M)), folded)
