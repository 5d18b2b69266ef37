"""The paper's equations: worked examples, laws, limits, and exact rational arithmetic as an independent check."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from solidtouch.inference import reference
from solidtouch.inference.reference import BORDERS, ZeroEvidenceError

KEEP_WHAT = ("uniform_what", "clamp", "circular")
BELIEF = np.array([[0.125, 0.25], [0.0, 0.5], [0.0625, 0.0625]])
"""Three where and two what classes; what marginal 3/16 and 13/16."""

weights = st.tuples(st.integers(1, 5), st.integers(1, 4)).flatmap(
    lambda shape: arrays(np.float64, shape, elements=st.integers(0, 1000).map(float))
)
beliefs = weights.filter(lambda w: w.sum() > 0).map(lambda w: w / w.sum())


def logs(belief):
    with np.errstate(divide="ignore"):
        return np.log(belief)


# Bins


@pytest.mark.parametrize(
    ("sample", "bin_"),
    [(-5.0, 0), (0.0, 0), (0.999, 0), (1.0, 1), (2.999, 1), (3.0, 2), (7.0, 2), (7.1, 2), (np.inf, 2), (-np.inf, 0)],
)
def test_bins_are_half_open_and_the_last_is_closed(sample, bin_):
    """A sample on an edge belongs to the bin above it, one outside to the end bin."""
    assert reference.bin_index(sample, [0.0, 1.0, 3.0, 7.0]) == bin_


def test_bins_keep_the_shape_of_the_samples():
    """One bin takes everything, whatever the shape."""
    assert reference.bin_index(np.linspace(-9, 9, 6).reshape(2, 3, 1), [0.0, 1.0]).tolist() == [[[0]] * 3] * 2


@pytest.mark.parametrize("edges", [[0.0], [0.0, 0.0], [1.0, 0.0], [0.0, np.nan], [[0.0, 1.0]]])
def test_edges_must_increase(edges):
    """Anything else has no bins."""
    with pytest.raises(ValueError, match="at least two increasing"):
        reference.bin_index([0.5], edges)


def test_nan_belongs_to_no_bin():
    """It is refused instead of landing in the last bin."""
    with pytest.raises(ValueError, match="NaN"):
        reference.bin_index([0.5, np.nan], [0.0, 1.0])


# Eq. 1 and 2


@pytest.mark.parametrize(("power", "value"), [("J", 0.2), ("JK", 0.1), ("none", 1.0), (0.3, 0.3), (7, 7.0)])
def test_exponents_of_five_samples_and_two_taxels(power, value):
    """1/J as printed, 1/(J K), 1, or the number itself."""
    assert reference.exponent(power, 5, 2) == value


@pytest.mark.parametrize("power", ["K", "", 0.0, -1.0, np.nan, np.inf])
def test_other_powers_are_refused(power):
    """The message shows what was given."""
    with pytest.raises(ValueError, match="power must be J, JK, none or a positive number, got"):
        reference.exponent(power, 5, 2)


def test_likelihood_by_hand():
    """Two samples of one taxel: the geometric mean of their probabilities."""
    log_prob = np.log(np.array([[[[0.25, 0.75]], [[0.5, 0.5]]]]))

    log_likelihood = reference.tap_log_likelihood([[0], [1]], log_prob)

    np.testing.assert_allclose(np.exp(log_likelihood), [[np.sqrt(3) / 4, 0.5]], rtol=1e-15)


def test_duplicating_every_sample_leaves_the_likelihood_unchanged(rng):
    """The J-th root makes taps of different length comparable; without it the likelihood is squared."""
    bins = rng.integers(4, size=(3, 2))
    log_prob = np.log(rng.dirichlet(np.ones(4), size=(5, 3, 2)))
    twice = np.repeat(bins, 2, axis=0)

    for power in ("J", "JK"):
        np.testing.assert_allclose(
            reference.tap_log_likelihood(twice, log_prob, power),
            reference.tap_log_likelihood(bins, log_prob, power),
            rtol=1e-13,
        )
    np.testing.assert_allclose(
        reference.tap_log_likelihood(twice, log_prob, "none"),
        2 * reference.tap_log_likelihood(bins, log_prob, "none"),
        rtol=1e-13,
    )


def test_the_order_of_samples_does_not_matter(rng):
    """Samples of a tap are exchangeable under Eq. 1."""
    bins = rng.integers(4, size=(6, 2))
    log_prob = np.log(rng.dirichlet(np.ones(4), size=(5, 3, 2)))

    np.testing.assert_allclose(
        reference.tap_log_likelihood(rng.permutation(bins), log_prob),
        reference.tap_log_likelihood(bins, log_prob),
        rtol=1e-13,
    )


def test_one_impossible_sample_makes_a_class_impossible():
    """No root and no other sample brings it back."""
    log_prob = logs(np.array([[[[0.0, 1.0]], [[0.5, 0.5]]]]))

    assert reference.tap_log_likelihood([[1], [1], [0]], log_prob, 0.001)[0, 0] == -np.inf
    assert reference.tap_log_likelihood([[1], [1], [1]], log_prob)[0, 0] == 0.0


def test_likelihood_of_a_single_bin_is_one():
    """With B = 1 a tap says nothing."""
    assert reference.tap_log_likelihood(np.zeros((4, 3), int), np.zeros((2, 5, 3, 1))).tolist() == [[0.0] * 5] * 2


@pytest.mark.parametrize("shape", [(2, 5, 3, 4), (2, 5, 2), (5, 2, 4)])
def test_tables_of_other_taxels_are_refused(shape):
    """The message names both."""
    with pytest.raises(ValueError, match="bins have 2 taxels"):
        reference.tap_log_likelihood(np.zeros((3, 2), int), np.zeros(shape))


def test_histogram_by_hand():
    """The pseudocount is in counts and added to every bin."""
    np.testing.assert_allclose(reference.histogram_probabilities([3, 0, 1], 0), [0.75, 0.0, 0.25], rtol=0)
    np.testing.assert_allclose(reference.histogram_probabilities([3, 0, 1], 1.0), [4 / 7, 1 / 7, 2 / 7], rtol=1e-15)
    assert reference.histogram_probabilities([3, 0])[1] == pytest.approx(0.01 / 3.02)


def test_an_empty_histogram_is_flat():
    """All that is left is the pseudocount."""
    assert reference.histogram_probabilities(np.zeros((2, 4))).tolist() == [[0.25] * 4] * 2


@pytest.mark.parametrize(
    ("counts", "pseudocount"), [([1, -1], 0.5), ([1, 2], -0.1), ([1, -1], 0), ([1, np.nan], 0), ([1, 2], np.nan)]
)
def test_negative_counts_are_refused(counts, pseudocount):
    """Neither counts nor pseudocount may be negative or NaN."""
    with pytest.raises(ValueError, match="must not be negative"):
        reference.histogram_probabilities(counts, pseudocount)


def test_an_empty_histogram_without_pseudocount_is_refused():
    """0/0 is no distribution."""
    with pytest.raises(ValueError, match="without any sample"):
        reference.histogram_probabilities([[1, 2], [0, 0]], 0)


# Eq. 3 to 6


def test_update_by_hand():
    """Prior 1/4 and 3/4, likelihood 1/2 and 1/6: evidence 1/4, posterior halves."""
    posterior, log_evidence = reference.update([[0.25, 0.75]], np.log([[0.5, 1 / 6]]))

    np.testing.assert_allclose(posterior, [[0.5, 0.5]], rtol=1e-15)
    assert log_evidence == pytest.approx(np.log(0.25), abs=1e-15)


@given(beliefs)
def test_a_flat_likelihood_leaves_the_belief(belief):
    """Only the evidence tells of the tap."""
    posterior, log_evidence = reference.update(belief, np.full(belief.shape, -1234.5))

    np.testing.assert_allclose(posterior, belief, atol=1e-15)
    assert log_evidence == pytest.approx(-1234.5, abs=1e-9)


@given(beliefs, st.integers(0, 2**32))
def test_scaling_the_likelihood_moves_only_the_evidence(belief, seed):
    """A constant factor cancels in the posterior, even far outside the range of float64."""
    log_likelihood = np.random.default_rng(seed).normal(size=belief.shape)
    expected, log_evidence = reference.update(belief, log_likelihood)
    posterior, scaled = reference.update(belief, log_likelihood - 5000.0)

    np.testing.assert_allclose(posterior, expected, atol=1e-11)
    assert scaled == pytest.approx(log_evidence - 5000.0, abs=1e-9)


@given(beliefs, st.integers(0, 2**32))
def test_the_order_of_taps_does_not_matter(belief, seed):
    """Without moves in between, posterior and total evidence do not depend on it."""
    first, second, third = np.random.default_rng(seed).normal(size=(3, *belief.shape)) * 3
    ends = []
    for order in ((first, second, third), (third, first, second)):
        posterior, total = belief, 0.0
        for log_likelihood in order:
            posterior, log_evidence = reference.update(posterior, log_likelihood)
            total += log_evidence
        ends.append((posterior, total))

    np.testing.assert_allclose(ends[0][0], ends[1][0], atol=1e-14)
    assert ends[0][1] == pytest.approx(ends[1][1], abs=1e-12)


def test_certainty_is_a_fixed_point(rng):
    """Whoever believes in one class alone is convinced by nothing that this class can give."""
    certain = np.zeros((3, 2))
    certain[1, 1] = 1.0
    posterior, log_evidence = reference.update(certain, rng.normal(size=(3, 2)) - 800)

    assert posterior.tolist() == certain.tolist()
    assert log_evidence < -700


def test_a_subnormal_prior_survives():
    """Of two classes the one that is possible gets all belief, however little it had."""
    posterior, log_evidence = reference.update([[1.0, 5e-324]], [[-np.inf, -2.0]])

    assert posterior.tolist() == [[0.0, 1.0]]
    assert log_evidence == pytest.approx(np.log(5e-324) - 2.0)


def test_the_tiniest_prior_beats_an_even_tinier_likelihood():
    """Classes are weighed by the product, not by either factor."""
    posterior, _ = reference.update([[1e-300, 1.0]], [[0.0, -1000.0]])

    assert posterior.tolist() == [[1.0, 0.0]]


@given(beliefs, st.integers(0, 2**32))
def test_log_update_is_the_log_of_the_update(belief, seed):
    """Impossible classes included."""
    rng = np.random.default_rng(seed)
    log_likelihood = np.where(rng.random(belief.shape) < 0.2, -np.inf, rng.normal(size=belief.shape) * 5)
    possible = ((belief > 0) & (log_likelihood > -np.inf)).any()
    if not possible:
        for update, prior in ((reference.update, belief), (reference.update_log, logs(belief))):
            with pytest.raises(ZeroEvidenceError, match="impossible under every class"):
                update(prior, log_likelihood)
        return
    expected, log_evidence = reference.update(belief, log_likelihood)
    log_posterior, log_log_evidence = reference.update_log(logs(belief), log_likelihood)

    np.testing.assert_allclose(np.exp(log_posterior), expected, atol=1e-14)
    assert log_log_evidence == pytest.approx(log_evidence, abs=1e-12)


def test_log_update_carries_what_underflows():
    """A class at e^-2000 comes back."""
    log_posterior, _ = reference.update_log([[0.0, -2000.0]], [[-3000.0, 0.0]])

    assert log_posterior.tolist() == [[-1000.0, 0.0]]


@pytest.mark.parametrize("update", [reference.update, reference.update_log])
def test_impossible_taps_are_a_typed_error(update):
    """No class with belief can have given the tap: neither NaN nor a warning."""
    with pytest.raises(ZeroEvidenceError, match="impossible under every class"):
        update([[0.0, -np.inf]] if update is reference.update_log else [[1.0, 0.0]], [[-np.inf, 0.0]])


@pytest.mark.parametrize("update", [reference.update, reference.update_log])
@pytest.mark.parametrize(
    ("belief", "log_likelihood", "message"),
    [
        ([[0.5, 0.5]], [[0.0, 0.0, 0.0]], r"shape \(1, 2\), log-likelihood \(1, 3\)"),
        ([[0.5, 0.5]], [[0.0], [0.0]], "Belief has shape"),
        ([[0.5, np.nan]], [[0.0, 0.0]], "no NaN"),
        ([[0.5, 0.5]], [[0.0, np.nan]], "no NaN"),
        ([[0.5, 0.5]], [[0.0, np.inf]], "no NaN"),
    ],
)
def test_beliefs_and_likelihoods_that_do_not_fit_are_refused(update, belief, log_likelihood, message):
    """Shapes must agree without broadcasting, and values be numbers."""
    with pytest.raises(ValueError, match=message):
        update(belief, log_likelihood)


def test_marginals_by_hand():
    """Rows are positions, columns objects."""
    assert reference.where_marginal(BELIEF).tolist() == [0.375, 0.5, 0.125]
    assert reference.what_marginal(BELIEF).tolist() == [0.1875, 0.8125]


# Eq. 7 and 8


@pytest.mark.parametrize(("threshold", "what"), [(0.0, 1), (0.8, 1), (0.8125, None), (0.9, None), (1.0, None)])
def test_what_decision_needs_more_than_the_threshold(threshold, what):
    """A marginal of exactly the threshold does not fire."""
    assert reference.what_decision(BELIEF, threshold) == what


@pytest.mark.parametrize(("threshold", "where"), [(0.0, 1), (0.4, 1), (0.5, None), (1.0, None)])
def test_where_decision_needs_more_than_the_threshold(threshold, where):
    """A marginal of exactly the threshold does not fire."""
    assert reference.where_decision(BELIEF, threshold) == where


@pytest.mark.parametrize("decision", [reference.what_decision, reference.where_decision])
def test_ties_go_to_the_lowest_index(decision):
    """Also among the later classes."""
    belief = np.outer([0.2, 0.4, 0.4], [0.2, 0.4, 0.4])

    assert decision(belief, 0.0) == 1
    assert decision(np.full((4, 4), 1 / 16), 0.0) == 0


@pytest.mark.parametrize("decision", [reference.what_decision, reference.where_decision])
@pytest.mark.parametrize("threshold", [1.0, 1.5, np.inf])
def test_a_threshold_of_one_never_fires(decision, threshold):
    """Not even where rounding lifts a marginal above one."""
    assert decision(np.array([[1.0000000000000002]]), threshold) is None
    assert decision(np.array([[1.0]]), np.nextafter(1.0, 0.0)) == 0


@pytest.mark.parametrize("decision", [reference.what_decision, reference.where_decision])
def test_a_threshold_of_zero_always_fires(decision):
    """The largest marginal is positive."""
    assert decision(np.full((50, 60), 1 / 3000), 0.0) == 0


# Eq. 9 and 10

BY_HAND = {
    "uniform": [[0.625 / 4, 0.625 / 4], [0.625 / 4, 0.625 / 4], [0.125, 0.25]],
    "uniform_what": [[0.0625 / 2, 0.5625 / 2], [0.0625 / 2, 0.5625 / 2], [0.125, 0.25]],
    "prior": [[1 / 6 / (25 / 24)] * 2, [1 / 6 / (25 / 24)] * 2, [0.125 / (25 / 24), 0.25 / (25 / 24)]],
    "clamp": [[0.0, 0.0], [0.0, 0.0], [0.1875, 0.8125]],
    "circular": [[0.0, 0.5], [0.0625, 0.0625], [0.125, 0.25]],
}


@pytest.mark.parametrize("border", BORDERS)
def test_shift_by_two_of_three_by_hand(border):
    """Belief about class 0 becomes belief about class 2; 5/8 of the mass is pushed out."""
    np.testing.assert_allclose(reference.shift(BELIEF, 2, border), BY_HAND[border], atol=1e-15)
    np.testing.assert_allclose(np.exp(reference.shift_log(logs(BELIEF), 2, border)), BY_HAND[border], atol=1e-15)


@pytest.mark.parametrize("border", BORDERS)
def test_shift_mirrors(border):
    """Moving to the other side on the mirrored belief gives the mirror image."""
    for delta in range(-5, 6):
        mirrored = reference.shift(BELIEF[::-1], -delta, border)[::-1]
        np.testing.assert_allclose(reference.shift(BELIEF, delta, border), mirrored, atol=1e-15)


@given(beliefs, st.sampled_from(BORDERS))
def test_no_move_is_identity(belief, border):
    """Nothing is lost, nothing vacated."""
    np.testing.assert_allclose(reference.shift(belief, 0, border), belief, atol=1e-15)
    np.testing.assert_allclose(np.exp(reference.shift_log(logs(belief), 0, border)), belief, atol=1e-14)


@given(beliefs, st.integers(-9, 9), st.sampled_from(BORDERS))
def test_shifted_beliefs_are_beliefs(belief, delta, border):
    """They are not negative and sum to one."""
    shifted = reference.shift(belief, delta, border)

    assert (shifted >= 0).all()
    assert shifted.sum() == pytest.approx(1.0, abs=1e-14)


@given(beliefs, st.integers(-9, 9), st.sampled_from(KEEP_WHAT))
def test_these_borders_keep_the_what_marginal(belief, delta, border):
    """Moving along an object says nothing about it."""
    np.testing.assert_allclose(
        reference.what_marginal(reference.shift(belief, delta, border)), reference.what_marginal(belief), atol=1e-14
    )


def test_uniform_changes_the_what_marginal():
    """The paper's reading spreads lost mass over all objects, so the stop test must come before the move."""
    assert reference.what_marginal(reference.shift(BELIEF, 2))[1] == pytest.approx(0.25 + 0.3125)


@given(beliefs, st.integers(-4, 4), st.sampled_from(BORDERS))
def test_shift_and_back_restores_a_belief_that_lost_nothing(belief, delta, border):
    """Mass that stays in range comes back to where it was."""
    L = len(belief)
    stays = (np.arange(L) + delta >= 0) & (np.arange(L) + delta < L)
    inside = np.where(stays[:, None], belief, 0.0)
    if inside.sum() == 0 or border == "prior":
        return
    inside /= inside.sum()
    there = reference.shift(inside, delta, border)

    np.testing.assert_allclose(reference.shift(there, -delta, border), inside, atol=1e-14)


@pytest.mark.parametrize("delta", [3, 4, 1000, -3, -4, -1000])
def test_moves_as_long_as_the_range(delta):
    """All mass leaves: nothing is known of where, and what is kept or lost as the border says."""
    what = [0.1875, 0.8125]
    end = 2 if delta > 0 else 0
    clamped = np.zeros((3, 2))
    clamped[end] = what

    np.testing.assert_allclose(reference.shift(BELIEF, delta, "uniform"), np.full((3, 2), 1 / 6), atol=1e-15)
    np.testing.assert_allclose(reference.shift(BELIEF, delta, "prior"), np.full((3, 2), 1 / 6), atol=1e-15)
    np.testing.assert_allclose(reference.shift(BELIEF, delta, "uniform_what"), np.tile(what, (3, 1)) / 3, atol=1e-15)
    np.testing.assert_allclose(reference.shift(BELIEF, delta, "clamp"), clamped, atol=1e-15)
    np.testing.assert_allclose(reference.shift(BELIEF, delta, "circular"), np.roll(BELIEF, delta, 0), atol=1e-15)


@pytest.mark.parametrize("border", BORDERS)
def test_a_single_class_stays_certain(border):
    """L = M = 1 under any move."""
    for delta in (-2, -1, 0, 1, 2):
        assert reference.shift([[1.0]], delta, border).tolist() == [[1.0]]
        assert reference.shift_log([[0.0]], delta, border).tolist() == [[0.0]]


@given(beliefs, st.integers(-9, 9), st.sampled_from(BORDERS))
def test_log_shift_is_the_log_of_the_shift(belief, delta, border):
    """Impossible classes included, without NaN."""
    shifted = reference.shift_log(logs(belief), delta, border)

    assert not np.isnan(shifted).any()
    np.testing.assert_allclose(np.exp(shifted), reference.shift(belief, delta, border), atol=1e-14)


def test_log_shift_carries_what_underflows():
    """Mass at e^-2000 moves like any other."""
    shifted = reference.shift_log([[0.0, -2000.0], [-3000.0, -1500.0]], 1, "clamp")

    np.testing.assert_allclose(shifted, [[-np.inf, -np.inf], [0.0, -1500.0]])


@pytest.mark.parametrize("shift", [reference.shift, reference.shift_log])
def test_other_borders_are_refused(shift):
    """The message lists those there are."""
    with pytest.raises(ValueError, match=r"uniform, uniform_what, prior, clamp, circular, got 'reflect'"):
        shift(BELIEF, 1, "reflect")


def test_fixation_moves_cancel_the_error():
    """x_fixed - x_MAP steps."""
    assert [reference.fixation_move(where, 7) for where in (0, 7, 15)] == [7, 0, -8]


# The same equations in exact rational arithmetic, cell by cell


def exact_posterior(prior, counts, pseudocount, bins):
    """Eq. 1 to 4 at power 1 in fractions: posterior and evidence."""
    L, M, K, B = counts.shape
    joint = {}
    for l, m in product(range(L), range(M)):
        joint[l, m] = prior[l, m]
        for j, k in product(range(len(bins)), range(K)):
            total = sum(int(c) for c in counts[l, m, k]) + B * pseudocount
            joint[l, m] *= (int(counts[l, m, k, bins[j, k]]) + pseudocount) / total
    evidence = sum(joint.values())
    return {cell: value / evidence for cell, value in joint.items()}, evidence


def exact_shift(belief, delta, border, L, M):
    """Eq. 9 in fractions, as a sum over the cells that each cell receives from."""
    stays = [l for l in range(L) if 0 <= l + delta < L]
    lost = {m: sum((belief[l, m] for l in range(L) if l not in stays), Fraction(0)) for m in range(M)}
    vacated = [l for l in range(L) if l - delta not in stays]
    shifted = {}
    for l, m in product(range(L), range(M)):
        source = l - delta
        if border == "circular":
            shifted[l, m] = belief[source % L, m]
        elif border == "clamp":
            received = [s for s in range(L) if min(max(s + delta, 0), L - 1) == l]
            shifted[l, m] = sum((belief[s, m] for s in received), Fraction(0))
        elif l not in vacated:
            shifted[l, m] = belief[source, m]
        elif border == "uniform":
            shifted[l, m] = sum(lost.values()) / (len(vacated) * M)
        elif border == "uniform_what":
            shifted[l, m] = lost[m] / len(vacated)
        else:
            shifted[l, m] = Fraction(1, L * M)
    total = sum(shifted.values())
    return {cell: value / total for cell, value in shifted.items()}


@given(
    sizes=st.permutations([1, 2, 3, 4, 5]),
    seed=st.integers(0, 2**32),
    border=st.sampled_from(BORDERS),
    pseudocount=st.sampled_from([Fraction(1, 100), Fraction(1), Fraction(7, 3)]),
)
def test_two_taps_and_a_move_in_fractions(sizes, seed, border, pseudocount):
    """Posterior, evidence and shifted belief agree with exact arithmetic at power 1."""
    L, M, K, J, B = sizes
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, 9, size=(L, M, K, B))
    bins = rng.integers(B, size=(2, J, K))
    delta = int(rng.integers(-L - 1, L + 2))
    first, evidence = exact_posterior(
        dict.fromkeys(product(range(L), range(M)), Fraction(1, L * M)), counts, pseudocount, bins[0]
    )
    moved = exact_shift(first, delta, border, L, M)
    second, next_evidence = exact_posterior(moved, counts, pseudocount, bins[1])

    log_prob = np.log(reference.histogram_probabilities(counts, float(pseudocount)))
    belief = np.full((L, M), 1 / (L * M))
    steps = []
    for tap in bins:
        log_likelihood = reference.tap_log_likelihood(tap, log_prob, "none")
        belief, log_evidence = reference.update(belief, log_likelihood)
        steps.append((belief, np.exp(log_evidence)))
        belief = reference.shift(belief, delta, border)

    for exact, actual in ((first, steps[0][0]), (second, steps[1][0])):
        for cell, value in exact.items():
            assert actual[cell] == pytest.approx(float(value), abs=1e-12)
    assert steps[0][1] == pytest.approx(float(evidence), rel=1e-12)
    assert steps[1][1] == pytest.approx(float(next_evidence), rel=1e-12)
    shifted = reference.shift(steps[0][0], delta, border)
    for cell, value in moved.items():
        assert shifted[cell] == pytest.approx(float(value), abs=1e-12)
