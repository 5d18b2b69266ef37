"""Other people's packages as oracles: what they can express of the job they compute as this project does.

=============  ==========================================================================================
package        what it is asked
=============  ==========================================================================================
scikit-learn   bins, Eq. 2, the root of Eq. 1 and the belief after taps without moves, from raw samples
hmmlearn       the belief and the evidence without moves: a hidden Markov model whose state stays
dynamax        the same, and with moves under every border that is a transition matrix
pymdp          likelihood with the root, beliefs with moves, from the histogram of each tap
=============  ==========================================================================================

The border `prior` is no transition matrix and none of them has it. dynamax raises what is below 1e-15 of the largest
to that, and pymdp probabilities below 2.2e-16, so beliefs are kept above.

A package that is not installed is skipped. The first two come with the tests' own requirements, dynamax with
`pip install --pre --group peers`: it needs a pre-release of one of its own. pymdp requires an older JAX than this
project, so it runs in another Python:

    python -m venv pymdp-venv
    pymdp-venv/bin/pip install inferactively-pymdp==1.0.4
    SOLIDTOUCH_PYMDP_PYTHON=pymdp-venv/bin/python python -m pytest tests/inference/test_peers.py -rs
"""

import os

import jax
import numpy as np
import pytest
from solidtouch.inference.engines.engine import NumpyEngine
from solidtouch.models.measurement.histogram import fit

from benchmarks.peers.packages import PYMDP, run_pymdp

KERNELS = ("uniform", "uniform_what", "clamp", "circular")
MOVES = (2, -1, 0, 1, -2, 5, 1)


def beliefs(model, taps, moves=None, border="uniform"):
    """What the reference equations believe after every tap (T, L M), and the log evidence of every tap (T,)."""
    engine, log_belief, found, evidence = NumpyEngine(model, border), model.log_prior, [], []
    for tap, move in zip(taps, (0, *(moves or [0] * (len(taps) - 1))), strict=True):
        log_belief, log_evidence = engine.update(engine.shift(log_belief, move) if found else log_belief, tap)
        found.append(np.exp(log_belief).ravel())
        evidence.append(log_evidence)
    return np.array(found), np.array(evidence)


def transition(trained, move, border):
    """Eq. 9 as a matrix from the class before a move to that after it, class by class; shape (L M, L M)."""
    L, M = trained.shape
    matrix, vacated, lost = np.zeros((L, M, L, M)), trained.copy(), []
    for l, m in np.argwhere(trained):
        target = (l + move) % L if border == "circular" else l + move
        if border == "clamp":
            end = min(max(target, 0), L - 1)
            target = min(np.flatnonzero(trained[:, m]), key=lambda place: abs(place - end))
        if 0 <= target < L and trained[target, m]:
            matrix[l, m, target, m], vacated[target, m] = 1, False
        else:
            lost.append((l, m))
    for l, m in lost:
        if border == "circular":
            rank = [other for other, object_ in lost if object_ == m].index(l)
            matrix[l, m, np.flatnonzero(vacated[:, m])[rank], m] = 1
        elif border == "uniform_what":
            matrix[l, m, :, m] = vacated[:, m] / vacated[:, m].sum()
        else:
            matrix[l, m] = vacated / vacated.sum()
    return matrix.reshape(L * M, L * M)


def occupation(model, taps):
    """How often each tap's samples of taxel k fall into bin b, shape (T, K, B)."""
    return (model.bins(taps)[..., np.newaxis] == np.arange(model.counts.shape[3])).sum(axis=1)


@pytest.mark.parametrize("power", ["J", "JK", "none", 0.03])
def test_scikit_learn_has_the_same_posteriors_from_raw_samples(make_taps, power):
    """`KBinsDiscretizer` finds the bins, `MultinomialNB` counts, smoothes and decides; a root is a scale of counts."""
    pytest.importorskip("sklearn", reason="scikit-learn is not installed")
    from sklearn.naive_bayes import MultinomialNB
    from sklearn.preprocessing import KBinsDiscretizer

    train, test = make_taps(L=3, M=4, K=5, seed=1), make_taps(L=3, M=4, K=5, seed=2)
    grid = train.grid()
    model = fit(train, grid, bins=9, value_range="taxel", pseudocount=0.3, power=power)
    discretizer = KBinsDiscretizer(9, encode="onehot-dense", strategy="uniform", subsample=None)
    discretizer.fit(train.taps.reshape(-1, 5))

    def counts(taps):
        return discretizer.transform(taps.reshape(-1, 5)).reshape(len(taps), -1, 5 * 9).sum(axis=1)

    where, what = train.indices(grid)
    classifier = MultinomialNB(alpha=0.3, class_prior=np.full(12, 1 / 12)).fit(counts(train.taps), where * 4 + what)
    taps = test.taps[::9]
    expected, _ = beliefs(model, taps)
    single = np.array([beliefs(model, taps[n : n + 1])[0][0] for n in range(len(taps))])

    np.testing.assert_allclose(classifier.predict_proba(model.exponent * counts(taps)), single, rtol=0, atol=1e-12)
    summed = model.exponent * counts(taps).cumsum(axis=0)
    np.testing.assert_allclose(classifier.predict_proba(summed), expected, rtol=0, atol=1e-12)
    assert np.ptp(single.max(axis=1)) > 0.01


def test_scikit_learn_has_the_same_log_likelihoods(make_taps):
    """The joint ones less the logs of the prior and of 1/K, which `MultinomialNB` has for every sample."""
    pytest.importorskip("sklearn", reason="scikit-learn is not installed")
    from sklearn.naive_bayes import MultinomialNB

    train, test = make_taps(K=5, seed=1), make_taps(K=5, seed=2)
    model = fit(train, train.grid(), bins=9, pseudocount=0.3)
    classes, J = model.grid.L * model.grid.M, model.preprocessing.samples
    classifier = MultinomialNB(alpha=0.3).fit(model.counts.reshape(classes, -1), np.arange(classes))
    joint = classifier.predict_joint_log_proba(occupation(model, test.taps).reshape(len(test), -1) / J)
    expected = model.log_likelihood(test.taps).reshape(len(test), classes)

    np.testing.assert_allclose(joint + np.log(classes) + 5 * np.log(5), expected, rtol=0, atol=1e-11)


def test_hmmlearn_has_the_same_beliefs_from_the_samples_themselves(make_model, draw_samples):
    """At power 1 every sample is an observation of a state that stays, its symbol the taxel and the bin."""
    pytest.importorskip("hmmlearn", reason="hmmlearn is not installed")
    from hmmlearn.hmm import CategoricalHMM

    model = make_model(power="none", pseudocount=0.5)
    (L, M, K, B), J = model.counts.shape, model.preprocessing.samples
    taps = draw_samples(model, 6, seed=3, where=1, what=2)
    expected, evidence = beliefs(model, taps)
    hmm = CategoricalHMM(L * M, n_features=K * B)
    hmm.startprob_, hmm.transmat_ = np.full(L * M, 1 / (L * M)), np.eye(L * M)
    hmm.emissionprob_ = model.probabilities.reshape(L * M, K * B) / K
    symbols = (model.bins(taps) + B * np.arange(K)).reshape(-1, 1)
    for t in range(6):
        seen = symbols[: (t + 1) * J * K]
        np.testing.assert_allclose(hmm.predict_proba(seen)[-1], expected[t], rtol=0, atol=1e-12)
        log_evidence = hmm.score(seen) + len(seen) * np.log(K)
        np.testing.assert_allclose(log_evidence, evidence[: t + 1].sum(), rtol=1e-12)


def test_hmmlearn_has_the_same_beliefs_from_the_likelihoods_of_taps(make_model, draw_samples):
    """With the root every tap is a symbol; what its probabilities leave of 1 goes to a symbol that never comes."""
    pytest.importorskip("hmmlearn", reason="hmmlearn is not installed")
    from hmmlearn.hmm import CategoricalHMM

    model = make_model(power="J")
    classes, T = model.grid.L * model.grid.M, 20
    taps = draw_samples(model, T)
    expected, evidence = beliefs(model, taps)
    likelihood = np.exp(model.log_likelihood(taps)).reshape(T, classes).T
    scale = 1 / likelihood.sum(axis=1).max()
    hmm = CategoricalHMM(classes, n_features=T + 1)
    hmm.startprob_, hmm.transmat_ = np.full(classes, 1 / classes), np.eye(classes)
    hmm.emissionprob_ = np.column_stack([scale * likelihood, 1 - scale * likelihood.sum(axis=1)])
    for t in range(T):
        symbols = np.arange(t + 1)[:, np.newaxis]
        np.testing.assert_allclose(hmm.predict_proba(symbols)[-1], expected[t], rtol=0, atol=1e-12)
        log_evidence = hmm.score(symbols) - (t + 1) * np.log(scale)
        np.testing.assert_allclose(log_evidence, evidence[: t + 1].sum(), rtol=0, atol=1e-10)


@pytest.mark.filterwarnings("ignore")  # those that importing it gives
@pytest.mark.parametrize("border", ["passive", *KERNELS])
def test_dynamax_has_the_same_beliefs_and_evidence(make_model, draw_samples, border):
    """Moves are transition matrices that differ from tap to tap; also over classes that were never trained."""
    pytest.importorskip("dynamax", reason="dynamax is not installed")
    from dynamax.hidden_markov_model import hmm_filter

    model = make_model(power="J", pseudocount=0.5, untrained=[(0, 1)])
    L, M = model.grid.shape
    moves = [0] * len(MOVES) if border == "passive" else MOVES
    used = "uniform" if border == "passive" else border
    taps = draw_samples(model, len(moves) + 1)
    expected, evidence = beliefs(model, taps, moves, used)
    matrices = np.array([transition(model.trained, move, used) for move in (*moves, 0)])
    with jax.enable_x64(True):
        log_likelihood = jax.numpy.asarray(model.log_likelihood(taps).reshape(len(taps), L * M))
        found = hmm_filter(np.exp(model.log_prior).ravel(), jax.numpy.asarray(matrices), log_likelihood)
        found = jax.tree.map(np.asarray, found)

    np.testing.assert_allclose(found.filtered_probs, expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.marginal_loglik, evidence.sum(), rtol=0, atol=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("border", ["passive", *KERNELS])
def test_pymdp_has_the_same_beliefs(make_model, draw_samples, border):
    """One factor of all classes, a modality per taxel that observes histogram/J, an action for every move."""
    if not os.environ.get(PYMDP):
        pytest.skip(f"{PYMDP} does not name a Python with inferactively-pymdp 1.0.4")
    model = make_model(K=3, power="J")
    (L, M, K, B), J = model.counts.shape, model.preprocessing.samples
    moves = [0] * len(MOVES) if border == "passive" else MOVES
    used = "uniform" if border == "passive" else border
    taps = draw_samples(model, len(moves) + 1)
    expected, _ = beliefs(model, taps, moves, used)
    kinds = sorted({*moves, 0})
    given = {
        "A": model.probabilities.reshape(L * M, K, B).transpose(1, 2, 0),
        "B": np.stack([transition(model.trained, move, used).T for move in kinds], axis=-1),
        "D": np.full(L * M, 1 / (L * M)),
        "observed": occupation(model, taps) / J,
        "action": [kinds.index(move) for move in (*moves, 0)],
    }

    np.testing.assert_allclose(run_pymdp(given), expected, rtol=0, atol=1e-12)
