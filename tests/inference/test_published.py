"""Published examples of hmmlearn, dynamax and pymdp, through updates and moves; see `benchmarks/peers`."""

import os
from dataclasses import replace
from decimal import Decimal

import numpy as np
import pytest

from benchmarks.checks.house import ROOT
from benchmarks.page import block_of
from benchmarks.peers import compare, packages
from benchmarks.peers.examples import _half_unit, active_examples, examples
from benchmarks.peers.paths import by_moves, by_paths, by_steps, paths

EXAMPLES, ACTIVE = examples(), active_examples()
PUBLISHED = [name for name, example in EXAMPLES.items() if example.expected]
OF_HMMLEARN = [name for name, example in EXAMPLES.items() if example.power == "none"]


@pytest.mark.parametrize("engine", ["filter", "numpy", pytest.param("numpyro", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", PUBLISHED)
def test_published_numbers_hold(name, engine):
    held, number = compare.held(EXAMPLES[name], by_paths(EXAMPLES[name], engine))

    assert held == number > 0


def test_a_published_number_that_were_another_is_noticed():
    """By one unit of its last digit."""
    umbrella = EXAMPLES["umbrella"]
    other = umbrella.expected["smoothed"].copy()
    other[0, 0] += 1e-4
    held, number = compare.held(replace(umbrella, expected={"smoothed": other}), by_paths(umbrella))

    assert (held, number) == (9, 10)


@pytest.mark.parametrize(
    ("value", "half"), [("0.4500", 5e-5), ("-3.3725", 5e-5), ("0.8", 0.05), ([["1.5", "2.25"]], 5e-3)]
)
def test_a_published_number_holds_to_its_last_digit(value, half):
    def decimals(one):
        return [decimals(part) for part in one] if isinstance(one, list) else Decimal(one)

    assert float(_half_unit(decimals(value))) == pytest.approx(half, rel=1e-6)
    assert _half_unit([0, 1]) == 0


@pytest.mark.parametrize("name", OF_HMMLEARN)
def test_hmmlearn_finds_the_same(name):
    """Filtered, smoothed, evidence and the most probable path; it is a requirement of these tests."""
    pytest.importorskip("hmmlearn", reason="hmmlearn is not installed")
    example = EXAMPLES[name]

    assert compare.largest(by_paths(example), packages.by_hmmlearn(example)) < 1e-12


@pytest.mark.filterwarnings("ignore")  # those that importing it gives
@pytest.mark.parametrize("name", EXAMPLES)
def test_dynamax_finds_the_same(name):
    """Also predicted, and in pairs of successive states."""
    pytest.importorskip("dynamax", reason="dynamax is not installed")
    example = EXAMPLES[name]

    assert compare.largest(by_paths(example), packages.by_dynamax(example)) < 1e-12


@pytest.mark.filterwarnings("ignore")
def test_dynamax_finds_the_same_for_what_its_tests_draw():
    pytest.importorskip("dynamax", reason="dynamax is not installed")
    for example in compare.drawn():
        assert compare.largest(by_paths(example), packages.by_dynamax(example)) < 1e-12


@pytest.mark.filterwarnings("ignore")
def test_the_evidence_of_all_rolls_in_the_notebook_of_dynamax_holds():
    """Its 300 rolls are drawn as it draws them; the first ones are those that it prints."""
    pytest.importorskip("dynamax", reason="dynamax is not installed")
    first = EXAMPLES["casino, first rolls"]
    casino = packages.casino_of_dynamax(first)
    _, log_evidence = by_steps(casino)

    np.testing.assert_array_equal(casino.taps[: len(first.taps)], first.taps)
    assert abs(log_evidence - casino.expected["log_evidence"]) <= casino.within["log_evidence"]


@pytest.mark.slow
def test_pymdp_finds_the_same():
    if not os.environ.get(packages.PYMDP):
        pytest.skip(f"{packages.PYMDP} does not name a Python with inferactively-pymdp 1.0.4")
    for example in EXAMPLES.values():
        if example.power == "J" or example.taps.shape[1] == 1:
            np.testing.assert_allclose(packages.by_pymdp(example), by_paths(example).belief, rtol=0, atol=1e-12)
    for example in ACTIVE.values():
        np.testing.assert_allclose(packages.by_pymdp(example), by_moves(example), rtol=0, atol=1e-12)


@pytest.mark.parametrize("border", ["uniform", "uniform_what", "clamp", "circular"])
def test_no_border_changes_a_path(border):
    """The finger stays within the range."""
    example = EXAMPLES["weather"]

    np.testing.assert_allclose(by_paths(example, border=border).belief, by_paths(example).belief, rtol=0, atol=1e-15)


def test_steps_and_paths_agree():
    for name in ("umbrella", "topics of sentences", "casino, first rolls"):
        found = by_paths(EXAMPLES[name])
        belief, log_evidence = by_steps(EXAMPLES[name])
        np.testing.assert_allclose(belief, found.belief, rtol=0, atol=1e-13)
        np.testing.assert_allclose(log_evidence, found.log_evidence, rtol=1e-13)
        np.testing.assert_allclose(found.pairs.sum(axis=2), found.smoothed[:-1], rtol=0, atol=1e-13)
    assert paths(3, 4).shape == (81, 4)


@pytest.mark.parametrize("name", ACTIVE)
def test_moves_are_actions_while_the_place_is_known(name):
    """By Bayes' rule over places and objects, with actions that lead to a place from everywhere."""
    example = ACTIVE[name]
    probabilities = example.trained / example.trained.sum(axis=-1, keepdims=True)
    belief, found = np.full(len(example.objects), 1 / len(example.objects)), by_moves(example)
    for t, place in enumerate(example.visited):
        taxels = range(probabilities.shape[2])
        belief = belief * np.prod([probabilities[place, :, k, int(example.taps[t, 0, k])] for k in taxels], axis=0)
        belief /= belief.sum()
        np.testing.assert_allclose(found[t, place], belief, rtol=0, atol=1e-15)
        assert found[t].sum() == pytest.approx(1)
        if "object" in example.expected:
            np.testing.assert_allclose(found[t].sum(axis=0), example.expected["object"][t], rtol=0, atol=1e-15)


@pytest.mark.slow
def test_ten_thousand_taps_of_a_state_that_stays_are_their_sum():
    example = packages.constant_state()
    log_belief = np.cumsum(example.log_likelihood, axis=0)
    exact = np.exp(log_belief - np.logaddexp.reduce(log_belief, axis=1, keepdims=True))

    np.testing.assert_allclose(by_steps(example)[0], exact, rtol=0, atol=1e-8)


def test_the_page_has_every_example():
    page = block_of(ROOT / "docs" / "explanation" / "peers.md", compare.BLOCK)

    assert [
        name for name in [*EXAMPLES, *ACTIVE, *(one[0] for one in compare.DRAWN)] if f"| {name} |" not in page
    ] == []
    assert "constant states" in page
