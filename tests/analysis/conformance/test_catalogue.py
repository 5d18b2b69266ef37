"""The cases of the kit."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from solidtouch.analysis.conformance.catalogue import catalogue, expected, own_kit
from solidtouch.analysis.conformance.comparison import first_difference
from solidtouch.analysis.conformance.engines import ROUTES
from solidtouch.analysis.conformance.mistakes import MISTAKES, explains
from solidtouch.analysis.conformance.run import run_route
from solidtouch.analysis.conformance.tolerance import (
    _added,
    _same_bins,
    allowed_decisions,
    allowed_moves,
    needs_double,
    tolerances,
)
from solidtouch.analysis.conformance.trials import _own_moves, trial_difference
from solidtouch.inference.reference import BORDERS, POWERS
from solidtouch.models.errors import InputError

LONG = (
    "ten-thousand-taps",
    "long-and-back",
    "thousand-moves",
    "thousand-moves-uniform-what",
    "thousand-moves-circular",
    "episode-paper-size",
    "episode-long",
    "subnormal-prior",
)
SHORT = [case for name, case in catalogue().items() if name not in LONG]
FEW = sorted((case for case in SHORT if case.sizes["L"] * case.sizes["J"] <= 60), key=lambda case: bool(case.strategy))
"""Those of few samples; the ones with gains of information come last, as their exact answers take the longest."""
UNDECIDED = (
    "near-ties",
    "threshold-reached",
    "one-bin",
    "tables-nearly-equal",
    "thresholds-undone",
    "single-range",
    "info-pool-of-one",
)
"""Cases whose beliefs are as equal as rounding goes, and those beside `shift-` that lose all belief."""


def test_the_cases_cover_equations_borders_roots_and_sizes():
    cases = list(catalogue().values())

    assert {number for case in cases for number in case.equations} == set(range(1, 11))
    assert {case.border for case in cases} == set(BORDERS)
    assert set(POWERS) < {case.power for case in cases}
    for size in range(5):
        assert 1 in {list(case.sizes.values())[size] for case in cases}
    assert max(len(case.taps) for case in cases) == 10_000
    assert len({case.about for case in cases}) == len(cases)


def test_only_cases_about_ties_leave_a_choice():
    for case in SHORT:
        allowed = tolerances(case, expected(case), "double")
        answers = [answer for answer in expected(case) if answer.error is None and answer.tap]
        choices = [choice for answer in answers for choice in allowed_decisions(case, answer, allowed["what"])]
        choices += [allowed_moves(case, answer, allowed["where"]) for answer in answers]
        open_choice = any(len(choice) > 1 for choice in choices)
        assert open_choice == (case.name in UNDECIDED) or case.name.startswith("shift-"), case.name


def test_single_precision_leaves_out_what_it_cannot_do():
    left_out = {case.name for case in SHORT if needs_double(case, expected(case))}

    assert {"single-edges", "single-range", "bins-beside-edges", "tiny-marginals"} <= left_out
    assert "episode-uniform" not in left_out


def test_a_sample_on_an_edge_that_single_precision_knows_stays_in_its_bin():
    edges = np.array([0.0, 0.5, 1.0])
    assert _same_bins(edges[:, np.newaxis, np.newaxis], edges)
    assert not _same_bins(np.full((1, 1, 1), 0.5 - 1e-12), edges)


def test_small_priors_loosen_the_tolerance_of_beliefs():
    case = next(case for case in SHORT if case.name == "episode-uniform")
    prior = np.full(case.prior.shape, 1.0)
    prior.flat[0] = 1e-200
    small = replace(case, prior=prior / prior.sum())
    answers = expected(case)

    assert _added(small, answers) == pytest.approx(_added(case, answers) + np.log(case.prior.min() / small.prior.min()))


@pytest.mark.parametrize("route", ["numpy", "montecarlo"])
def test_engines_pass_the_short_cases(route):
    verdicts = list(run_route(route, SHORT))

    assert {verdict.status for verdict in verdicts} == {"pass"}


@pytest.mark.slow
@pytest.mark.parametrize("route", ROUTES)
def test_engines_pass_all_cases(route):
    verdicts = list(run_route(route, list(catalogue().values())))
    left_out = {verdict.case for verdict in verdicts if verdict.status == "left out"}

    assert {verdict.status for verdict in verdicts} - {"left out"} == {"pass"}
    assert left_out == (_beyond_numpyro() if route == "numpyro" else set())


def _beyond_numpyro():
    """No kernel, or no probabilities."""
    return {case.name for case in catalogue().values() if case.border == "prior"} | {"tables-as-given"}


def test_many_cases_are_played_as_whole_trials_too():
    played = [case for case in SHORT if _own_moves(case, expected(case), tolerances(case, expected(case), "double"))]

    assert len(played) >= 15
    assert {case.border for case in played} == set(BORDERS)


def test_a_whole_trial_that_decides_otherwise_is_found():
    """The right answers of one case are no right answers of another with the same moves."""
    case = catalogue()["episode-clamp"]
    right = expected(case)
    swapped = [type(answer)(answer.tap, {**answer.values, "what": answer.values["what"][::-1]}) for answer in right]

    assert trial_difference(case, right, tolerances(case, right, "double")) is None
    assert trial_difference(case, swapped, tolerances(case, right, "double")) is not None


@cache
def allowed_in(case):
    return tolerances(case, expected(case), "double")


@pytest.mark.parametrize("mistake", [m for m in MISTAKES if m.rules], ids=lambda mistake: mistake.name)
def test_every_mistake_differs_somewhere_and_explains_itself(mistake):
    """In every form, and in the first cases where it shows nothing else explains more."""
    for rules in mistake.rules:
        shown, named = 0, 0
        for case in FEW[::2] if len(mistake.rules) > 3 else FEW:
            if not mistake.shows(case):
                continue
            allowed = allowed_in(case)
            answers = list(rules(case).answers())
            found = first_difference(case, expected(case), answers, allowed)
            if found is not None:
                shown += 1
                named += explains(mistake, case, answers, found, allowed)
            if shown == 2:
                break
        assert shown > 0 or rules.__name__ in ("_LinearBelief", "_LinearProduct"), rules.__name__
        assert named == shown


def test_an_unknown_case_is_refused():
    with pytest.raises(InputError, match=r"case shift: there is no such case"):
        own_kit().select(["shift"])


def test_cases_are_the_same_every_time():
    first = "\n".join(line for case in SHORT for line in case.lines())
    own_kit.cache_clear()
    again = "\n".join(line for case in catalogue().values() if case.name not in LONG for line in case.lines())

    assert first == again


def test_subnormal_beliefs_come_back():
    """Object 1 is the most probable in the end, and had priors of 1e-310 and less."""
    case = catalogue()["subnormal-prior"]

    assert 0 < case.prior[:, 1].sum() < 1e-309
    assert expected(case)[-1].values["what"].argmax() == 1


def test_a_tap_that_is_said_to_underflow_does():
    """Under every class; also its evidence."""
    for answer in expected(catalogue()["tap-underflows"]):
        assert answer.values["log_likelihood"].max() < -745
        assert answer.values["log_evidence"] < -745


def test_moves_are_made_and_not_made_by_theta_x():
    """Where the belief in the object, or in the most probable class, would say otherwise."""
    undone = [answer.values["move"] for answer in expected(catalogue()["move-undone"])]
    (by_object,), (by_joint,) = (expected(catalogue()[f"move-not-by-{name}"]) for name in ("object", "joint"))

    assert undone == [0, 2, 0, 1, 1, 0]
    assert by_object.values["where"].max() < 0.45 < by_object.values["what"].max()
    assert by_joint.values["posterior"].max() < 0.35 < by_joint.values["where"].max()
    assert (by_object.values["move"], by_joint.values["move"]) == (0, -2)


def test_thresholds_beside_a_belief_have_one_answer():
    """1e-8 is more than the tolerance; in 32 bits it is less."""
    for name, decided, moved in (("below", 1, -2), ("above", -1, 0)):
        case = catalogue()[f"thresholds-just-{name}"]
        (answer,) = expected(case)
        near = {precision: tolerances(case, [answer], precision) for precision in ("double", "single")}

        assert allowed_decisions(case, answer, near["double"]["what"]) == [{decided}]
        assert allowed_moves(case, answer, near["double"]["where"]) == {moved}
        assert allowed_decisions(case, answer, near["single"]["what"]) == [{-1, 1}]


def test_a_range_is_over_all_classes_and_taxels():
    """No class and no taxel has both its ends."""
    training = catalogue()["fit-range"].training
    taps = training.taps
    high, low = (np.argwhere(taps == value)[0] for value in (taps.max(), taps.min()))

    assert high[2] != low[2]
    assert training.where[high[0]] != training.where[low[0]]
    assert training.what[high[0]] != training.what[low[0]]


def test_a_case_that_is_named_twice_is_asked_once():
    assert [case.name for case in own_kit().select(["ties", "root-j", "ties"])] == ["ties", "root-j"]
