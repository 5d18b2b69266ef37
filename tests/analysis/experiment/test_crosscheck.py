"""The comparison of all routes: it passes on right ones and fails on wrong ones."""

import numpy as np
import pytest
from slow_cases import slow_but
from solidtouch.analysis.experiment import trial_check
from solidtouch.analysis.experiment.crosscheck import STORY, crosscheck_model
from solidtouch.hardware.simulator.model_rig import draw_taps
from solidtouch.inference.engines import compiled as bayes
from solidtouch.inference.engines import engine as numpy_engine
from solidtouch.inference.engines import enumeration
from solidtouch.inference.engines.enumeration import SequencePosterior, SequenceUnderflowError
from solidtouch.inference.reference import BORDERS
from solidtouch.models.errors import InputError

LENGTH, SEQUENCE = 6, 2
SEQUENCE_ROUTE = "numpy, numpyro sequence"
TRIALS = {"numpy, cpu trials", "numpy, xla-cpu trials"}


@pytest.fixture
def compiled_loops_alone(monkeypatch):
    """Trials without XLA, which compiles for every shape."""
    monkeypatch.setattr(trial_check, "DEVICES", ("cpu",))


@pytest.fixture
def case(make_model):
    """A model and taps of its own."""
    return with_taps(make_model())


def with_taps(model, n=4):
    taps = draw_taps(
        model.grid, model.probabilities, model.edges, model.preprocessing, n, seed=0, trained=model.trained
    )
    return model, taps


def run(case, **more):
    return crosscheck_model(*case, **({"episodes": 2, "length": LENGTH, "sequence_taps": SEQUENCE} | more))


def failed(check):
    return {(row.routes, row.quantity) for row in check.rows if not row.passed}


@pytest.mark.parametrize("border", slow_but(["prior"], BORDERS))
def test_right_routes_agree(case, border):
    """Under every border; the one that is no kernel leaves the NumPyro routes out and says so."""
    check = run(case, border=border)
    routes = {row.routes for row in check.rows}

    assert check.passed
    assert (check.episodes, check.taps) == (2, LENGTH)
    if border == "prior":
        assert routes == {STORY, "numpy, filter"} | TRIALS
        assert check.sequence_taps == 0
        assert check.notes == ("The NumPyro routes were left out, because border prior is not a Markov kernel.",)
    else:
        assert routes == {STORY, "numpy, numpyro", "numpy, filter", SEQUENCE_ROUTE} | TRIALS
        assert (check.sequence_taps, check.notes) == (SEQUENCE, ())


@pytest.mark.parametrize(
    ("sizes", "more"),
    [
        pytest.param((1, 4, 2, 3, 5), {}, marks=pytest.mark.slow),
        pytest.param((4, 1, 2, 3, 5), {}, marks=pytest.mark.slow),
        pytest.param((1, 1, 2, 3, 4), {}, marks=pytest.mark.slow),
        ((3, 4, 2, 5, 7), {"untrained": [(1, 1), (0, 2)], "power": "none"}),
        pytest.param(
            (3, 4, 2, 5, 7), {"value_range": "taxel", "power": "JK", "pseudocount": 2.0}, marks=pytest.mark.slow
        ),
    ],
)
def test_models_of_all_kinds_pass(make_model, sizes, more):
    """One position, one object, both, untrained classes, bins for each taxel; without sequences, slow to compile."""
    L, M, K, J, B = sizes
    assert run(with_taps(make_model(L, M, K, J, B, **more)), sequence_taps=0).passed


@pytest.mark.parametrize(("L", "M"), [(1, 4), (4, 1)])
def test_one_position_or_object_passes(make_model, compiled_loops_alone, L, M):
    """Without the routes that compile for every shape."""
    assert run(with_taps(make_model(L, M, 2, 3, 5)), sequence_taps=0, border="prior").passed


def test_single_taps_pass(case, compiled_loops_alone):
    """Without any move."""
    check = run(case, length=1)

    assert check.passed
    assert check.sequence_taps == 1


def test_the_whole_sequence_route_can_be_left_out(case):
    """With none of the taps for it."""
    check = run(case, sequence_taps=0)

    assert check.passed
    assert SEQUENCE_ROUTE not in {row.routes for row in check.rows}


def test_too_long_sequences_are_refused(case):
    """The enumeration holds 20 taps."""
    with pytest.raises(InputError, match="1 to 20 taps"):
        run(case, length=21, sequence_taps=21)


def test_progress_is_told_of_every_episode(case):
    """Once each."""
    calls = []
    run(case, episodes=2, sequence_taps=0, progress=lambda: calls.append(1))

    assert len(calls) == 2


def test_the_seed_decides_the_episodes(case):
    """The same seed gives the same numbers."""
    first, again, other = (run(case, sequence_taps=0, seed=seed).rows for seed in (1, 1, 2))

    assert first == again
    assert first != other


def perturbed(function, change):
    """An engine's method whose result is a little wrong."""

    def wrong(*arguments):
        return change(function(*arguments))

    return wrong


def tilted(log_belief, by=1e-6):
    """The log belief with one class a little more likely, still normalised."""
    log_belief = np.array(log_belief)
    log_belief[0, 0] += by
    return log_belief - np.logaddexp.reduce(log_belief.ravel())


ERRORS = {
    "numpyro shift": (enumeration.NumpyroEngine, "shift", tilted, "numpy, numpyro"),
    "filter shift": (bayes.FilterEngine, "shift", tilted, "numpy, filter"),
    "numpyro update": (enumeration.NumpyroEngine, "update", lambda r: (tilted(r[0]), r[1]), "numpy, numpyro"),
    "filter update": (bayes.FilterEngine, "update", lambda r: (tilted(r[0]), r[1]), "numpy, filter"),
    "numpyro evidence": (enumeration.NumpyroEngine, "update", lambda r: (r[0], r[1] + 1e-6), "numpy, numpyro"),
    "filter evidence": (bayes.FilterEngine, "update", lambda r: (r[0], r[1] + 1e-6), "numpy, filter"),
    "NaN": (bayes.FilterEngine, "update", lambda r: (r[0], np.nan), "numpy, filter"),
}


def trials_with(monkeypatch, change):
    """Has the Monte Carlo on the processor answer a little wrongly."""
    play = trial_check.run_trials

    def wrong(*arguments, device, **more):
        trials = play(*arguments, device=device, **more)
        if device == "cpu":
            change(trials)
        return trials

    monkeypatch.setattr(trial_check, "run_trials", wrong)


def test_a_wrong_belief_of_a_trial_is_found(monkeypatch, case):
    """By a millionth."""

    def change(trials):
        trials.belief[0, 5] += 1e-6

    trials_with(monkeypatch, change)

    assert failed(run(case, sequence_taps=0)) == {("numpy, cpu trials", "decided belief")}


@pytest.mark.parametrize("name", ["taps", "what", "where", "true_where", "stopped"])
def test_a_wrong_decision_of_a_trial_is_found(monkeypatch, case, name):
    """At one threshold."""

    def change(trials):
        values = getattr(trials, name)
        values[1, 3] = ~values[1, 3] if name == "stopped" else values[1, 3] + 1

    trials_with(monkeypatch, change)
    check = run(case, sequence_taps=0)

    assert (check.differing_decisions, check.near_ties) == (1, 0)
    assert not check.passed


def test_a_decision_between_equals_is_a_near_tie(monkeypatch, make_model, compiled_loops_alone):
    """On histograms that say nothing all beliefs are equal, and any decision is as good."""
    model = make_model(2, 2, 1, 3, 4)
    model.counts[:] = 5

    def change(trials):
        trials.what[0] += 1

    trials_with(monkeypatch, change)
    check = run(with_taps(model), sequence_taps=0, episodes=1, border="prior")

    assert check.differing_decisions == 0
    assert check.near_ties >= 13


@pytest.mark.parametrize(("owner", "name", "change", "routes"), ERRORS.values(), ids=ERRORS.keys())
def test_an_error_of_one_route_is_found(case, monkeypatch, owner, name, change, routes):
    """A millionth is enough, and only that route fails."""
    monkeypatch.setattr(owner, name, perturbed(getattr(owner, name), change))
    check = run(case)

    assert not check.passed
    assert {route for route, _ in failed(check)} == {routes}


def test_an_error_of_the_yardstick_is_found(case, monkeypatch):
    """Then all other routes disagree with it."""
    wrong = perturbed(numpy_engine.NumpyEngine.shift, tilted)
    monkeypatch.setattr(numpy_engine.NumpyEngine, "shift", wrong)

    assert {route for route, _ in failed(run(case))} == {"numpy, numpyro", "numpy, filter", SEQUENCE_ROUTE}


def test_an_error_of_the_whole_sequence_is_found(case, monkeypatch):
    """In its evidence or its posteriors."""
    right = enumeration.enumerate_sequence
    for change, quantity in (
        (lambda p: p._replace(log_evidence=p.log_evidence + 1e-6), "log evidence"),
        (lambda p: p._replace(filtered=p.filtered * (1 + 1e-6)), "posterior"),
    ):
        monkeypatch.setattr(enumeration, "enumerate_sequence", perturbed(right, change))
        check = run(case)

        assert not check.passed
        assert (SEQUENCE_ROUTE, quantity) in failed(check)


def test_a_wrong_class_that_is_hopeless_is_found(case, monkeypatch):
    """A class at e^-300 that should be impossible or other is seen in the log posterior."""

    def change(result):
        log_belief = result[0].copy()
        log_belief.flat[log_belief.argmin()] -= 1e-3
        return log_belief, result[1]

    monkeypatch.setattr(bayes.FilterEngine, "update", perturbed(bayes.FilterEngine.update, change))

    assert ("numpy, filter", "log posterior") in failed(run(case, sequence_taps=0))


def test_differing_decisions_and_moves_are_counted(case, monkeypatch):
    """A route that mirrors the belief decides and moves otherwise."""
    change = perturbed(bayes.FilterEngine.update, lambda result: (result[0][::-1, ::-1], result[1]))
    monkeypatch.setattr(bayes.FilterEngine, "update", change)
    check = run(case, sequence_taps=0)

    assert check.differing_decisions > 0
    assert check.differing_moves > 0
    assert not check.passed
    assert not check._replace(rows=()).passed


def test_near_ties_are_counted_apart(make_model, monkeypatch, compiled_loops_alone):
    """Two objects that are alike to the last digit may be decided either way."""
    model = make_model(1, 2, 1, 1, 3)
    model.counts[0, 1] = model.counts[0, 0]
    change = perturbed(bayes.FilterEngine.update, lambda result: (tilted(result[0], -1e-14), result[1]))
    monkeypatch.setattr(bayes.FilterEngine, "update", change)
    check = run(with_taps(model), sequence_taps=0, border="prior")

    assert check.passed
    assert check.near_ties > 0


def test_sequences_that_underflow_are_halved(case, monkeypatch):
    """For good, with a note each; at last the route is left out."""
    right = enumeration.enumerate_sequence
    lengths = []

    def holds_one(model, taps, deltas, border) -> SequencePosterior:
        lengths.append(len(taps))
        if len(taps) > 1:
            raise SequenceUnderflowError(f"{len(taps)} taps are too many.")
        return right(model, taps, deltas, border)

    monkeypatch.setattr(enumeration, "enumerate_sequence", holds_one)
    check = run(case, sequence_taps=4)

    assert check.passed
    assert lengths == [4, 2, 1, 1]
    assert check.sequence_taps == 1
    assert check.notes == ("4 taps are too many; continued with 2 taps.", "2 taps are too many; continued with 1 taps.")


@pytest.mark.slow
def test_sequences_that_outweigh_their_stand_in_for_zero_are_halved(make_model):
    """On taps that contradict each other by hundreds of units, the whole check still passes."""
    model = make_model(1, 2, 1, 20, 2, power="none")
    model.counts[0] = [[[10**6, 0]], [[0, 10**6]]]
    _, taps = with_taps(model)
    taps.dataset["what"][:] = 0
    check = run((model, taps), length=12, sequence_taps=12)

    assert check.passed
    assert check.sequence_taps < 12
    assert "underflowed, as funsor contracts" in check.notes[0]


@pytest.mark.parametrize("evidence", [0.0, 1e-6])
def test_a_border_that_is_no_kernel_leaves_routes_out(case, monkeypatch, evidence):
    """A note says so, and the others are compared all the same."""
    change = perturbed(bayes.FilterEngine.update, lambda result: (result[0], result[1] + evidence))
    monkeypatch.setattr(bayes.FilterEngine, "update", change)
    check = run(case, border="prior")

    assert "border prior is not a Markov kernel" in check.notes[0]
    assert check.sequence_taps == 0
    assert check.passed != bool(evidence)
