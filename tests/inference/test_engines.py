"""All ways of computing the posterior agree, with each other and with sums over every path of classes."""

from dataclasses import replace
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from slow_cases import slow_but
from solidtouch.inference import reference
from solidtouch.inference.engines.engine import make_engine
from solidtouch.inference.engines.enumeration import (
    MAX_SEQUENCE,
    SequenceUnderflowError,
    check_kernel_border,
    enumerate_sequence,
)
from solidtouch.inference.reference import BORDERS, ZeroEvidenceError
from solidtouch.inference.trials import gpu as device
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.measurement.states import States
from solidtouch.models.settings import FitSettings
from solidtouch.models.touch import KERNEL_BORDERS

ENGINES = ("numpy", "numpyro", "filter")
IMPOSSIBLE = "impossible under every class"

seeds = st.integers(0, 2**32)
powers = st.sampled_from(["J", "JK", "none", 0.3])
SIZES = [
    (1, 3, 2, 4, 6, 5),
    (3, 1, 4, 2, 5, 6),
    (4, 2, 5, 1, 1, 3),
    (2, 5, 1, 6, 3, 4),
]
"""L, M, K, J, B and taps, few of them, as all engines compile for each."""


def engines(model, border):
    names = ENGINES if border in KERNEL_BORDERS else ("numpy", "filter")
    return [make_engine(name, model, border) for name in names]


def follow(engine, taps, deltas, log_belief=None):
    """Log beliefs after every tap and summed log evidence, up to the first impossible tap."""
    log_belief = engine.model.log_prior if log_belief is None else log_belief
    log_beliefs, log_evidence = [], []
    for t, tap in enumerate(taps):
        log_belief = engine.shift(log_belief, deltas[t - 1]) if t else log_belief
        try:
            log_belief, evidence = engine.update(log_belief, tap)
        except ZeroEvidenceError:
            break
        log_beliefs.append(log_belief)
        log_evidence.append(evidence)
    return np.array(log_beliefs), np.cumsum(log_evidence)


def assert_agree(expected, actual):
    """Same taps survived; beliefs, log beliefs and evidence within 1e-10."""
    assert expected[1].shape == actual[1].shape
    if len(expected[0]):
        np.testing.assert_allclose(np.exp(actual[0]), np.exp(expected[0]), rtol=0, atol=1e-10)
        compared = expected[0] > -600
        np.testing.assert_allclose(actual[0][compared], expected[0][compared], rtol=0, atol=1e-10 * len(expected[0]))
        np.testing.assert_allclose(actual[1], expected[1], rtol=0, atol=1e-10 * len(expected[0]))


def random_log_belief(rng, shape):
    """A normalised log belief that spans thousands of units and holds impossible classes."""
    log_weight = np.where(rng.random(shape) < 0.3, -np.inf, -rng.exponential(rng.choice([1.0, 1000.0]), size=shape))
    log_weight.flat[rng.integers(log_weight.size)] = 0.0
    return log_weight - np.logaddexp.reduce(log_weight.ravel())


# Agreement


@settings(max_examples=25, deadline=None)
@given(
    sizes=st.sampled_from(SIZES),
    seed=seeds,
    border=st.sampled_from(BORDERS),
    power=powers,
    pseudocount=st.sampled_from([0.0, 0.01, 1.0]),
    value_range=st.sampled_from(["global", "taxel"]),
)
def test_engines_agree(make_model, draw_samples, sizes, seed, border, power, pseudocount, value_range):
    """On sequences with moves beyond the range, for pairwise different sizes."""
    L, M, K, J, B, T = sizes
    rng = np.random.default_rng(seed)
    untrained = [(int(rng.integers(L)), int(rng.integers(M)))] if L * M > 2 else []
    model = make_model(
        L, M, K, J, B, seed=seed, power=power, pseudocount=pseudocount, value_range=value_range, untrained=untrained
    )
    taps = draw_samples(model, T, seed)
    taps[rng.random(taps.shape) < 0.05] += 100.0
    deltas = rng.integers(-L - 1, L + 2, size=T - 1).tolist()
    first, *others = [follow(engine, taps, deltas) for engine in engines(model, border)]

    for other in others:
        assert_agree(first, other)


@settings(max_examples=60, deadline=None)
@given(seed=seeds, border=st.sampled_from(BORDERS), delta=st.integers(-5, 5), pseudocount=st.sampled_from([0.0, 0.01]))
def test_engines_agree_on_any_belief(make_model, draw_samples, seed, border, delta, pseudocount):
    """From beliefs that hold -inf and e^-1000 as from any other."""
    rng = np.random.default_rng(seed)
    model = make_model(seed=seed, pseudocount=pseudocount, untrained=[(2, 1)])
    log_belief = random_log_belief(rng, model.grid.shape)
    first, *others = [
        follow(engine, draw_samples(model, 2, seed), [delta], log_belief) for engine in engines(model, border)
    ]

    for other in others:
        assert_agree(first, other)


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("shape", [(1, 4), (3, 1), (1, 1), (5, 2)])
def test_compiled_shifts_agree(make_model, rng, border, shape):
    """For every move, also far beyond the range and with impossible classes."""
    model = make_model(*shape)
    log_belief = random_log_belief(rng, shape)
    for delta in (0, 1, -1, 2, -3, 4, 5, -6, 10**6, -(10**6)):
        first, *others = [engine.shift(log_belief, delta) for engine in engines(model, border)]
        for other in others:
            np.testing.assert_allclose(other, first, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", ENGINES)
def test_engines_speak_float64(make_model, draw_samples, name):
    """Without JAX being set to it."""
    model = make_model()
    engine = make_engine(name, model)
    log_belief, log_evidence = engine.update(engine.model.log_prior, draw_samples(model, 1)[0].astype(np.float32))

    assert not jax.config.jax_enable_x64
    assert engine.name == name
    assert (log_belief.dtype, engine.shift(log_belief, 1).dtype, type(log_evidence)) == (np.float64, np.float64, float)


@pytest.mark.parametrize("name", ENGINES)
def test_untrained_classes_never_come_back_by_a_tap(make_model, name):
    """Neither by a move."""
    model = make_model(untrained=[(1, 2)])
    engine = make_engine(name, model, "circular")
    moved = engine.shift(engine.model.log_prior, 1)
    log_belief, _ = engine.update(moved, np.full((5, 2), 9.0))

    assert np.isneginf(engine.model.log_prior[1, 2])
    assert np.isneginf(moved[1, 2])
    assert np.isneginf(log_belief[1, 2])


# Whole sequences


def over_all_paths(log_likelihood, log_prior, deltas, border):
    """Log evidence and smoothed posteriors as a sum over every path of classes; log-likelihoods are (T, L, M)."""
    T, L, M = log_likelihood.shape
    transitions, trained = [], log_prior > -np.inf
    for delta in deltas:
        rows = []
        for l, m in product(range(L), range(M)):
            certain = np.zeros((L, M))
            certain[l, m] = 1.0
            after = reference.shift(certain, delta, border, trained=trained) if trained[l, m] else certain
            rows.append(after.ravel())
        transitions.append(np.array(rows))
    likelihood, prior = np.exp(log_likelihood).reshape(T, L * M), np.exp(log_prior).ravel()
    evidence, smoothed = 0.0, np.zeros((T, L * M))
    for path in product(range(L * M), repeat=T):
        weight = prior[path[0]] * likelihood[0, path[0]]
        for t in range(1, T):
            weight *= transitions[t - 1][path[t - 1], path[t]] * likelihood[t, path[t]]
        evidence += weight
        for t in range(T):
            smoothed[t, path[t]] += weight
    return np.log(evidence), (smoothed / evidence).reshape(T, L, M)


def assert_enumerated(model, taps, deltas, border, log_evidence, smoothed):
    """The enumerated sequence has this evidence and these posteriors, and filtered ones of the recursion."""
    posterior = enumerate_sequence(model, taps, deltas, border)
    log_beliefs, evidence = follow(make_engine("numpy", model, border), taps, deltas)
    np.testing.assert_allclose(posterior.smoothed, smoothed, rtol=0, atol=1e-10)
    np.testing.assert_allclose(posterior.filtered, np.exp(log_beliefs), rtol=0, atol=1e-10)
    np.testing.assert_allclose(posterior.log_evidence, evidence, rtol=0, atol=1e-10)
    assert posterior.log_evidence[-1] == pytest.approx(log_evidence, abs=1e-10)


@pytest.mark.parametrize("border", slow_but(("uniform", "clamp"), KERNEL_BORDERS))
@pytest.mark.parametrize(
    "sizes",
    [
        (2, 3, 4, 1, 5, 3),
        *(pytest.param(sizes, marks=pytest.mark.slow) for sizes in ((4, 1, 2, 5, 6, 2), (1, 3, 2, 5, 6, 2))),
        (1, 1, 2, 3, 4, 2),
    ],
)
@pytest.mark.parametrize("pseudocount", slow_but([0.0], [0.0, 0.3]))
def test_enumerated_sequences_agree_with_all_paths(make_model, draw_samples, rng, border, sizes, pseudocount):
    """Smoothed posteriors and evidence are the sums over all paths, filtered ones those of the recursion."""
    L, M, K, J, B, T = sizes
    untrained = [(L - 1, 0)] if L > 1 and M > 1 else []
    model = make_model(L, M, K, J, B, seed=3, taps=20, pseudocount=pseudocount, untrained=untrained)
    taps = draw_samples(model, T, seed=1, where=0)
    deltas = rng.integers(-L - 1, L + 2, size=T - 1).tolist() if pseudocount else [0] * (T - 1)
    log_evidence, smoothed = over_all_paths(model.log_likelihood(taps), model.log_prior, deltas, border)

    assert_enumerated(model, taps, deltas, border, log_evidence, smoothed)


@pytest.mark.parametrize("power", slow_but([2.5], ["JK", "none", 2.5]))
def test_enumerated_sequences_hold_every_power(make_model, draw_samples, power):
    """The exponent scales every tap, not the moves."""
    model = make_model(2, 3, 4, 1, 5, power=power, seed=4)
    taps = draw_samples(model, 3)
    posterior = enumerate_sequence(model, taps, [-1, 1], "clamp")
    log_evidence, smoothed = over_all_paths(model.log_likelihood(taps), model.log_prior, [-1, 1], "clamp")

    np.testing.assert_allclose(posterior.smoothed, smoothed, rtol=0, atol=1e-10)
    assert posterior.log_evidence[-1] == pytest.approx(log_evidence, abs=1e-10)


IN_STATES = {
    "histogram": lambda taps, states: replace(fit(taps, taps.grid(), bins=7), states=states),
    "profile-mvn": lambda taps, states: replace(
        fit_model("profile-mvn", taps, taps.grid(), FitSettings(bins=7)).model, states=states
    ),
}


PAIRS = list(product(IN_STATES, KERNEL_BORDERS))


@pytest.mark.parametrize(("kind", "border"), slow_but([*PAIRS[:4:2], *PAIRS[5::2]], PAIRS))
def test_enumerated_sequences_in_states_agree_with_all_paths(make_taps, border, kind):
    """The state is drawn once: each state's paths are summed apart and weighed by its evidence."""
    states = States(np.array([1.0, 1.4, 0.7]), np.array([0.0, -0.5, 0.6]), np.log([0.5, 0.2, 0.3]))
    made, deltas, M = make_taps(L=3, M=2, J=5, K=4), [2, -4], 2
    model, taps = IN_STATES[kind](made, states), made.taps[[3, 9, 30]]
    log_likelihood, parts = model.log_likelihood(taps), []
    for s in range(3):
        of_state = slice(s * M, (s + 1) * M)
        log_prior = model.log_prior[:, of_state] - states.log_prior[s]
        parts.append(over_all_paths(log_likelihood[:, :, of_state], log_prior, deltas, border))
    evidences = states.log_prior + [part[0] for part in parts]
    log_evidence = np.logaddexp.reduce(evidences)
    smoothed = np.concatenate([np.exp(e - log_evidence) * p[1] for e, p in zip(evidences, parts, strict=True)], axis=2)

    assert_enumerated(model, taps, deltas, border, log_evidence, smoothed)


def two_objects(make_model, peak, pseudocount, power="none", J=1):
    """One position and two objects, each nearly always in its own of two bins."""
    model = make_model(1, 2, 1, J, 2, pseudocount=pseudocount, power=power)
    model.counts[0] = [[[peak, 0]], [[0, peak]]]
    return model


def test_enumerated_sequences_that_outweigh_the_stand_in_for_zero_are_refused(make_model):
    """Where the only possible paths are as unlikely as an impossible one, the answer would be wrong without a sign."""
    model = two_objects(make_model, 10**6, 0.01, J=40)
    taps = np.array([-1.0, 1.0])[:, None, None] * np.ones((2, 40, 1))
    log_beliefs, _ = follow(make_engine("numpy", model), taps, [0])
    alike, _ = follow(make_engine("numpy", model), taps[[0, 0]], [0])

    np.testing.assert_allclose(np.exp(log_beliefs[-1]), [[0.5, 0.5]])
    with pytest.raises(SequenceUnderflowError, match="Enumerating 2 taps at once underflowed, as funsor contracts"):
        enumerate_sequence(model, taps, [0])
    np.testing.assert_allclose(enumerate_sequence(model, taps[[0, 0]], [0]).filtered, np.exp(alike), atol=1e-10)


def test_enumerated_sequences_that_are_impossible_are_refused(make_model):
    """Each tap is possible under one object, but not both under the same."""
    model = two_objects(make_model, 5, 0.0)

    with pytest.raises(SequenceUnderflowError, match="Enumerating 2 taps"):
        enumerate_sequence(model, np.array([-1.0, 1.0]).reshape(2, 1, 1), [0])


def test_a_spread_beyond_the_stand_in_for_zero_is_weighed(make_model):
    """One tap that tells classes apart by e^737 is observed by its likelihoods, not by counts."""
    model = two_objects(make_model, 10**6, 0.01, J=40)
    tap = np.ones((1, 40, 1))
    log_beliefs, evidence = follow(make_engine("numpy", model), tap, [])
    posterior = enumerate_sequence(model, tap, [])

    assert log_beliefs[0, 0, 0] < -700
    np.testing.assert_allclose(posterior.filtered, np.exp(log_beliefs), rtol=0, atol=1e-15)
    np.testing.assert_allclose(posterior.log_evidence, evidence, rtol=0, atol=1e-10)


def test_results_that_are_not_finite_are_an_error(make_model, draw_samples, monkeypatch):
    """They never reach the caller."""
    model = make_model()

    def underflown(arguments, prefixes):
        return jnp.zeros(2), jnp.full((2, 2, 3, 4), jnp.nan)

    monkeypatch.setattr("solidtouch.inference.engines.enumeration._sequence", underflown)
    with pytest.raises(SequenceUnderflowError, match="Enumerating 2 taps at once underflowed"):
        enumerate_sequence(model, draw_samples(model, 2), [1])


def test_impossible_classes_stay_impossible_beside_long_taps(make_model, draw_samples):
    """With hundreds of samples at power 1 even the right class is unlikely; an impossible one is still more so."""
    model = make_model(1, 2, 3, 200, 4, taps=9, power="none", pseudocount=0.0)
    model.counts[0, 0] = 450
    model.counts[0, 1] = [1800, 0, 0, 0]
    taps = np.full((2, 200, 3), -1.4)
    taps[:, 0, 0] = 1.9
    posterior = enumerate_sequence(model, taps, [0])

    np.testing.assert_allclose(posterior.filtered, [[[1.0, 0.0]]] * 2, atol=1e-15)
    np.testing.assert_allclose(posterior.log_evidence, np.log(0.5) + 600 * np.log(0.25) * np.array([1, 2]), rtol=1e-12)


# Long sequences

A_TAP, B_TAP = np.array([[-1.0]]), np.array([[1.0]])


@pytest.mark.parametrize("name", ENGINES)
def test_engines_recover_from_any_belief(make_model, name):
    """After 400 taps of A and 800 of B they believe B, though A stood against it by e^-2000."""
    engine = make_engine(name, two_objects(make_model, 1, 0.01))
    log_belief = engine.model.log_prior
    for _ in range(400):
        log_belief, _ = engine.update(log_belief, A_TAP)
    lowest = log_belief[0, 1]
    for _ in range(800):
        log_belief, _ = engine.update(log_belief, B_TAP)

    assert lowest < -1800
    assert np.exp(log_belief[0, 1]) == 1.0


@pytest.mark.parametrize("border", slow_but(("uniform", "clamp"), BORDERS))
def test_ten_thousand_taps_with_moves(border):
    """Log beliefs on arrays and of the reference stay finite and agree."""
    rng = np.random.default_rng(5)
    T, shape = 10_000, (3, 2)
    log_likelihood = 3 * rng.normal(size=(T, *shape))
    deltas = rng.choice([-2, -1, 0, 0, 0, 1, 2], size=T)
    expected, log_evidence = np.log(np.full(shape, 1 / 6)), 0.0
    for t in range(T):
        expected, evidence = reference.update_log(expected, log_likelihood[t])
        expected = reference.shift_log(expected, int(deltas[t]), border)
        log_evidence += evidence

    def step(log_belief, tap):
        log_belief, evidence = device.update(log_belief, tap[0])
        return device.shift(log_belief, tap[1], BORDERS.index(border)), evidence

    with jax.enable_x64(True):
        prior = np.log(np.full(shape, 1 / 6))
        actual, evidences = jax.lax.scan(step, jnp.asarray(prior), (jnp.asarray(log_likelihood), jnp.asarray(deltas)))
        actual, evidences = np.asarray(actual), np.asarray(evidences)

    assert np.isfinite(evidences).all()
    np.testing.assert_allclose(np.exp(actual), np.exp(expected), rtol=0, atol=1e-10)
    assert evidences.sum() == pytest.approx(log_evidence, abs=1e-10 * T)


# Errors


@pytest.mark.parametrize("name", ENGINES)
def test_an_impossible_tap_is_a_typed_error(make_model, name):
    """Without pseudocount a tap may contradict all that was believed."""
    engine = make_engine(name, two_objects(make_model, 5, 0.0))
    log_belief, _ = engine.update(engine.model.log_prior, A_TAP)

    with pytest.raises(ZeroEvidenceError, match=IMPOSSIBLE):
        engine.update(log_belief, B_TAP)


def test_an_impossible_tap_is_a_typed_error_in_a_sequence(make_model):
    """It is found before anything is summed."""
    model = two_objects(make_model, 5, 0.0)
    model.counts[:] = [[[[5, 0]], [[7, 0]]]]

    with pytest.raises(ZeroEvidenceError, match=IMPOSSIBLE):
        enumerate_sequence(model, np.array([A_TAP, B_TAP]), [0])


@pytest.mark.parametrize("name", ENGINES)
@pytest.mark.parametrize(
    ("tap", "message"),
    [
        (np.zeros((4, 2)), "5 samples and 2 taxels as in the model, got shape"),
        (np.zeros((5, 3)), "5 samples and 2 taxels as in the model, got shape"),
        (np.zeros((5, 1)), "5 samples and 2 taxels as in the model, got shape"),
        (np.zeros(5), "5 samples and 2 taxels as in the model, got shape"),
        (np.full((5, 2), np.nan), "Samples must not be NaN"),
    ],
    ids=["samples", "taxels", "one taxel", "flat", "NaN"],
)
def test_taps_that_do_not_fit_the_model_are_refused(make_model, name, tap, message):
    """All engines refuse the same."""
    engine = make_engine(name, make_model())

    with pytest.raises(InputError, match=message):
        engine.update(engine.model.log_prior, tap)


def test_prior_is_no_kernel(make_model, draw_samples):
    """The NumPyro routes refuse it by name, the others take it."""
    model = make_model()
    with pytest.raises(InputError, match="border 'prior', which renormalises the belief and is not a Markov kernel"):
        make_engine("numpyro", model, "prior")
    with pytest.raises(InputError, match="do not support border 'prior'"):
        enumerate_sequence(model, draw_samples(model, 2), [1], "prior")
    with pytest.raises(InputError, match="uniform, uniform_what, clamp, circular"):
        check_kernel_border("prior")
    assert [make_engine(name, model, "prior").name for name in ("numpy", "filter")] == ["numpy", "filter"]


@pytest.mark.parametrize(
    ("name", "border", "message"),
    [("torch", "uniform", "numpy, numpyro or filter, got 'torch'"), ("numpy", "wall", "circular, got 'wall'")],
)
def test_unknown_engines_and_borders_are_refused(make_model, name, border, message):
    """The message lists what there is."""
    with pytest.raises(InputError, match=message):
        make_engine(name, make_model(), border)


@pytest.mark.parametrize(("T", "moves"), [(0, 0), (2, 2), (3, 1), (MAX_SEQUENCE + 1, MAX_SEQUENCE)])
def test_sequences_of_other_lengths_are_refused(make_model, T, moves):
    """1 to 20 taps with a move between two."""
    with pytest.raises(InputError, match=f"got {T} taps and {moves} moves"):
        enumerate_sequence(make_model(), np.zeros((T, 5, 2)), [0] * moves)
