"""The plain likelihood of a tap, against conditional normals and sums written out."""

from dataclasses import replace
from itertools import product

import jax
import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import norm
from solidtouch.inference import reference
from solidtouch.inference import reference_models as plain
from solidtouch.models.measurement.likelihood.binned import BinnedTap
from solidtouch.models.measurement.likelihood.bins import TableForm
from solidtouch.models.measurement.likelihood.forms import GaussianForm
from solidtouch.models.measurement.states import States

Q, L, H, J, K, B = 2, 3, 4, 5, 6, 7


def lower_unit(rng, *shape):
    return np.tril(0.4 * rng.normal(size=(*shape, shape[-1])), -1) + np.eye(shape[-1])


def gaussian_form(rng, per_taxel=True, mixes=True):
    log_weight = np.log(rng.dirichlet(np.ones(Q)))
    mean, scale = rng.normal(size=(Q, L, H, J, K)), rng.uniform(0.5, 2.0, size=(Q, L, H, J, K))
    time = lower_unit(rng, K if per_taxel else 1, J)
    return GaussianForm(mean, scale, time, lower_unit(rng, L, H, K) if mixes else np.zeros((1, 1, 0, 0)), log_weight)


def whitening(form, l, h):
    """The matrix that makes innovations of residuals, both in the order of time and then of taxels."""
    time = np.broadcast_to(form.time, (K, J, J))
    taxel = form.taxel[l, h] if form.taxel.shape[-1] else np.eye(K)
    matrix = np.zeros((J, K, J, K))
    for j, k, i, p in product(range(J), range(K), range(J), range(K)):
        matrix[j, k, i, p] = taxel[k, p] * time[p, j, i]
    return matrix.reshape(J * K, J * K)


@pytest.mark.parametrize("per_taxel", [True, False])
@pytest.mark.parametrize("mixes", [True, False])
def test_forecasts_are_conditional_means(rng, per_taxel, mixes):
    """Of the joint normal, given all samples before, which leave the variance that the form says."""
    form, tap = gaussian_form(rng, per_taxel, mixes), rng.normal(size=(J, K))
    for q, l, h in [(0, 1, 2), (1, 2, 0)]:
        inverse = np.linalg.inv(whitening(form, l, h))
        covariance = inverse @ np.diag(form.scale[q, l, h].ravel() ** 2) @ inverse.T
        residual = (tap - form.mean[q, l, h]).ravel()
        actual = plain.innovations(tap, form, q)[l, h].ravel()
        for n in range(J * K):
            weight = np.linalg.solve(covariance[:n, :n], covariance[:n, n])
            variance = covariance[n, n] - weight @ covariance[:n, n]
            assert actual[n] == pytest.approx(residual[n] - weight @ residual[:n], abs=1e-10)
            assert np.sqrt(variance) == pytest.approx(form.scale[q, l, h].ravel()[n], rel=1e-8)


@pytest.mark.parametrize("shape", [(B + 1,), (K, B + 1)])
def test_a_tap_has_the_probability_of_its_bins(rng, shape):
    """Sample by sample, mixed over q at last; the end bins are open."""
    form, edges = gaussian_form(rng), np.sort(rng.normal(size=shape))
    tap = 2 * rng.normal(size=(J, K))
    actual = plain.log_likelihood(tap, form, edges, 0.3)
    index = reference.tap_bins(tap, edges)
    for l, h in product(range(L), range(H)):
        mixture = 0.0
        for q in range(Q):
            innovation, product_of_bins = plain.innovations(tap, form, q)[l, h], 1.0
            for j, k in product(range(J), range(K)):
                row = edges if edges.ndim == 1 else edges[k]
                low = -np.inf if index[j, k] == 0 else row[index[j, k]]
                high = np.inf if index[j, k] == B - 1 else row[index[j, k] + 1]
                forecast = tap[j, k] - innovation[j, k]
                bounds = (np.array([low, high]) - forecast) / form.scale[q, l, h, j, k]
                tails = ndtr(bounds) if bounds.sum() < 0 else ndtr(-bounds[::-1])
                product_of_bins *= float(tails[1] - tails[0])
            mixture += np.exp(form.log_weight[q]) * product_of_bins
        assert actual[l, h] == pytest.approx(0.3 * np.log(mixture), rel=1e-9)


def test_one_sample_in_any_bin_is_certain(rng):
    """Probabilities of all bins add up to one, and bins outside the range are the end bins."""
    form = GaussianForm(
        rng.normal(size=(1, L, H, 1, 1)), np.full((1, L, H, 1, 1), 0.7), np.ones((1, 1, 1)), np.zeros((1, 1, 0, 0)), [0]
    )
    edges = np.linspace(-1.0, 1.0, B + 1)
    centres = 0.5 * (edges[1:] + edges[:-1])
    values = [plain.log_likelihood(np.array([[x]]), form, edges, 1.0) for x in centres]

    np.testing.assert_allclose(np.exp(values).sum(axis=0), 1.0, rtol=1e-12)
    for x, expected in [(-9.0, values[0]), (9.0, values[-1])]:
        np.testing.assert_allclose(plain.log_likelihood(np.array([[x]]), form, edges, 1.0), expected, rtol=1e-13)


def test_both_tails_keep_their_digits():
    """Left and right alike, to a hundred standard deviations."""
    a = np.array([-100.0, -30.0, -8.0, -1.0, 0.5, 7.0, 30.0, 99.9])
    b = np.array([-99.9, -29.0, -7.9, 2.0, 0.6, 8.0, np.inf, 100.0])
    actual = plain.log_normal_interval(a, b)

    np.testing.assert_allclose(actual, plain.log_normal_interval(-b, -a), rtol=1e-15)
    np.testing.assert_allclose(actual[[3, 4]], np.log(np.diff(ndtr([a[[3, 4]], b[[3, 4]]]), axis=0)[0]), rtol=1e-12)
    assert actual[6] == pytest.approx(norm.logsf(30.0), rel=1e-14)
    assert actual[0] == pytest.approx(norm.logsf(99.9) + np.log1p(-np.exp(norm.logsf(100) - norm.logsf(99.9))))


def test_tables_are_summed(rng):
    """Eq. 1, with bins for each taxel."""
    form = TableForm(np.log(rng.dirichlet(np.ones(B), size=(L, H, K))))
    edges = np.sort(rng.normal(size=(K, B + 1)))
    tap = rng.normal(size=(J, K))
    actual = plain.log_likelihood(tap, form, edges, 0.5)
    for l, h in product(range(L), range(H)):
        terms = [
            form.log_prob[l, h, k, np.clip(np.sum(edges[k] <= tap[j, k]) - 1, 0, B - 1)]
            for j, k in product(range(J), range(K))
        ]
        assert actual[l, h] == pytest.approx(0.5 * sum(terms), rel=1e-12)


def test_compiled_loops_agree(rng):
    """On forms of every kind, also where a whole object lies far from the tap."""
    edges, tap = np.linspace(-2.0, 2.0, B + 1), rng.normal(size=(J, K))
    for per_taxel, mixes in product([True, False], repeat=2):
        form = gaussian_form(rng, per_taxel, mixes)
        form.mean[:, :, 1] += 40.0
        out = np.empty((1, L, H))
        form.prepare(np.zeros((L, H), dtype=bool)).log_likelihood(tap[None], edges, 0.2, out)
        np.testing.assert_allclose(plain.log_likelihood(tap, form, edges, 0.2), out[0], rtol=1e-11)


def test_the_numpyro_distribution_agrees(rng):
    """Where taxels have times of their own and mix, and neither; with bins for each taxel, taps far from an object."""
    edges, tap = np.sort(rng.normal(size=(K, B + 1))), rng.normal(size=(J, K))
    log_prob = jax.jit(lambda *arrays: BinnedTap(*arrays).log_prob(tap))
    for both in (True, False):
        form = gaussian_form(rng, both, both)
        form.mean[:, :, 1] -= 60.0
        taxel = np.broadcast_to(form.taxel, (L, H, *form.taxel.shape[2:]))
        expected = plain.log_likelihood(tap, form, edges, 1.0)
        with jax.enable_x64(True):
            for l, h in [(0, 0), (1, 1), (2, 3)]:
                arrays = form.mean[:, l, h], form.scale[:, l, h], form.time, taxel[l, h], form.log_weight, edges
                assert float(log_prob(*arrays)) == pytest.approx(expected[l, h], rel=1e-12)


def test_histograms_in_states_are_tables(make_model, draw_samples):
    """As the compiled table says."""
    model = replace(make_model(), states=States(np.array([1.0, 1.4]), np.array([0.0, 0.2]), np.log([0.4, 0.6])))
    tap = draw_samples(make_model(), 1)

    np.testing.assert_allclose(
        plain.log_likelihood(tap[0], model.form, model.edges, model.exponent), model.log_likelihood(tap)[0], rtol=1e-12
    )
