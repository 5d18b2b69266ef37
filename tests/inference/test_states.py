"""Beliefs over object and state of the episode, against a filter over (where, what, state) written out in loops."""

from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np
import pytest
from numbered_taps import NumberedTaps
from slow_cases import slow_but
from solidtouch.hardware.replay import ReplayRig
from solidtouch.inference import reference
from solidtouch.inference.engines.compiled import FilterEngine, likelihoods
from solidtouch.inference.engines.shadow import EnginesDisagree, ShadowEngine
from solidtouch.inference.episode import perceive, steps
from solidtouch.inference.filter import fold, log_fold
from solidtouch.inference.moves.control import fixation
from solidtouch.inference.reference import BORDERS
from solidtouch.inference.trials.records import TapTable, TrialPlan, plan_trials, tap_table, trial_uniforms
from solidtouch.inference.trials.run import run_trials
from solidtouch.inference.trials.tally import tally, tally_trials
from solidtouch.models.errors import InputError
from solidtouch.models.settings import PlaySettings

L, M, S, N = 5, 2, 3, 40
TRIALS, DEADLINE, SEED = 40, 13, 6
THETAS = (0.9, 0.6, 1.0, 0.97)
ALLOWED = [border for border in BORDERS if border != "prior"]
DEVICES = ["cpu", "xla-cpu"]
LAWS = [*((border, "cpu") for border in ALLOWED), ("uniform", "xla-cpu")]
"""Arrays are compiled for every border, and are compared with loops in all of them."""


def hypotheses(values):
    """Arrays with the axes (..., L, M, S) as (..., L, S M)."""
    return np.swapaxes(values, -1, -2).reshape(*values.shape[:-2], -1)


def naive_shift(belief, delta, border):
    """Where a belief (L, M, S) goes in a move: each state for itself."""
    moved = np.zeros_like(belief)
    for s in range(belief.shape[2]):
        lost, vacated = np.zeros(M), [l for l in range(L) if not 0 <= l - delta < L]
        for m in range(M):
            for l in range(L):
                target = (l + delta) % L if border == "circular" else l + delta
                if border == "clamp":
                    target = min(max(target, 0), L - 1)
                if 0 <= target < L:
                    moved[target, m, s] += belief[l, m, s]
                else:
                    lost[m] += belief[l, m, s]
        for m in range(M):
            for l in vacated:
                if border == "uniform":
                    moved[l, m, s] = lost.sum() / (len(vacated) * M)
                elif border == "uniform_what":
                    moved[l, m, s] = lost[m] / len(vacated)
    return moved


def shift_states(log_belief, delta, border):
    """Each state moved by the reference and brought back to the belief that it had, in logs of shape (L, S M)."""
    states = [log_belief[:, s * M : (s + 1) * M] for s in range(S)]
    return np.hstack([reference.shift_log(of, delta, border) + np.logaddexp.reduce(of.ravel()) for of in states])


def naive_trial(case, where, what, target, stream, session, theta_x, border):
    """One trial at `THETAS`: rows of (taps, what, where, true where, stopped, belief)."""
    belief, at, rows = case.prior, int(case.table.pool.nearest[session, where, what]), {}
    for number, uniform in enumerate(trial_uniforms(SEED, stream, DEADLINE), start=1):
        belief = belief * case.likelihood[case.table.pool.pick(at, what, uniform, session)]
        belief = belief / belief.sum()
        whats, wheres = belief.sum(axis=(0, 2)), belief.sum(axis=(1, 2))
        for theta in THETAS:
            over = theta < 1 and whats.max() > theta
            if theta not in rows and (over or number == DEADLINE):
                rows[theta] = (number, whats.argmax(), wheres.argmax(), at, over, whats.max())
        if wheres.max() > theta_x:
            delta = int(target - wheres.argmax())
            belief = naive_shift(belief, delta, border)
            at = int(case.table.pool.nearest[session, min(max(at + delta, 0), L - 1), what])
    return [rows[theta] for theta in THETAS]


class Case:
    """Taps, P(tap | where, what, state) of shape (N, L, M, S), a prior (L, M, S), and the same as model and table."""

    def __init__(self):
        rng = np.random.default_rng(0)
        self.where, self.what = rng.integers(L, size=N), rng.integers(M, size=N)
        self.likelihood = rng.gamma(0.8, size=(N, L, M, S))
        self.prior = rng.dirichlet(np.ones(L * M * S)).reshape(L, M, S)
        self.model = NumberedTaps(np.log(hypotheses(self.likelihood)), np.log(hypotheses(self.prior)), M)
        self.taps = self.model.taps_of(self.where, self.what)
        self.table = tap_table(self.model, self.taps)
        held = rng.permutation(60)[:TRIALS]
        self.plan = TrialPlan(rng.integers(L, size=TRIALS), held % M, rng.integers(L, size=TRIALS), held, 0 * held)

    def state(self, s):
        """The table of one state alone."""
        prior = self.prior[..., s] / self.prior[..., s].sum()
        return TapTable(np.log(self.likelihood[..., s]), self.table.pool, np.log(prior))

    def play(self, table=None, theta_x=0.0, border="uniform", device="cpu"):
        return run_trials(
            self.table if table is None else table,
            self.plan,
            THETAS,
            play=PlaySettings(theta_x=theta_x, border=border, deadline=DEADLINE),
            seed=SEED,
            device=device,
        )


@pytest.fixture(scope="module")
def case():
    return Case()


@pytest.fixture(scope="module")
def naive(case):
    """The trials of the plan in loops, each variant once; one array per column of a row, shape (n, H)."""

    @cache
    def run(theta_x, border):
        rows = [naive_trial(case, *(int(v) for v in row), theta_x, border) for row in zip(*case.plan, strict=True)]
        return dict(
            zip(("taps", "what", "where", "true_where", "stopped", "belief"), np.moveaxis(rows, -1, 0), strict=True)
        )

    return run


def assert_same(expected, actual, tolerance):
    for name in expected._fields:
        within = tolerance if name == "belief" else 0.0
        np.testing.assert_allclose(getattr(actual, name), getattr(expected, name), rtol=0, atol=within, err_msg=name)


@pytest.mark.parametrize("border", ALLOWED)
def test_the_filter_is_bayes_rule_over_where_what_and_state(case, border):
    """Taps and moves of any length, also right out of the range, to 1e-10; evidence too."""
    engine, rng = FilterEngine(case.model, border), np.random.default_rng(1)
    log_belief, belief = case.model.log_prior, case.prior
    for t in range(60):
        tap = int(rng.integers(N))
        log_belief, log_evidence = engine.update(log_belief, [[float(tap)]])
        belief = belief * case.likelihood[tap]
        assert log_evidence == pytest.approx(np.log(belief.sum()), abs=1e-10)
        belief = belief / belief.sum()
        np.testing.assert_allclose(np.exp(log_belief), hypotheses(belief), rtol=0, atol=1e-10)
        delta = t % (2 * L + 3) - L - 1
        log_belief, belief = engine.shift(log_belief, delta), naive_shift(belief, delta, border)
        np.testing.assert_allclose(np.exp(log_belief), hypotheses(belief), rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    ("theta_x", "border", "device"),
    slow_but(
        [(0.0, "uniform", "cpu"), (0.0, "clamp", "cpu"), (0.0, "uniform_what", "xla-cpu"), (0.4, "uniform", "xla-cpu")],
        [
            *((0.0, border, "cpu") for border in ALLOWED),
            *((0.0, border, "xla-cpu") for border in ("uniform", "uniform_what", "clamp", "circular")),
            *((0.4, "uniform", device) for device in DEVICES),
            (1.0, "clamp", "cpu"),
        ],
    ),
)
def test_trials_are_those_of_the_filter_in_loops(case, naive, theta_x, border, device):
    """Decisions are the same, beliefs in them to 1e-10."""
    trials, expected = case.play(theta_x=theta_x, border=border, device=device), naive(theta_x, border)

    for name, values in expected.items():
        within = 1e-10 if name == "belief" else 0.0
        np.testing.assert_allclose(getattr(trials, name), values, rtol=0, atol=within, err_msg=name)


def test_the_trials_above_are_not_trivial(case, naive):
    """Some stop and some do not, both objects are decided, and borders and the state make a difference."""
    runs = [naive(0.0, border) for border in ALLOWED]
    alone = case.play(case.state(0))

    assert 0.1 < runs[0]["stopped"][:, 0].mean() < 1
    assert set(runs[0]["what"][:, 0]) == {0, 1}
    assert len({tuple(run["belief"][:, 2]) for run in runs}) == len(ALLOWED)
    assert (alone.what[:, 0] != runs[0]["what"][:, 0]).mean() > 0.1


@pytest.mark.parametrize("border", ALLOWED)
def test_steps_show_the_belief_summed_over_states(case, border):
    """Before and after each tap; the states' own belief beside it; and moves and decisions are made on the sums."""
    engine, moves, decisions = FilterEngine(case.model, border), set(), set()
    for where, what, target, stream, _ in zip(*(column[:8] for column in case.plan), strict=True):
        rig = ReplayRig(case.taps, case.model.grid, where, what, iter(trial_uniforms(SEED, stream, DEADLINE)))
        belief = case.prior
        for step in steps(rig, engine, 0.97, fixation(int(target)), DEADLINE):
            np.testing.assert_allclose(np.exp(step.log_predicted), belief.sum(axis=2), rtol=0, atol=1e-10)
            belief = belief * case.likelihood[int(step.tap[0, 0])]
            assert step.log_evidence == pytest.approx(np.log(belief.sum()), abs=1e-10)
            belief = belief / belief.sum()
            whats, wheres = belief.sum(axis=(0, 2)), belief.sum(axis=(1, 2))
            np.testing.assert_allclose(np.exp(step.log_belief), belief.sum(axis=2), rtol=0, atol=1e-10)
            np.testing.assert_allclose(np.exp(step.log_state), belief.sum(axis=(0, 1)), rtol=0, atol=1e-10)
            np.testing.assert_allclose(step.what_marginal, whats, rtol=0, atol=1e-10)
            assert (step.what, step.where) == (whats.argmax(), wheres.argmax())
            assert step.decision == (whats.argmax() if whats.max() > 0.97 else None)
            decisions.add(step.decision)
            if step.move is not None:
                assert step.move == target - wheres.argmax()
                moves.add(step.move)
                belief = naive_shift(belief, step.move, border)

    assert len(moves) > 4
    assert decisions == {None, 0, 1}


def test_episodes_are_the_trials(case):
    """Reaction time, decisions, places and beliefs of every trial; beliefs of an episode have the shape (T, L, M)."""
    trials, engine, differ = case.play(), FilterEngine(case.model), 0
    for i, (where, what, target, stream, _) in enumerate(zip(*case.plan, strict=True)):
        rig = ReplayRig(case.taps, case.model.grid, where, what, iter(trial_uniforms(SEED, stream, DEADLINE)))
        episode = perceive(rig, engine, THETAS[0], fixation(int(target)), DEADLINE)
        belief = np.exp(episode.log_beliefs)
        found = (episode.taps, episode.what, episode.where, rig.where_index, episode.stopped)
        expected = (trials.taps, trials.what, trials.where, trials.true_where, trials.stopped)
        assert found == tuple(field[i, 0] for field in expected)
        assert belief.shape == (episode.taps, L, M)
        np.testing.assert_allclose(belief.sum(axis=(1, 2)), 1.0, rtol=1e-12)
        assert belief[-1].sum(axis=0).max() == pytest.approx(trials.belief[i, 0], abs=1e-10)
        differ += episode.taps > 1
    assert differ > TRIALS / 2


def test_without_states_steps_hold_the_engines_belief(case):
    """Unchanged, and one zero for the state."""
    table = case.state(1)
    engine = FilterEngine(NumberedTaps(table.log_likelihood, table.log_prior, M))
    rig = ReplayRig(case.taps, case.model.grid, 2, 0, iter(trial_uniforms(SEED, 1, 3)))
    log_belief = table.log_prior
    for step in steps(rig, engine, 1.0, fixation(2), 3):
        np.testing.assert_array_equal(step.log_predicted, log_belief)
        log_belief, _ = engine.update(log_belief, step.tap)
        np.testing.assert_array_equal(step.log_belief, log_belief)
        assert step.log_state.tolist() == [0.0]
        log_belief = engine.shift(log_belief, step.move or 0)


@pytest.mark.parametrize(
    ("border", "device"), slow_but([("uniform", "cpu"), ("clamp", "cpu"), ("uniform", "xla-cpu")], LAWS)
)
def test_states_with_the_same_likelihoods_change_nothing(case, border, device):
    """Whatever is believed of them at first."""
    alone, states = case.state(0), np.log([0.2, 0.7, 0.1])
    log_prior = (states[:, np.newaxis] + alone.log_prior[:, np.newaxis, :]).reshape(L, S * M)
    copies = TapTable(np.tile(alone.log_likelihood, S), alone.pool, log_prior)

    expected, actual = (case.play(table, border=border, device=device) for table in (alone, copies))
    assert_same(expected, actual, 1e-12)
    assert 0.1 < expected.stopped[:, 0].mean() < 1


@pytest.mark.parametrize(("border", "device"), LAWS)
@pytest.mark.parametrize("s", range(S))
def test_a_state_that_is_certain_is_the_model_of_that_state(case, border, device, s):
    """The others count as little as if they were not there."""
    alone = case.state(s)
    log_prior = np.full((L, S * M), -np.inf)
    log_prior[:, s * M : (s + 1) * M] = alone.log_prior

    actual = case.play(case.table._replace(log_prior=log_prior), border=border, device=device)
    assert_same(case.play(alone, border=border, device=device), actual, 1e-12)


@pytest.mark.parametrize("border", ALLOWED)
def test_moves_leave_the_belief_in_the_states_alone(case, border):
    """However far apart the states are; within each, what was lost is spread as the border says."""
    rng = np.random.default_rng(3)
    for depth in (1.0, 40.0, 900.0, 1e4):
        log_belief = -depth * rng.exponential(size=(L, S * M))
        log_belief -= np.logaddexp.reduce(log_belief.ravel())
        for delta in (-L - 2, -L, -3, -1, 1, 2, L + 1):
            moved = FilterEngine(case.model, border).shift(log_belief, delta)
            np.testing.assert_allclose(moved, shift_states(log_belief, delta, border), rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize(
    ("depth", "border"),
    slow_but(
        [(3.0, "uniform"), (400.0, "clamp"), (1e4, "uniform_what"), (1e4, "circular")],
        list(product([3.0, 400.0, 1e4], ALLOWED)),
    ),
)
def test_states_come_back_from_any_depth(case, border, depth):
    """Compiled trials of hundreds of taps whose states lie worlds apart decide as sums of logarithms do."""
    rng = np.random.default_rng(4)
    log_likelihood = -depth * rng.exponential(size=(N, L, S * M))
    log_likelihood -= depth * rng.exponential(size=(N, 1, S)).repeat(M, axis=2)
    table, deadline = case.table._replace(log_likelihood=log_likelihood), 300
    plan = TrialPlan(*(column[:6] for column in case.plan))
    trials = run_trials(
        table, plan, (1.0,), play=PlaySettings(theta_x=0.0, border=border, deadline=deadline), seed=SEED
    )
    leaders = set()
    for i, (where, what, target, stream, _) in enumerate(zip(*plan, strict=True)):
        log_belief, at = table.log_prior, int(table.pool.nearest[0, where, what])
        for number, uniform in enumerate(trial_uniforms(SEED, stream, deadline), start=1):
            log_belief, _ = reference.update_log(log_belief, log_likelihood[table.pool.pick(at, what, uniform)])
            belief = np.exp(log_belief).reshape(L, S, M)
            if number < deadline:
                leaders.add(int(belief.sum(axis=(0, 2)).argmax()))
                delta = int(target - belief.sum(axis=(1, 2)).argmax())
                log_belief = shift_states(log_belief, delta, border)
                at = int(table.pool.nearest[0, min(max(at + delta, 0), L - 1), what])
        assert (trials.what[i, 0], trials.true_where[i, 0]) == (belief.sum(axis=(0, 1)).argmax(), at)
        assert trials.where[i, 0] == belief.sum(axis=(1, 2)).argmax()
        assert trials.belief[i, 0] == pytest.approx(belief.sum(axis=(0, 1)).max(), abs=1e-10)
    assert likelihoods(log_likelihood).wide.any() == (depth > 3)
    assert len(leaders) == S


def test_tallies_count_objects_not_hypotheses(case):
    """As `run_trials` on the same plan."""
    options = {"play": PlaySettings(theta_x=0.0, deadline=DEADLINE), "seed": SEED}
    counts = tally_trials(case.table, THETAS, TRIALS, fixation=1, **options)
    plan = plan_trials(case.table.pool, TRIALS, SEED, fixation=1)
    expected = tally(run_trials(case.table, plan, THETAS, **options), plan, (L, M))

    assert counts.what.shape == (len(THETAS), M, M)
    for name, values in expected._asdict().items():
        np.testing.assert_allclose(getattr(counts, name), values, rtol=1e-12, err_msg=name)


def test_engines_that_disagree_name_the_object(case):
    """Of a hypothesis of any state."""

    @dataclass(frozen=True)
    class Skewed:
        model: object
        name: str = "skewed"

        def update(self, log_belief, tap):
            posterior, evidence = FilterEngine(self.model).update(log_belief, tap)
            skewed = posterior.copy()
            skewed[3, 2 * M + 1] += 0.1
            return skewed, evidence

        def shift(self, log_belief, delta):
            return FilterEngine(self.model).shift(log_belief, delta)

    shadow = ShadowEngine(FilterEngine(case.model), Skewed(case.model))
    with pytest.raises(EnginesDisagree, match=r"after tap 1: belief in object 1 at 4\.5 mm is 0\.\d+ by filter"):
        shadow.update(case.model.log_prior, [[7.0]])


def test_a_shadow_follows_the_states_through_an_episode(case):
    """It goes on from its own beliefs in the states, and the first one's answers count bit by bit."""
    engine, answers, given = FilterEngine(case.model), [case.model.log_prior], []

    class Second:
        model, name = case.model, "second"

        def update(self, log_belief, tap):
            given.append(log_belief)
            posterior, evidence = engine.update(log_belief, tap)
            answers.append(posterior)
            return posterior, evidence

        def shift(self, log_belief, delta):
            given.append(log_belief)
            answers.append(engine.shift(log_belief, delta).copy())
            return answers[-1]

    def episode(engine):
        rig = ReplayRig(case.taps, case.model.grid, 0, 1, iter(trial_uniforms(SEED, 9, DEADLINE)))
        return perceive(rig, engine, 1.0, fixation(3), DEADLINE)

    alone, followed = episode(engine), episode(ShadowEngine(engine, Second()))
    np.testing.assert_array_equal(alone.log_beliefs, followed.log_beliefs)
    assert alone.moves.any()
    assert len(given) == 2 * DEADLINE - 1
    assert all(got is answered for got, answered in zip(given[1:], answers[1:-1], strict=True))


@pytest.mark.parametrize("device", DEVICES)
def test_a_tap_that_no_state_can_give_leaves_no_class(case, device):
    """One that some state can give is none."""
    possible = case.table.log_likelihood.copy()
    possible[:, :, :-1] = -np.inf
    impossible = np.full_like(possible, -np.inf)

    assert (case.play(case.table._replace(log_likelihood=possible), device=device).what == M - 1).all()
    assert case.play(case.table._replace(log_likelihood=impossible), device=device).no_class_left.all()


REFUSED = "border 'prior' does not support models that carry a state"


def test_the_border_that_knows_no_states_is_refused(case):
    """By the engine, by trials and by tallies; without states it is not."""
    alone = case.state(2)
    with pytest.raises(InputError, match=REFUSED):
        FilterEngine(case.model, "prior")
    for device in DEVICES:
        with pytest.raises(InputError, match=REFUSED):
            case.play(border="prior", device=device)
    with pytest.raises(InputError, match=REFUSED):
        tally_trials(case.table, THETAS, 3, play=PlaySettings(theta_x=0.0, border="prior"))

    assert case.play(alone, border="prior").taps.shape == (TRIALS, len(THETAS))
    assert FilterEngine(NumberedTaps(alone.log_likelihood, alone.log_prior, M), "prior").border == "prior"


@pytest.mark.parametrize("columns", [1, S * M - 1, S * M + M])
def test_tables_whose_parts_do_not_fit_are_refused(case, columns):
    """A prior over other hypotheses than the likelihoods', or over part of a state."""
    prior = np.full((L, columns), -np.log(L * columns))
    with pytest.raises(InputError, match=rf"prior \(5, {columns}\), .* of a tap \(5, 6\), classes \(5, 2\)"):
        case.play(case.table._replace(log_prior=prior))
    part = TapTable(np.zeros((N, L, M + 1)), case.table.pool, np.full((L, M + 1), -np.log(L * (M + 1))))
    with pytest.raises(InputError, match=r"prior \(5, 3\)"):
        case.play(part)


def test_folding_sums_over_states():
    """Total and place stay, hypothesis s M + m goes to object m, and logs fold as what they are logs of."""
    rng = np.random.default_rng(5)
    belief = rng.random((4, L, S * M))
    belief[:, 1] = 0.0
    folded = fold(belief, M)
    with np.errstate(divide="ignore"):
        logs = np.log(belief)

    assert folded.shape == (4, L, M)
    np.testing.assert_allclose(folded[2, 3, 1], belief[2, 3, 1] + belief[2, 3, 3] + belief[2, 3, 5])
    np.testing.assert_allclose(folded.sum(axis=2), belief.sum(axis=2))
    np.testing.assert_allclose(np.exp(log_fold(logs, M)), folded)
    np.testing.assert_allclose(log_fold(logs - 1e4, M), log_fold(logs, M) - 1e4)
    assert np.isneginf(log_fold(logs, M)[:, 1]).all()
    assert fold(folded, M) is folded
    assert log_fold(logs, S * M) is logs
