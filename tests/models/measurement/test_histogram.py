"""The measurement model: counts, likelihoods, NumPyro's view of it."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from numpyro.infer import HMC, MCMC
from numpyro.infer.util import log_density
from scipy.special import gammaln
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import PRESETS
from solidtouch.inference import reference
from solidtouch.models.errors import InputError
from solidtouch.models.grid import ClassGrid
from solidtouch.models.measurement.fits.priors import Taps
from solidtouch.models.measurement.histogram import fit, story, trim
from solidtouch.models.measurement.likelihood.bins import bin_edges, find_bins
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.settings import learned_taps, likelihood_exponent, parse_power, parse_power_choice
from solidtouch.models.taps import TapSet

L, M, J, K, B = 3, 4, 6, 5, 9


@pytest.fixture(scope="module")
def taps(make_taps):
    return make_taps(L, M, J, K, repeats=2)


@pytest.fixture(scope="module")
def grid(taps):
    return taps.grid()


def empty_cells(taps, *cells):
    """The taps without those of these (where, what) classes."""
    where, what = taps.indices(taps.grid())
    return taps.select(~np.any([(where == l) & (what == m) for l, m in cells], axis=0))


# Eq. 2


@pytest.mark.parametrize("value_range", ["global", "taxel"])
def test_counts_are_those_of_a_loop(taps, grid, value_range):
    """Every sample of a tap adds one to the bin of its class and taxel, bins by the reference."""
    model = fit(taps, grid, bins=B, value_range=value_range)
    where, what = taps.indices(grid)
    expected = np.zeros((L, M, K, B), dtype=int)
    for n, tap in enumerate(taps.taps):
        for k in range(K):
            edges = model.edges if value_range == "global" else model.edges[k]
            for b in reference.bin_index(tap[:, k], edges):
                expected[where[n], what[n], k, b] += 1

    np.testing.assert_array_equal(model.counts, expected)
    np.testing.assert_allclose(model.probabilities, reference.histogram_probabilities(expected, 0.01), rtol=1e-14)
    np.testing.assert_array_equal(np.exp(model.log_prob), np.exp(np.log(model.probabilities)))


@pytest.mark.parametrize("pseudocount", [0.0, 0.01, 3.0])
def test_probabilities_are_eq_2_of_the_reference(make_model, pseudocount):
    """With the pseudocount in counts; empty bins without it are impossible, without a warning."""
    model = make_model(pseudocount=pseudocount)

    np.testing.assert_allclose(
        model.probabilities, reference.histogram_probabilities(model.counts, pseudocount), rtol=1e-15
    )
    assert np.isneginf(model.log_prob).any() == (pseudocount == 0)


def test_edges_span_the_training_data(taps, grid):
    """Over all taxels together, or each; the largest value lies in the last bin."""
    together, each = (fit(taps, grid, bins=B, value_range=r).edges for r in ("global", "taxel"))

    np.testing.assert_allclose(together, np.linspace(taps.taps.min(), taps.taps.max(), B + 1))
    assert each.shape == (K, B + 1)
    np.testing.assert_array_equal(each[:, [0, -1]], np.stack([taps.taps.min((0, 1)), taps.taps.max((0, 1))], 1))
    assert find_bins(taps.taps, together).max() == B - 1
    assert find_bins(taps.taps, each).max(axis=(0, 1)).tolist() == [B - 1] * K


def test_edges_come_from_taps_inside_the_grid_only(taps, grid):
    """A tap of no class does not widen the bins."""
    dataset = taps.dataset.copy(deep=True)
    dataset["taps"][0] = 1e6
    dataset["where"][0] = 99.0
    model = fit(TapSet(dataset), grid, bins=B)

    assert model.edges[-1] < 100
    assert model.counts.sum() == (len(taps) - 1) * J * K


@pytest.mark.parametrize("value", [0.0, -3.5, 1e9, 255.0])
@pytest.mark.parametrize("value_range", ["global", "taxel"])
def test_constant_taxels_have_increasing_edges(taps, grid, value, value_range):
    """A dead taxel says nothing, and divides nothing by zero."""
    dataset = taps.dataset.copy(deep=True)
    dataset["taps"][:] = value
    flat = TapSet(dataset)
    model = fit(flat, grid, bins=B, value_range=value_range)

    assert (np.diff(model.edges) > 0).all()
    assert np.ptp(model.log_likelihood(flat.taps)) < 1e-12


@pytest.mark.parametrize("width", [0.0, 1e-16, 1e-14, 1e-9, 1.0])
@pytest.mark.parametrize("low", [0.0, 1.0, -1e8, 1e-300])
def test_narrow_ranges_have_increasing_edges(low, width):
    """Down to a few rounding steps, which count as constant."""
    samples = np.array([low, low + width]).reshape(1, 2, 1)
    for value_range in ("global", "taxel"):
        edges = bin_edges(samples, 100, value_range)
        assert (np.diff(edges) > 0).all()
        assert (edges[..., 0] <= low).all()
        assert (edges[..., -1] >= low + width).all()


@pytest.mark.parametrize("edges", [np.linspace(-1, 2, B + 1), np.array([[-1.0, 0, 2], [0, 1, 2], [-5, 0, 9]])])
def test_bins_are_those_of_the_reference(rng, edges):
    """Also on edges, outside and in single precision."""
    samples = np.concatenate([rng.uniform(-3, 3, size=(50, 4, 3)), np.full((1, 4, 3), 2.0), np.full((1, 4, 3), -1.0)])
    for values in (samples, samples.astype(np.float32)):
        bins = find_bins(values, edges)
        for k in range(3):
            own = edges if edges.ndim == 1 else edges[k]
            np.testing.assert_array_equal(bins[..., k], reference.bin_index(values[..., k], own))


# Eq. 1


@pytest.mark.parametrize("power", ["J", "JK", "none", 0.31])
@pytest.mark.parametrize("value_range", ["global", "taxel"])
@pytest.mark.parametrize("pseudocount", [0.0, 0.2])
def test_log_likelihoods_are_those_of_the_reference(make_model, draw_samples, power, value_range, pseudocount):
    """Tap by tap, impossible and untrained classes at -inf."""
    model = make_model(power=power, value_range=value_range, pseudocount=pseudocount, untrained=[(0, 3), (2, 1)])
    taps = draw_samples(model, 11)
    taps[3] += 50.0
    log_likelihood = model.log_likelihood(taps)
    for tap, actual in zip(taps, log_likelihood, strict=True):
        expected = reference.tap_log_likelihood(model.bins(tap), model.log_prob, power)
        expected[~model.trained] = -np.inf
        np.testing.assert_allclose(actual, expected, rtol=1e-12)
    assert np.isneginf(log_likelihood[:, ~model.trained]).all()
    assert np.isneginf(log_likelihood[:, model.trained]).any() == (pseudocount == 0)


@pytest.mark.parametrize(
    "sizes", [(1, 1, 1, 1, 1), (1, 7, 2, 3, 1), (40, 7, 1, 9, 3), (3, 1, 4, 1, 5), (2, 64, 3, 30, 2)]
)
@pytest.mark.parametrize("pseudocount", [0.0, 0.01])
def test_log_likelihoods_are_those_of_the_reference_at_any_size(make_model, draw_samples, sizes, pseudocount):
    """One class, one bin, one sample, and more classes than the loops take at a time."""
    model = make_model(*sizes, pseudocount=pseudocount)
    samples = draw_samples(model, 5)
    expected = [reference.tap_log_likelihood(model.bins(tap), model.log_prob) for tap in samples]

    np.testing.assert_allclose(model.log_likelihood(samples), expected, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("chunk", [1, 3 * 10, 10**9])
def test_chunks_change_nothing(make_model, draw_samples, taps, grid, monkeypatch, chunk):
    """One tap at a time, three, or all."""
    model = make_model(pseudocount=0.0)
    samples = draw_samples(model, 10)
    expected, counts = model.log_likelihood(samples), fit(taps, grid).counts
    monkeypatch.setattr("solidtouch.models.measurement.likelihood.bins._SAMPLES", chunk)

    np.testing.assert_array_equal(model.log_likelihood(samples), expected)
    np.testing.assert_array_equal(fit(taps, grid).counts, counts)


def test_duplicated_samples_leave_the_likelihood_unchanged(make_model, draw_samples):
    """At the J-th root, a tap recorded at twice the rate says the same."""
    slow, fast = make_model(J=5), make_model(J=10)
    fast = replace(fast, edges=slow.edges, counts=2 * slow.counts, pseudocount=0.02)
    samples = draw_samples(slow, 4)

    np.testing.assert_allclose(
        fast.log_likelihood(np.repeat(samples, 2, axis=1)), slow.log_likelihood(samples), rtol=1e-12
    )


@pytest.mark.parametrize(
    ("samples", "message"),
    [
        (np.zeros((3, 4, 2)), r"5 samples and 2 taxels as in the model, got shape \(3, 4, 2\)"),
        (np.zeros((3, 5, 1)), "5 samples and 2 taxels as in the model, got shape"),
        (np.zeros((5, 2)), r"three axes \(tap, sample, taxel\), got shape \(5, 2\)"),
        (np.full((1, 5, 2), np.nan), "Samples must not be NaN"),
    ],
)
def test_other_samples_are_refused(make_model, samples, message):
    """The message says what the model knows."""
    with pytest.raises(InputError, match=message):
        make_model().log_likelihood(samples)


def test_the_prior_is_uniform_over_trained_classes(make_model):
    """Untrained classes are impossible."""
    model = make_model(untrained=[(1, 1), (0, 2)])

    assert np.exp(model.log_prior).sum() == pytest.approx(1.0)
    np.testing.assert_array_equal(np.isneginf(model.log_prior), ~model.trained)
    assert (~model.trained).sum() == 2


@pytest.mark.parametrize(("power", "value"), [("J", 0.25), ("JK", 0.125), ("none", 1.0), (2, 2.0), (0.1, 0.1)])
def test_exponents_are_those_of_the_reference(power, value):
    """For taps of 4 samples and 2 taxels."""
    assert likelihood_exponent(power, 4, 2) == reference.exponent(power, 4, 2) == value
    assert parse_power(str(power)) == power


@pytest.mark.parametrize("power", ["K", "", "0", "-1", "nan", "inf"])
def test_other_powers_are_refused(power):
    """As words and as numbers."""
    with pytest.raises(InputError, match="J, JK, none or a positive number, got"):
        parse_power(power)
    with pytest.raises(InputError, match="J, JK, none or a positive number, got"):
        likelihood_exponent(power if power in ("K", "") else float(power), 4, 2)


@pytest.mark.parametrize(("text", "taps"), [("learned", 20), ("learned:1", 1), ("learned:123456", 123456)])
def test_powers_can_be_learned_where_one_is_fitted(text, taps):
    """But no model has one that is still to be learned."""
    assert parse_power_choice(text) == text
    assert learned_taps(text) == taps
    for refuse in (parse_power, lambda power: likelihood_exponent(power, 4, 2)):
        with pytest.raises(InputError, match=f"J, JK, none or a positive number, got '{text}'"):
            refuse(text)


@pytest.mark.parametrize("power", ["J", "JK", "none", 0.25])
def test_other_powers_are_not_learned(power):
    assert parse_power_choice(str(power)) == power
    assert learned_taps(power) is None


@pytest.mark.parametrize(
    "power", ["learned:", "learned:0", "learned:-3", "learned:2.5", "learned20", "learned:1234567"]
)
def test_a_learned_power_has_a_number_of_taps(power):
    with pytest.raises(InputError, match=f"must be learned, or learned:N with a number of taps N, got '{power}'"):
        parse_power_choice(power)


# The NumPyro model


def dirichlet_log_density(p, concentration):
    """Log density of Dirichlet distributions over the last axis, summed."""
    return float(
        (
            gammaln(concentration.sum(-1)) - gammaln(concentration).sum(-1) + ((concentration - 1) * np.log(p)).sum(-1)
        ).sum()
    )


def test_the_model_is_conjugate(rng):
    """Its log joint at any histograms is that of the Dirichlet posterior plus a constant, so Eq. 2 is its mean."""
    shape, n, J = (2, 3, 4, 5), 7, 6
    bins, where, what = rng.integers(5, size=(n, J, 4)), rng.integers(2, size=n), rng.integers(3, size=n)
    counts = np.zeros(shape)
    for i in range(n):
        for k in range(4):
            np.add.at(counts[where[i], what[i], k], bins[i, :, k], 1)
    told = Taps(bins, where, what, shape[:2]).under(story, edges=np.arange(6) - 0.5, pseudocount=0.3)
    joint = jax.jit(lambda p: log_density(told, (), {}, {"p": p})[0])
    differences = []
    with jax.enable_x64(True):
        for _ in range(4):
            p = rng.dirichlet(np.ones(5), size=shape[:3])
            differences.append(float(joint(p)) - dirichlet_log_density(p, counts + 0.3))
    posterior_mean = (counts + 0.3) / (counts + 0.3).sum(-1, keepdims=True)

    assert np.ptp(differences) < 1e-9
    np.testing.assert_allclose(posterior_mean, reference.histogram_probabilities(counts, 0.3), rtol=1e-15)


@pytest.mark.slow
def test_a_chain_recovers_the_conjugate_posterior(rng):
    """Posterior means of 2 x 1 classes, 2 taxels and 3 bins are Eq. 2 within Monte Carlo error.

    The tree of NUTS would take seconds to compile.
    """
    import arviz as az

    shape, pseudocount, draws = (2, 1, 2, 3), 0.8, 600
    where = np.array([0, 0, 0, 1])
    bins = rng.integers(3, size=(4, 5, 2))
    counts = np.zeros(shape)
    for i in range(4):
        for k in range(2):
            np.add.at(counts[where[i], 0, k], bins[i, :, k], 1)
    concentration = counts + pseudocount
    total = concentration.sum(-1, keepdims=True)
    mean = reference.histogram_probabilities(counts, pseudocount)
    deviation = np.sqrt(mean * (1 - mean) / (total + 1))

    told = Taps(bins, where, np.zeros(4, int), (2, 1)).under(story, edges=np.arange(4) - 0.5, pseudocount=pseudocount)
    sampler = MCMC(
        HMC(told, trajectory_length=1.5), num_warmup=300, num_samples=draws, num_chains=2, chain_method="vectorized",
        progress_bar=False,
    )  # fmt: skip
    sampler.run(jax.random.key(1))
    p = az.from_dict({"posterior": {"p": np.asarray(sampler.get_samples(group_by_chain=True)["p"])}})["posterior"]["p"]

    assert p.shape == (2, draws, *shape)
    assert float(az.rhat(p).max()) < 1.05
    assert (np.abs(p.mean(("chain", "draw")) - mean) < 4 * az.mcse(p)).all()
    np.testing.assert_allclose(p.std(("chain", "draw")), deviation, rtol=0.25)


@pytest.mark.parametrize("seed", [2, 6])
def test_without_a_pseudocount_many_taps_are_impossible_under_their_own_class(seed):
    """A quarter to a half of simulated test taps, which is why there is one."""
    train, test = (simulate_session(PRESETS["paper"], seed, session) for session in (0, 1))
    model = fit(train, train.grid(), pseudocount=0)
    where, what = test.indices(model.grid)
    own = model.log_likelihood(test.taps)[np.arange(len(test)), where, what]

    assert 0.25 < np.isneginf(own).mean() < 0.5


# Classes without a tap


def test_untouched_classes_are_named(taps, grid):
    """Objects and positions as a whole, single cells as such."""
    some = empty_cells(taps, *[(l, 1) for l in range(L)], *[(2, m) for m in range(M)], (0, 3))
    model = fit(some, grid)

    assert model.left_out == ("rod 4 mm", "3 mm", "rod 8 mm at 0 mm")
    assert model.trained.tolist() == [[True, False, True, False], [True, False, True, True], [False] * 4]
    np.testing.assert_allclose(model.probabilities[~model.trained], 1 / 100)


def test_trim_drops_untouched_objects_and_ends(taps, grid):
    """A position between others stays, so that a class remains a step."""
    middle = empty_cells(taps, *[(1, m) for m in range(M)])
    end = empty_cells(taps, *[(0, m) for m in range(M)], *[(l, 3) for l in range(L)])

    assert [(part.shape, names) for part, names in (trim(grid, [taps]), trim(grid, [middle]))] == [((3, 4), ())] * 2
    kept, dropped = trim(grid, [end])
    assert (kept.shape, dropped) == ((2, 3), ("rod 8 mm", "0 mm"))
    assert kept.where_value.tolist() == [1.5, 3.0]
    assert fit(end, kept).left_out == ()
    assert trim(grid, [end, middle])[1] == ()


def test_grids_without_a_tap_are_refused(taps):
    """Neither fitted nor trimmed."""
    elsewhere = ClassGrid(np.array([50.0]), "mm", None, (("rod 2 mm",),))
    with pytest.raises(InputError, match="No training tap belongs"):
        fit(taps, elsewhere)
    with pytest.raises(InputError, match="No training tap belongs"):
        trim(elsewhere, [taps])


def test_usable_taps_are_those_of_trained_classes(taps, grid):
    """Others, and those outside the grid, are left out; where none is left, that is an error."""
    model = fit(empty_cells(taps, (0, 0), (2, 3)), grid)
    where, what = model.usable(taps).indices(grid)

    assert model.trained[where, what].all()
    assert len(where) == len(taps) * 10 // 12
    assert fit(taps, grid).usable(taps) is taps
    with pytest.raises(InputError, match="No tap left: none belongs"):
        model.usable(taps.select((taps.what == 0) & (taps.where == 0)))


def test_taps_prepared_otherwise_are_refused(make_taps, taps, grid):
    """The message says how they differ."""
    model = fit(taps, grid)
    other = make_taps(L, M, J, K, preprocessing=Preprocessing(samples=J, rate_hz=40.0, highpass_hz=0.5))

    model.check_taps(taps.preprocessing)
    sentence = "rate_hz is 50.0 in the model and 40.0 in the taps; highpass_hz is 0.0 in the model and 0.5 in the taps"
    with pytest.raises(InputError, match=sentence):
        model.usable(other)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"bins": 0}, "bins must be at least 1, got 0"),
        ({"pseudocount": -0.1}, "pseudocount must be finite and not negative, got -0.1"),
        ({"pseudocount": np.nan}, "pseudocount must be finite and not negative, got nan"),
        ({"pseudocount": np.inf}, "pseudocount must be finite and not negative, got inf"),
        ({"power": "K"}, "got 'K'"),
        ({"power": 0.0}, "got 0.0"),
        ({"value_range": "session"}, "range must be global or taxel, got 'session'"),
    ],
)
def test_arguments_out_of_range_are_refused(taps, grid, more, message):
    """The message shows what was given."""
    with pytest.raises(InputError, match=message):
        fit(taps, grid, **more)
