"""The exact answers of the kit, beside fractions and brute force."""

from dataclasses import replace
from fractions import Fraction
from itertools import product

import mpmath
import numpy as np
import pytest
from solidtouch.analysis.conformance import arithmetic, exact
from solidtouch.analysis.conformance.arithmetic import MP
from solidtouch.analysis.conformance.cases.scene import Scene, make
from solidtouch.analysis.conformance.catalogue import catalogue
from solidtouch.analysis.conformance.exact import Exact
from solidtouch.analysis.conformance.information import EQUAL, STRATEGIES, best_move, information, outcomes
from solidtouch.analysis.conformance.mistakes import MISTAKES


def whole_sequences(case):
    """Posterior and evidence after each tap as fractions, by the sum over all starting classes and their ways."""
    L, M, K, _, _ = case.sizes.values()
    counts = case.counts.astype(object) + Fraction(case.pseudocount)
    tables = counts / counts.sum(axis=-1, keepdims=True)
    edges = [Fraction(edge) for edge in case.edges.tolist()]
    before = Fraction(1)
    for T in range(1, len(case.taps) + 1):
        cells = {cell: Fraction(0) for cell in product(range(L), range(M))}
        for start, m in product(range(L), range(M)):
            place, p = start, Fraction(case.prior[start, m])
            for t in range(T):
                place = min(max(place + int(case.moves[t]), 0), L - 1)
                for sample in case.taps[t].tolist():
                    for k in range(K):
                        b = sum(Fraction(sample[k]) >= edge for edge in edges[1:-1])
                        p *= tables[place, m, k, b]
            cells[place, m] += p
        evidence = sum(cells.values())
        yield {cell: p / evidence for cell, p in cells.items()}, evidence / before
        before = evidence


def test_beliefs_and_evidence_are_sums_over_all_ways_in_fractions():
    """Border clamp and no root: nothing but products and sums of fractions."""
    case = make(
        "fractions", "", (), Scene(L=3, M=2, K=2, J=2, B=4), power="none", border="clamp", taps=4, moves=[0, 2, -1, -4]
    )
    for answer, (belief, evidence) in zip(Exact(case).answers(), whole_sequences(case), strict=True):
        right = np.array([[float(belief[l, m]) for m in range(2)] for l in range(3)])
        np.testing.assert_array_equal(answer.values["posterior"], right)
        assert answer.values["log_evidence"] == float(mpmath.log(mpmath.mpf(evidence.numerator) / evidence.denominator))


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_information_is_the_divergence_of_the_joint_from_the_product(strategy):
    """Of taps and objects, positions or classes; those from which no tap comes are left out."""
    random = np.random.default_rng(3)
    logs, belief = random.normal(size=(6, 4, 3)), random.dirichlet(np.ones(12)).reshape(4, 3)
    logs[:, 1, 2] = -np.inf
    joint = np.exp(logs)
    joint /= np.where(joint.sum(axis=0) > 0, joint.sum(axis=0), 1)
    joint *= belief * (joint.sum(axis=0) > 0)
    joint /= joint.sum()
    of = {"info-what": joint.sum(axis=1), "info-where": joint.sum(axis=2), "info-joint": joint.reshape(6, -1)}[strategy]
    product_of = of.sum(axis=1, keepdims=True) * of.sum(axis=0)
    right = (of[of > 0] * np.log(of[of > 0] / product_of[of > 0])).sum()

    given = outcomes([[[MP.mpf(value) for value in row] for row in tap] for tap in logs.tolist()])
    found = information(given, [[MP.mpf(p) for p in row] for row in belief.tolist()], strategy)
    assert float(found) == pytest.approx(right, rel=1e-12)
    assert information(given, [[MP.mpf(0)] * 3] * 4, strategy) == 0


def test_of_moves_that_tell_as_much_the_shortest_counts():
    """Then the one to the lower position."""
    assert best_move([MP.mpf(1), MP.mpf(1), MP.mpf(1)], 1) == 0
    assert best_move([MP.mpf(1), MP.mpf(0), MP.mpf(1)], 1) == -1
    assert best_move([MP.mpf(1), MP.mpf(2), MP.mpf(2)], 0) == 1
    assert best_move([MP.mpf(1), MP.mpf(1) + EQUAL / 2], 0) == 0


def test_moves_of_strategies_begin_at_a_clear_position():
    """Rounding cannot make it another one; and strategies differ in what they choose."""
    cases = [case for case in catalogue().values() if case.level == "strategies"]
    for case in cases:
        for answer in Exact(case).answers():
            best = np.sort(answer.values["where"])[::-1]
            assert best[0] - best[1] > 1e-6
    moves = [[int(a.values["move"]) for a in Exact(catalogue()[name]).answers()] for name in STRATEGIES]
    assert len({tuple(each) for each in moves}) == 3


@pytest.mark.parametrize("name", ["normal-far", "normal-tails", "normal-of-each-taxel"])
def test_probabilities_of_bins_are_integrals_of_the_density(name):
    """By quadrature; all bins of a class together have probability one."""
    case = catalogue()[name]
    exact_of = Exact(case)
    mean, sd = MP.mpf(float(case.mean[1, 0, 1])), MP.mpf(float(case.sd[1, 0, 1]))
    found = [exact_of.normal_probability(1, 0, 1, b) for b in range(case.bins)]
    edges = exact_of.edges[1]
    for b in (1, case.bins // 2, case.bins - 2):
        top = max(MP.npdf(edge, mean, sd) for edge in edges[b : b + 2])  # as quadrature stops at an absolute error
        pieces = MP.linspace(edges[b], edges[b + 1], 15)
        integral = top * MP.quad(lambda x, top=top: MP.npdf(x, mean, sd) / top, pieces)
        assert abs(found[b] / integral - 1) < MP.mpf(10) ** -20

    assert abs(MP.fsum(found) - 1) < MP.mpf(10) ** -55


@pytest.mark.parametrize(
    "name",
    [
        "root-j",
        "episode-uniform",
        "episode-prior",
        "empty-bins",
        "fit",
        "subnormal-prior",
        "normal-tails",
        "normal-far",
        "normal-wide",
        "info-joint",
    ],
)
def test_more_digits_change_no_double(name):
    """Sixty digits are enough."""
    answers = []
    for digits in (90, 60):
        arithmetic.log.cache_clear()
        exact._likelihoods.cache_clear()
        exact._log_products.cache_clear()
        with MP.workdps(digits):
            answers.append(list(Exact(catalogue()[name]).answers()))
    for a, b in zip(*answers, strict=True):
        for quantity, value in a.values.items():
            np.testing.assert_array_equal(value, b.values[quantity])


def test_the_root_makes_repeated_samples_count_once():
    """Every sample twice is the same tap under power J, and the same as power none with one sample of each."""
    scene = Scene(L=3, M=2, K=2, J=1, B=4)
    once = make("once", "", (), scene, power="none")
    twice = replace(once, taps=np.repeat(once.taps, 2, axis=1), power="J")
    for a, b in zip(Exact(once).answers(), Exact(twice).answers(), strict=True):
        np.testing.assert_allclose(a.values["posterior"], b.values["posterior"], rtol=1e-15)


@pytest.mark.parametrize("name", ["fit", "bins-on-edges", "normal-ends"])
def test_log_likelihoods_of_a_mistake_are_its_own(name):
    """Also where the equations, and mistakes behind the likelihood, have had those of the same case before."""
    case = catalogue()[name]
    for mistake in MISTAKES:
        for rules in mistake.rules:
            shared = [answer.line(case.name) for answer in rules(case).answers()]
            alone = [answer.line(case.name) for answer in rules(replace(case)).answers()]
            assert shared == alone, rules


@pytest.mark.parametrize("border", ["uniform", "uniform_what", "prior", "clamp", "circular"])
@pytest.mark.parametrize("move", [-7, -3, -1, 0, 1, 2, 3, 11])
def test_shifted_beliefs_sum_to_one_and_kernels_keep_objects(border, move):
    case = replace(make("law", "", (), Scene(L=3, M=2, K=1, J=1, B=2)), border=border)
    rules = Exact(case)
    belief = [[MP.mpf(p) / 21 for p in row] for row in ([1, 2], [3, 4], [5, 6])]
    shifted = rules.shift(belief, move)

    assert abs(MP.fsum(p for row in shifted for p in row) - 1) < MP.mpf(10) ** -55
    if move == 0:
        assert shifted == rules.divided(belief)[0]
    if border in ("uniform_what", "clamp", "circular"):
        kept = zip(rules.what_marginal(shifted), rules.what_marginal(belief), strict=True)
        assert all(abs(a - b) < MP.mpf(10) ** -55 for a, b in kept)


def test_a_circular_move_back_gives_the_belief_back():
    case = replace(make("law", "", (), Scene(L=5, M=2, K=1, J=1, B=2)), border="circular")
    rules = Exact(case)
    belief = rules.divided([[MP.mpf(l + 2 * m + 1) for m in range(2)] for l in range(5)])[0]

    assert rules.shift(rules.shift(belief, 13), -13) == belief
