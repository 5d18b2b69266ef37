"""Fits of functions whose distributions have bounds, and refusal of probabilities that are none."""

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from scipy import stats
from solidtouch.models.errors import InputError
from solidtouch.models.io.model_file import load_model
from solidtouch.models.measurement.generic import fit as fits
from solidtouch.models.measurement.generic import source
from solidtouch.models.measurement.generic.contract import measurement_model
from solidtouch.models.measurement.likelihood.bins import TableForm

import solidtouch as st

L, M, J, K = 2, 2, 3, 2
quick = {"method": "map", "power": "none", "bins": 30, "unconverged": True}


@pytest.fixture(scope="module")
def taps(make_taps):
    """Samples of object 1 begin at 20, those of object 0 at 0."""
    taps = make_taps(L, M, J, K, repeats=5)
    what = taps.indices(taps.grid())[1]
    samples = 20.0 * what[:, None, None] + np.random.default_rng(5).exponential(3.0, size=taps.taps.shape)
    return st.TapSet(taps.dataset.assign(taps=(taps.dataset["taps"].dims, samples)))


def story_of(distribution):
    """A positive latent variable of classes and taxels, and one of all."""

    @measurement_model(raw=True)
    def bounded(where, what, taps=None, *, L, M, J, K):
        with numpyro.plate("L", L, dim=-3), numpyro.plate("M", M, dim=-2), numpyro.plate("K", K, dim=-1):
            width = numpyro.sample("width", dist.LogNormal(1.0, 1.0))
        lowest = numpyro.sample("lowest", dist.Uniform(-3.0, -1.0))
        with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("taxel", K, dim=-1):
            floor = 20.0 * jnp.asarray(what)[:, None, None]
            numpyro.sample("taps", distribution(width[where, what][:, None], lowest, floor), obs=taps)

    return bounded


def shifted(width, lowest, floor):
    return dist.TransformedDistribution(
        dist.Exponential(1 / width), dist.transforms.AffineTransform(floor + 0.0 * lowest, 1.0)
    )


def truncated(width, lowest, floor):
    return dist.TruncatedNormal(floor, width, low=lowest)


def beyond(width, lowest, floor):
    return dist.Uniform(lowest + 0.0 * floor, lowest + 60.0 + width)


SCIPY = {
    shifted: lambda width, _, floor: stats.expon(floor, width),
    truncated: lambda width, lowest, floor: stats.truncnorm((lowest - floor) / width, np.inf, floor, width),
    beyond: lambda width, lowest, _: stats.uniform(lowest, 60.0 + width),
}


@pytest.fixture
def by_hand(monkeypatch):
    """Latent variables are set and not fitted, which takes a second of compiling."""

    def near(fit, _):
        values = {"width": np.random.default_rng(3).uniform(2.0, 4.0, size=(L, M, K)), "lowest": np.array(-2.0)}
        return fits.GuidePosterior(values, lambda _: values, fits.Convergence(True, "Set by hand.", {}))

    monkeypatch.setattr(fits, "posterior", near)


@pytest.mark.parametrize(
    ("distribution", "fitted"),
    [
        pytest.param(truncated, True, marks=pytest.mark.slow),
        (shifted, False),
        pytest.param(beyond, False, marks=pytest.mark.slow),
        pytest.param(shifted, True, marks=pytest.mark.slow),
        pytest.param(beyond, True, marks=pytest.mark.slow),
    ],
)
def test_bounds_may_be_latent(distribution, fitted, taps, request):
    """Likelihoods are those of SciPy, -inf under classes that exclude a sample."""
    if not fitted:
        request.getfixturevalue("by_hand")
    model = st.fit(taps, story_of(distribution), **quick)
    opened = model.edges.copy()
    opened[0], opened[-1] = -np.inf, np.inf
    bins, own = model.bins(taps.taps), model.parameters
    floor = 20.0 * np.arange(M)[:, None, None]
    of_scipy = SCIPY[distribution](own["width"][:, :, None], own["lowest"], floor)
    lower, upper = (opened[bins + side][:, None, None] for side in (0, 1))
    with np.errstate(divide="ignore"):
        left, right = of_scipy.cdf(upper) - of_scipy.cdf(lower), of_scipy.sf(lower) - of_scipy.sf(upper)
        expected = np.log(np.where(of_scipy.cdf(lower) > 0.5, right, left)).sum(axis=(-2, -1))
    found = model.log_likelihood(taps.taps)

    assert np.isneginf(expected).any() == (distribution is shifted)
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_a_fit_that_excludes_samples_says_so(taps):
    """A uniform distribution is the more likely, the nearer its ends are to the samples."""

    def narrow(width, lowest, floor):
        return dist.Uniform(floor + lowest, floor + lowest + 10 * width)

    with pytest.raises(InputError, match="at any start; check scales, and keep bounds of distributions outside"):
        st.fit(taps, story_of(narrow), method="map", bins=30)
    assert "not finite; keep bounds" in fits._told("map", np.nan, 0.1, np.array([3.0, np.inf]), [3.0]).sentence


class Sixfold(dist.Exponential):
    """Its distribution function rises to 6."""

    def cdf(self, value):
        return 6 * super().cdf(value)


def test_probabilities_above_1_are_refused(taps, by_hand):
    with pytest.raises(InputError, match=r"bounded gives position 0 and object 0 .* above 1; .* Sixfold, and"):
        st.fit(taps, story_of(lambda width, lowest, floor: Sixfold(5 / width + 0.0 * (lowest + floor))), **quick)


def test_a_table_without_numbers_is_not_opened(taps, by_hand, tmp_path, monkeypatch):
    """NaN stands for untrained classes alone."""
    monkeypatch.setattr(source, "_registered", {})
    model = st.fit(taps, story_of(shifted), **quick)
    wrong = model.plain_form.log_prob.copy()
    wrong[1, 0, 0, 3] = np.nan
    vars(model)["plain_form"] = TableForm(wrong)
    model.save(tmp_path / "fit.nc")
    source._registered.clear()

    with pytest.raises(InputError, match=r"fit\.nc: the table .* is not a number for position 1 and object 0"):
        load_model(tmp_path / "fit.nc")
