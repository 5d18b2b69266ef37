"""Forms: probabilities of bins from tables and from Gaussians, against SciPy and by brute force."""

import mpmath
import numpy as np
import pytest
from scipy import stats
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.likelihood import forms, innovations, moved_bins
from solidtouch.models.measurement.likelihood.bins import TableForm, find_bins
from solidtouch.models.measurement.likelihood.forecasts import (
    log_normal_probability,
    log_student_probability,
)
from solidtouch.models.measurement.likelihood.forms import GaussianForm, bin_gaps
from solidtouch.models.measurement.likelihood.innovations import class_log_probability
from solidtouch.models.measurement.likelihood.true_class import OwnTaps
from solidtouch.models.measurement.model import in_states
from solidtouch.models.measurement.states import ONE_STATE, States

L, H, J, K, Q, B = 2, 3, 4, 5, 2, 7


def gaussian_form(rng, *, own_time=False, taxels=True, Q=1):
    """A random form; `own_time` gives each taxel its own V."""
    time = np.tril(rng.normal(size=(K if own_time else 1, J, J)), -1) + np.eye(J)
    taxel = np.tril(rng.normal(size=(L, H, K, K)), -1) + np.eye(K) if taxels else np.zeros((1, 1, 0, 0))
    weight = rng.dirichlet(np.ones(Q))
    mean = rng.normal(size=(Q, L, H, J, K))
    return GaussianForm(mean, rng.uniform(0.5, 2, size=mean.shape), time, taxel, np.log(weight))


def covariance(form, l, h, q=0):
    """Of all samples of a tap, shape (J K, J K): the inverse of the map from residuals to innovations."""
    time = np.broadcast_to(form.time, (K, J, J))
    forward = np.einsum("kji,kc->jkic", time, np.eye(K)).reshape(J * K, J * K)
    if form.taxel.shape[-1]:
        forward = np.kron(np.eye(J), form.taxel[l, h]) @ forward
    back = np.linalg.inv(forward)
    return back @ np.diag(form.scale[q, l, h].ravel() ** 2) @ back.T


def table_form(rng, B=B):
    return TableForm(np.log(rng.dirichlet(np.ones(B), size=(L, H, K))))


KINDS = {
    "independent": {"taxels": False},
    "time of each taxel": {"own_time": True, "taxels": False},
    "taxels": {},
    "both": {"own_time": True},
}


# Masses


@pytest.mark.parametrize(
    ("lower", "upper"),
    [
        (-1.0, 2.0), (30.0, 31.0), (-31.0, -30.0), (5.0, 5.001), (-np.inf, -40.0), (40.0, np.inf),
        (0.0, 1e-5), (0.5, 0.5 + 2**-40), (-20.0 - 2**-30, -20.0), (1.0, 1.0099), (1.0, 1.0101),
    ],
)  # fmt: skip
def test_normal_probabilities_keep_their_digits(lower, upper):
    """They are those of an integral relative to the density at the end nearer to 0, on both sides of it."""
    near, far = sorted((abs(lower), abs(upper))) if lower * upper >= 0 else (lower, upper)
    if lower * upper >= 0:
        x, weight = np.polynomial.legendre.leggauss(60)
        width = min(far - near, 40.0 / max(near, 1.0))
        step = 0.5 * width * (x + 1)
        expected = stats.norm.logpdf(near) + np.log(0.5 * width * (weight * np.exp(-near * step - step**2 / 2)).sum())
    else:
        expected = np.log(stats.norm.cdf(upper) - stats.norm.cdf(lower))

    assert log_normal_probability(lower, upper) == pytest.approx(expected, rel=1e-13, abs=2e-13)


def test_student_probabilities_are_those_of_scipy():
    """Also far out, on both sides, and for the whole line."""
    freedom = 3.7
    lower, upper = np.array([-2.0, 10.0, -1e5, -np.inf, 300.0]), np.array([1.0, 12.0, -9e4, np.inf, np.inf])
    tail = stats.t(freedom).sf
    expected = [
        np.log(stats.t.cdf(1, freedom) - stats.t.cdf(-2, freedom)),
        np.log(tail(10.0) - tail(12.0)),
        np.log(tail(9e4) - tail(1e5)),
        0.0,
        np.log(tail(300.0)),
    ]

    np.testing.assert_allclose(log_student_probability(lower, upper, freedom), expected, rtol=1e-10, atol=1e-15)


@pytest.mark.parametrize("freedom", [0.5, 1.0, 2.0, 3.7, 30.0, 400.0, 1e4])
def test_student_probabilities_are_exact_in_all_tails(rng, freedom):
    """To 1e-11 of the larger tail, against 60 digits, from -1000 to 1000."""
    z = np.concatenate([rng.uniform(-6, 6, 8), rng.uniform(-1e3, 1e3, 4), [0.0, 3**0.5, 1e3]])
    upper = z + np.exp(rng.uniform(-5, 3, len(z)))
    tail, both = log_student_probability(-np.inf, -np.abs(z), freedom), log_student_probability(z, upper, freedom)

    def beyond(x):
        v, x = mpmath.mpf(freedom), mpmath.mpf(float(x))
        half = mpmath.betainc(v / 2, 0.5, 0, v / (v + x * x), regularized=True) / 2
        return half if x >= 0 else 1 - half

    with mpmath.workdps(60):
        for i, (low, high) in enumerate(zip(z, upper, strict=True)):
            near, far = (low, high) if low + high > 0 else (-high, -low)
            larger, smaller = beyond(near), beyond(far)
            assert tail[i] == pytest.approx(float(mpmath.log(beyond(abs(low)))), rel=1e-11, abs=1e-11)
            digits = 1e-11 * float(larger / (larger - smaller))
            assert both[i] == pytest.approx(float(mpmath.log(larger - smaller)), rel=digits, abs=digits)


def test_student_probabilities_of_several_freedoms_are_those_of_each(rng):
    """More of one than are computed together; by themselves and by an index; few degrees of freedom as well."""
    lower = rng.normal(scale=3, size=(300, 4))
    upper, freedom = lower + rng.exponential(size=lower.shape), np.array([2.0, 7.0, 0.3, 2.0])
    each = np.stack([log_student_probability(lower[:, i], upper[:, i], freedom[i]) for i in range(4)], axis=1)
    values, which = np.unique(freedom, return_inverse=True)

    np.testing.assert_allclose(log_student_probability(lower, upper, freedom), each, rtol=1e-11)
    np.testing.assert_allclose(log_student_probability(lower, upper, values, which), each, rtol=1e-11)
    np.testing.assert_allclose(np.exp(each[:, 2]), np.diff(stats.t(0.3).cdf([lower[:, 2], upper[:, 2]]), axis=0)[0])


def test_an_interval_without_width_is_impossible_and_one_without_ends_unknown():
    found = log_student_probability([0.0, 50.0, -np.inf, np.nan, 0.0], [0.0, 50.0, -np.inf, 1.0, np.nan], 4.0)

    np.testing.assert_array_equal(found, [-np.inf, -np.inf, -np.inf, np.nan, np.nan])


def test_probabilities_of_all_bins_sum_to_one(rng):
    """With the end bins open."""
    edges = np.concatenate([[-np.inf], np.sort(rng.normal(scale=3, size=B - 1)), [np.inf]])

    assert np.exp(log_normal_probability(edges[:-1], edges[1:])).sum() == pytest.approx(1.0, rel=1e-14)
    assert np.exp(log_student_probability(edges[:-1], edges[1:], 2.2)).sum() == pytest.approx(1.0, rel=1e-14)


def test_compiled_intervals_are_the_probabilities(rng):
    """Of SciPy, near 0 and far out, narrow and wide, on both sides and open."""
    middle = np.concatenate([rng.normal(scale=3, size=400), rng.uniform(-60, 60, size=400), [-1e5, 1e9]])
    width = np.exp(rng.uniform(np.log(1e-3), np.log(30), size=len(middle)))
    open_ends = [[-np.inf, 26.0, -np.inf], [-80.0, np.inf, np.inf]]
    ends = np.concatenate([open_ends, [middle - width, middle + width]], axis=1)
    expected = log_normal_probability(*ends)
    near, factor = np.empty((2, ends.shape[1]))
    innovations.intervals(*ends.copy(), near, factor)

    np.testing.assert_allclose(np.log(factor) - 0.5 * near**2, expected, rtol=1e-11, atol=1e-14)


def test_compiled_intervals_without_a_width_stay_possible():
    """Ends that rounding has made equal have a probability that one more factor does not take out of range."""
    ends = np.array([[1e30, 3.0, -1e-30], [1e30, 3.0, 1e-30]])
    near, factor = np.empty((2, 3))
    innovations.intervals(*ends, near, factor)

    assert np.all((factor > 1e-160) & (factor < 1e-15))


# Gaussian forms


@pytest.mark.parametrize("kind", KINDS)
def test_innovations_give_the_density_of_the_covariance(rng, kind):
    """Their normal densities multiply to the multivariate normal of all samples of a tap."""
    form = gaussian_form(rng, **KINDS[kind])
    taps = rng.normal(size=(6, J, K))
    where, what = np.arange(6) % L, np.arange(6) % H
    white = form.innovations(taps, where, what)
    density = stats.norm.logpdf(white, scale=form.scale[0, where, what]).sum(axis=(1, 2))
    for n, (l, h) in enumerate(zip(where, what, strict=True)):
        expected = stats.multivariate_normal(form.mean[0, l, h].ravel(), covariance(form, l, h)).logpdf(taps[n].ravel())
        assert density[n] == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("kind", KINDS)
def test_log_probabilities_are_those_of_a_loop(rng, kind):
    """Every hypothesis of every tap, each sample between the edges of its bin given those before it."""
    form = gaussian_form(rng, Q=Q, **KINDS[kind])
    edges = np.sort(rng.normal(size=(K, B + 1)), axis=1) * 2
    taps = rng.normal(size=(3, J, K)) * 2
    actual = np.empty((3, L, H))
    form.prepare(np.zeros((L, H), bool)).log_likelihood(taps, edges, 1.0, actual)
    bins = find_bins(taps, edges)
    open_edges = edges.copy()
    open_edges[:, 0], open_edges[:, -1] = -np.inf, np.inf
    lower, upper = open_edges[np.arange(K), bins] - taps, open_edges[np.arange(K), bins + 1] - taps
    for l, h in np.ndindex(L, H):
        own = np.full(3, l), np.full(3, h)
        parts = []
        for q in range(Q):
            white, scale = form.innovations(taps, *own, q), form.scale[q, l, h]
            mass = log_normal_probability((lower + white) / scale, (upper + white) / scale)
            parts.append(form.log_weight[q] + mass.sum(axis=(1, 2)))
        expected = np.logaddexp.reduce(parts)
        np.testing.assert_allclose(actual[:, l, h], expected, rtol=1e-10)
        np.testing.assert_allclose(form.own(taps, edges, *own), expected, rtol=1e-10)


def test_fine_bins_measure_the_density(rng):
    """Bins of a thousandth: log probability minus the log widths is the multivariate normal log density."""
    form = gaussian_form(rng, own_time=True)
    edges = np.arange(-12.0, 12.0, 1e-3)
    taps = edges[rng.integers(9000, 14000, size=(4, J, K))] + 5e-4
    where, what = np.zeros(4, int), np.full(4, 2)
    actual = form.own(taps, edges, where, what) - J * K * np.log(1e-3)
    normal = stats.multivariate_normal(form.mean[0, 0, 2].ravel(), covariance(form, 0, 2))

    np.testing.assert_allclose(actual, normal.logpdf(taps.reshape(4, -1)), rtol=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_samples_have_the_mean_and_covariance(rng, kind):
    """Within five standard errors of 40000 taps."""
    form, n = gaussian_form(rng, **KINDS[kind]), 40_000
    taps = form.sample(np.ones(n, int), np.full(n, 2), np.empty(0), J, rng).reshape(n, -1)
    expected = covariance(form, 1, 2)
    variance = np.diag(expected)
    error = np.sqrt((np.outer(variance, variance) + expected**2) / n)

    assert np.all(np.abs(taps.mean(axis=0) - form.mean[0, 1, 2].ravel()) < 5 * np.sqrt(variance / n))
    assert np.all(np.abs(np.cov(taps.T) - expected) < 5.5 * error)


def test_samples_come_from_the_mixture(rng):
    """Means differ, and each part has its weight."""
    form = gaussian_form(rng, Q=Q)
    form = form._replace(mean=form.mean + 100.0 * np.arange(Q)[:, None, None, None, None], scale=0 * form.scale + 0.1)
    n = 5000
    taps = form.sample(np.zeros(n, int), np.zeros(n, int), np.empty(0), J, rng)
    share = np.exp(form.log_weight[1])

    assert (taps[:, 0, 0] > 50).mean() == pytest.approx(share, abs=5 * np.sqrt(share * (1 - share) / n))


def test_a_single_bin_is_certain(rng):
    """Its probability is 1 whatever the tap."""
    form = gaussian_form(rng)
    own = form.own(rng.normal(size=(3, J, K)) * 1e3, np.array([-1.0, 1.0]), np.zeros(3, int), np.zeros(3, int))

    np.testing.assert_allclose(own, 0.0, atol=1e-12)


def test_samples_very_far_out_stay_finite(rng):
    """A million standard deviations are improbable, and neither impossible nor NaN."""
    form = gaussian_form(rng)
    one_class = np.zeros(1, int)
    log_probability = form.own(np.full((1, J, K), 1e6), np.linspace(-1.0, 2e6, B + 1), one_class, one_class)

    assert np.isfinite(log_probability).all()
    assert log_probability[0] < -1e9


def test_many_taps_are_those_of_one_call(rng):
    """More than one thread takes at a time."""
    form, edges, N = gaussian_form(rng), np.linspace(-3, 3, B + 1), 150
    taps, actual, expected = rng.normal(size=(N, J, K)), np.empty((N, L, H)), np.empty((N, L * H))
    impossible = np.zeros((L, H), bool)
    impossible[1, 0] = True
    ready = form.prepare(impossible)
    ready.log_likelihood(taps, edges, 0.5, actual)
    class_log_probability(*bin_gaps(taps, edges), *ready[:-1], expected)
    expected = 0.5 * expected.reshape(N, L, H)
    expected[:, 1, 0] = -np.inf
    np.testing.assert_array_equal(actual, expected)


# Independent samples


def independent_form(rng, J=J, K=K, Q=1, shape=(L, H), scale=1.0, own_time=False):
    """A random form that neither mixes times nor taxels."""
    mean = rng.normal(size=(Q, *shape, J, K))
    time = np.tile(np.eye(J), (K if own_time else 1, 1, 1))
    spread = scale * rng.uniform(0.5, 2, size=mean.shape)
    return GaussianForm(mean, spread, time, np.zeros((1, 1, 0, 0)), np.log(rng.dirichlet(np.ones(Q))))


def directly(form, taps, edges, exponent=1.0):
    """Log-likelihoods (N, L, H), tap by tap."""
    ready, out = form.prepare(np.zeros(form.shape, bool)), np.empty((len(taps), form.shape[0] * form.shape[1]))
    class_log_probability(*bin_gaps(taps, edges), *ready[:-1], out)
    return exponent * out.reshape(-1, *form.shape)


@pytest.fixture
def looked_up(monkeypatch):
    """The numbers of taps that were looked up, class by class."""
    seen, compiled = [], innovations.independent_log_probability

    def observed(c, bins, *rest):
        assert bins.shape[2] == rest[-1].shape[1]
        seen.append(bins.shape[2])
        compiled(c, bins, *rest)

    monkeypatch.setattr(innovations, "independent_log_probability", observed)
    return seen


@pytest.mark.parametrize(
    ("size", "bins", "more"),
    [
        ((20, J, K), B, {}),
        ((20, J, K), B, {"own_time": True}),
        ((20, 1, K), B, {"Q": 2}),
        ((20, J, 1), B, {"Q": 3, "own_time": True}),
        ((2, 1, 1), 1, {}),
        ((20, J, K), B, {"shape": (1, 1)}),
        ((20, J, K), B, {"scale": 0.01}),
        ((20, J, K), B, {"scale": 1e-4, "Q": 2}),
        ((500, J, K), 40, {"Q": 2}),
    ],
)
def test_looked_up_taps_are_those_computed_one_by_one(rng, looked_up, size, bins, more):
    """Also a thousand standard deviations out, in mixtures, under one class, in one bin and on several threads."""
    form, edges = independent_form(rng, *size[1:], **more), np.sort(rng.normal(size=(size[2], bins + 1)), axis=1)
    taps, actual = 2 * rng.normal(size=size), np.empty((size[0], *form.shape))
    form.prepare(np.zeros(form.shape, bool)).log_likelihood(taps, edges, 1.0, actual)

    assert looked_up == [size[0]] * (form.shape[0] * form.shape[1])
    np.testing.assert_allclose(actual, directly(form, taps, edges), rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize(("N", "blocks"), [(B, 0), (B + 1, 1), (64, 1), (65, 1)])
def test_taps_are_looked_up_where_they_outnumber_bins(rng, looked_up, N, blocks):
    """With the exponent, and impossible classes apart; fewer taps are computed one by one."""
    form, edges, impossible = independent_form(rng), np.linspace(-2, 2, B + 1), np.zeros((L, H), bool)
    impossible[1, 2] = impossible[0, 0] = True
    taps, actual = rng.normal(size=(N, J, K)), np.empty((N, L, H))
    form.prepare(impossible).log_likelihood(taps, edges, 0.3, actual)

    assert looked_up == [N] * (blocks * L * H)
    np.testing.assert_allclose(actual, np.where(impossible, -np.inf, directly(form, taps, edges, 0.3)), rtol=1e-12)


@pytest.mark.parametrize(
    "part", [{"time": np.tri(J)[None]}, {"time": np.tile(np.tri(J), (K, 1, 1))}, {"taxel": np.tri(K)[None, None]}]
)
def test_samples_that_depend_on_others_are_never_looked_up(rng, looked_up, part):
    """Not on other times of one or every taxel, nor on other taxels."""
    form, edges = independent_form(rng)._replace(**part), np.linspace(-2, 2, B + 1)
    taps, actual = rng.normal(size=(50, J, K)), np.empty((50, L, H))
    form.prepare(np.zeros((L, H), bool)).log_likelihood(taps, edges, 1.0, actual)

    assert not looked_up
    np.testing.assert_array_equal(actual, directly(form, taps, edges))


@pytest.mark.parametrize(("N", "blocks"), [(41, [20, 20, 1]), (40, [20, 20]), (21, [])])
def test_memory_holds_a_block_of_taps_at_a_time(rng, looked_up, monkeypatch, tmp_path, N, blocks):
    """Onto the disk, in double or single precision; where bins outnumber the taps of blocks none are looked up."""
    monkeypatch.setattr(forms, "_ROOM", 20 * (J * K + L * H))
    form, edges = independent_form(rng, Q=2), np.linspace(-2, 2, 12)
    for dtype in (np.float64, np.float32):
        taps = rng.normal(size=(N, J, K)).astype(dtype)
        actual = np.lib.format.open_memmap(tmp_path / "out.npy", "w+", shape=(N, L, H))
        form.prepare(np.zeros((L, H), bool)).log_likelihood(taps, edges, 1.0, actual)
        np.testing.assert_allclose(actual, directly(form, taps, edges), rtol=1e-12)

    assert looked_up == 2 * [n for n in blocks for _ in range(L * H)]


@pytest.mark.parametrize("N", [B, B + 1])
def test_nan_among_taps_of_dependent_samples_is_refused(rng, N):
    """However many there are."""
    taps = rng.normal(size=(N, J, K))
    taps[-1, 1, 2] = np.nan
    with pytest.raises(InputError, match="Samples must not be NaN"):
        gaussian_form(rng).prepare(np.zeros((L, H), bool)).log_likelihood(
            taps, np.linspace(-1, 1, B + 1), 1.0, np.empty((N, L, H))
        )


# Tables


def test_own_probabilities_of_a_table_are_a_loop(rng):
    """One term per sample."""
    form, edges = table_form(rng), np.linspace(-2, 2, B + 1)
    taps, where, what = rng.normal(size=(4, J, K)), np.array([0, 1, 1, 0]), np.array([2, 0, 1, 1])
    bins = find_bins(taps, edges)
    expected = [
        sum(form.log_prob[where[n], what[n], k, bins[n, j, k]] for j in range(J) for k in range(K)) for n in range(4)
    ]

    np.testing.assert_allclose(form.own(taps, edges, where, what), expected, rtol=1e-14)


def test_nan_belongs_to_no_bin(rng):
    """A table leaves it out, a form of dependent samples refuses it."""
    taps = np.full((1, J, K), np.nan)
    given = taps, np.linspace(-1, 1, B + 1), np.zeros(1, int), np.zeros(1, int)

    assert table_form(rng).own(*given) == 0
    with pytest.raises(InputError, match="Samples must not be NaN"):
        gaussian_form(rng).own(*given)


def test_table_samples_have_the_probabilities(rng):
    """Frequencies of the bins within five standard errors."""
    form, edges, n = table_form(rng), np.linspace(-2, 2, B + 1), 4000
    taps = form.sample(np.ones(n, int), np.zeros(n, int), edges, J, rng)
    bins = find_bins(taps, edges)
    for k in range(K):
        p = np.exp(form.log_prob[1, 0, k])
        share = np.bincount(bins[..., k].ravel(), minlength=B) / (n * J)
        assert np.all(np.abs(share - p) < 5 * np.sqrt(p * (1 - p) / (n * J)))


@pytest.mark.parametrize("skew", [0.3, 30.0])
def test_drawn_bins_are_those_of_the_random_numbers(rng, skew):
    """The first bin whose cumulative probability exceeds the random number, by search; also of very uneven bins."""
    with np.errstate(divide="ignore"):
        form = TableForm(np.log(rng.dirichlet(np.full(37, 1 / skew), size=(2, 3, K))))
    where, what = rng.integers(2, size=50), rng.integers(3, size=50)
    upto = np.exp(form.log_prob).cumsum(axis=-1)[where, what]
    uniform = np.random.default_rng(8).random((50, K, J))
    expected = (upto[:, :, None] <= (uniform * upto[..., -1:])[..., None]).sum(axis=-1)

    found = form.sample_bins(where, what, J, np.random.default_rng(8))

    np.testing.assert_array_equal(found, expected.swapaxes(1, 2))


def test_impossible_bins_are_never_drawn():
    """Not even by a random number of exactly 0."""

    class Zeros:
        def random(self, size):
            return np.zeros(size)

    with np.errstate(divide="ignore"):
        form = TableForm(np.log(np.array([0.0, 0.0, 0.7, 0.3])).reshape(1, 1, 1, 4))
    one = np.zeros(1, dtype=int)

    assert form.sample(one, one, np.arange(5.0), 2, Zeros()).tolist() == [[[2.5], [2.5]]]


# States


def test_gain_one_and_offset_zero_change_nothing(rng):
    """In a table to 1e-12, also where probabilities are far below the rounding of 1; in a Gaussian exactly."""
    table = TableForm(log_normal_probability(*np.broadcast_arrays(*_edges_around(rng))))
    edges = np.linspace(-40, 40, B + 1)
    assert table.log_prob.min() < -400

    np.testing.assert_allclose(table.in_state(1.0, 0.0, edges).log_prob, table.log_prob, rtol=1e-12, atol=1e-12)
    form = gaussian_form(rng)
    np.testing.assert_array_equal(form.in_state(1.0, 0.0, edges).mean, form.mean)
    assert in_states(table, ONE_STATE, edges) is table


def _edges_around(rng):
    inner = np.linspace(-40, 40, B + 1)[1:-1]
    level = rng.normal(size=(L, H, K, 1))
    edges = np.concatenate([[-np.inf], inner, [np.inf]])
    return edges[:-1] - level, edges[1:] - level


@pytest.mark.parametrize(("gain", "offset"), [(1.3, 0.0), (0.7, 2.0), (1.0, -1.5)])
def test_taps_and_edges_moved_alike_keep_their_probabilities(rng, gain, offset):
    """A tap times the gain plus the offset, in the state, in bins moved likewise."""
    edges, taps = np.linspace(-3, 3, B + 1), rng.normal(size=(4, J, K))
    own = np.zeros(4, int), np.ones(4, int)
    form = gaussian_form(rng)
    moved = form.in_state(gain, offset, edges).own(gain * taps + offset, gain * edges + offset, *own)

    np.testing.assert_allclose(moved, form.own(taps, edges, *own), rtol=1e-9)


@pytest.mark.parametrize(("gain", "offset"), [(1.25, 0.0), (1.3, 0.4), (1.0, 0.0), (1.6, -0.3)])
def test_a_table_in_a_state_is_that_of_an_integral(rng, gain, offset):
    """Piecewise constant densities, multiplied and moved, integrated over every bin that they still reach."""
    edges = np.linspace(-2, 2, B + 1)
    form = table_form(rng)
    moved = np.exp(form.in_state(gain, offset, edges).log_prob)
    fine = np.linspace(-2, 2, 200_001)
    centre = 0.5 * (fine[:-1] + fine[1:])
    old = find_bins(centre[:, None], edges)[:, 0]
    new = find_bins((gain * centre + offset)[:, None], edges)[:, 0]
    for l, h, k in [(0, 0, 0), (1, 2, 4)]:
        density = np.exp(form.log_prob[l, h, k])[old] / np.bincount(old)[old]
        np.testing.assert_allclose(moved[l, h, k], np.bincount(new, density, minlength=B), atol=1e-4)


@pytest.mark.parametrize(("gain", "offset"), [(0.8, 0.0), (1.0, 1.9), (0.5, -3.0), (3.0, 40.0), (1e-3, 0.0)])
def test_no_bin_becomes_impossible_by_a_state(rng, gain, offset):
    """Rows still sum to one, and bins that the range has left keep a probability."""
    moved = table_form(rng).in_state(gain, offset, np.linspace(-2, 2, B + 1)).log_prob

    assert np.isfinite(moved).all()
    np.testing.assert_allclose(np.exp(moved).sum(axis=-1), 1.0, rtol=1e-12)


@pytest.mark.parametrize(("gain", "offset"), [(1.3, 0.4), (0.6, -0.2), (1.0, 5.0)])
def test_bins_far_below_the_range_of_numbers_are_moved_as_well(rng, gain, offset):
    """To 1e-12 as sums of logs."""
    log_prob = -rng.exponential(rng.choice([1.0, 300.0, 5000.0], size=(L, H, K, 60)))
    log_prob[rng.random(log_prob.shape) < 0.1] = -np.inf
    edges = np.sort(rng.normal(size=61))
    moved = TableForm(log_prob).in_state(gain, offset, edges).log_prob

    for k in range(K):
        source, width, first = moved_bins.pieces(edges, gain, offset)
        expected = np.logaddexp.reduceat(log_prob[:, :, k, source] + np.log(width), first, axis=-1)
        expected -= np.logaddexp.reduce(expected, axis=-1, keepdims=True)
        np.testing.assert_allclose(moved[:, :, k], expected, rtol=1e-12, atol=1e-12)
    assert (moved < -5000).any()
    assert np.isneginf(moved).any()


def test_only_the_bins_of_taps_are_moved(rng):
    """As if all were, also with missing samples, impossible bins and those far below the range of numbers."""
    log_prob = -rng.exponential(rng.choice([1.0, 300.0], size=(L, H, K, B)))
    log_prob[0, 0, :, 3] = -np.inf
    table, edges = (
        TableForm(log_prob - np.logaddexp.reduce(log_prob, axis=-1, keepdims=True)),
        np.linspace(-2, 2, B + 1),
    )
    states = States(np.array([1.0, 0.9, 1.2]), np.array([0.0, 0.3, -0.1]), np.log([0.4, 0.1, 0.5]))
    taps, where, what = rng.normal(size=(9, J, K)), rng.integers(L, size=9), rng.integers(H, size=9)
    taps[2, :, 1], taps[5] = np.nan, np.nan
    each = zip(*(values.tolist() for values in states), strict=True)
    parts = [p + table.in_state(g, o, edges).own(taps, edges, where, what) for g, o, p in each]
    found = OwnTaps(taps, (where, what), edges, states).log_probability(table)

    np.testing.assert_allclose(found, np.logaddexp.reduce(parts, axis=0), rtol=1e-12, atol=1e-12)


def test_whole_bins_move_as_they_are(rng):
    """An offset of one bin moves every row by one; those moved out gather in the end bin."""
    edges = np.linspace(0.0, B, B + 1)
    form = table_form(rng)
    p = np.exp(form.log_prob)
    moved = np.exp(form.in_state(1.0, 1.0, edges).log_prob)
    expected = np.concatenate([p[..., :1], p[..., :-2], p[..., -2:].sum(-1, keepdims=True)], axis=-1)

    np.testing.assert_allclose(moved, expected / expected.sum(-1, keepdims=True), rtol=1e-12)


def test_impossible_bins_stay_impossible(rng):
    """A histogram without pseudocount moves without a warning."""
    log_prob = table_form(rng).log_prob.copy()
    log_prob[..., 2:5] = -np.inf
    moved = TableForm(log_prob - np.logaddexp.reduce(log_prob, axis=-1, keepdims=True)).in_state(
        1.0, 0.0, np.linspace(-2, 2, B + 1)
    )

    assert np.isneginf(moved.log_prob[..., 2:5]).all()


def test_hypotheses_are_states_of_objects(rng):
    """Hypothesis s M + m is object m in state s, in both forms."""
    states, edges = States(np.array([0.9, 1.2]), np.array([0.3, -0.1]), np.log([0.4, 0.6])), np.linspace(-2, 2, B + 1)
    table, gaussian = table_form(rng), gaussian_form(rng)
    tables, gaussians = in_states(table, states, edges), in_states(gaussian, states, edges)

    assert tables.shape == gaussians.shape == (L, 2 * H)
    for s in range(2):
        pair = float(states.gain[s]), float(states.offset[s])
        np.testing.assert_array_equal(tables.log_prob[:, s * H : s * H + H], table.in_state(*pair, edges).log_prob)
        np.testing.assert_array_equal(gaussians.mean[:, :, s * H : s * H + H], pair[0] * gaussian.mean + pair[1])
        np.testing.assert_array_equal(gaussians.scale[:, :, s * H : s * H + H], pair[0] * gaussian.scale)
        np.testing.assert_array_equal(gaussians.taxel[:, s * H : s * H + H], gaussian.taxel)
