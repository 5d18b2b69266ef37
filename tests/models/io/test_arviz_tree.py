"""Trees for ArviZ: what their groups hold, and that every function that the docs name takes them as they are."""

import pickle
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from own_stories import shifted
from scipy.stats import invgamma, kstest, norm, wishart
from slow_cases import slow_but
from solidtouch.inference.fit import fit
from solidtouch.models.errors import InputError
from solidtouch.models.io.arviz_tree import STATISTICS, to_arviz
from solidtouch.models.measurement.fits.posterior import SamplePosterior
from solidtouch.models.measurement.generic import fit as generic_fit

L, M, J, K, DRAWS = 2, 3, 4, 2, 200


@pytest.fixture(scope="module")
def taps(make_taps):
    return make_taps(L, M, J, K, sessions=2, repeats=8)


@pytest.fixture(scope="module")
def model(taps):
    return fit(taps, "gaussian", bins=30)


@pytest.fixture(scope="module")
def tree(model, taps):
    return to_arviz(model, taps, draws=DRAWS)


@pytest.fixture(scope="module")
def az():
    import arviz  # where it comes before NumPyro, it leaves a lazy one behind that lacks submodules

    return arviz


# Groups


def test_groups_have_one_observed_name_and_the_labels_of_taps(tree, taps, model):
    """One number per tap and one chain of independent draws, of parameters with dims that ArviZ takes."""
    for name in ("log_likelihood", "posterior_predictive", "observed_data"):
        group = tree[name]
        assert list(group.data_vars) == ["taps"]
        np.testing.assert_array_equal(group["session"], taps.session)
        np.testing.assert_array_equal(group["where"], taps.where)
        assert group["what"].values.tolist() == [taps.what_name[m] for m in taps.what]
        assert group.attrs["inference_library"] == "solidtouch"
        assert group.attrs["created_at"] > "2020"
    assert tree["posterior_predictive"].sizes == {"chain": 1, "draw": DRAWS, "tap": len(taps)}
    assert tree["posterior"]["level"].sizes == {"chain": 1, "draw": DRAWS, "where": L, "what": M, "taxel": K}
    assert set(tree["prior"].data_vars) == {"variance"}
    assert tree.attrs["created_at"] == tree["prior"].attrs["created_at"]


def test_the_log_likelihood_is_that_of_the_bins_of_a_tap(tree, taps, model):
    """Normal probabilities between the edges, the end bins open."""
    where, what = taps.indices(model.grid)
    edges = np.append(np.append(-np.inf, model.edges[1:-1]), np.inf)
    bins = model.bins(taps.taps)
    for draw in (0, DRAWS - 1):
        level, variance = (tree["posterior"][n].values[0, draw].astype(float) for n in ("level", "variance"))
        mean = level * model.scaling.unit + model.scaling.centre
        law = norm(mean[where, what][:, None], (np.sqrt(variance) * model.scaling.unit)[where, what][:, None])
        expected = np.log(law.cdf(edges[bins + 1]) - law.cdf(edges[bins])).sum(axis=(1, 2))
        np.testing.assert_allclose(tree["log_likelihood"]["taps"][0, draw], expected, rtol=1e-4)


def test_prior_draws_and_log_prior_are_of_the_prior_of_the_fit(tree, model):
    """Inverse gamma variances whose parameters the fit has estimated; levels have a flat prior."""
    prior = model.posterior.prior
    for k in range(K):
        law = invgamma(prior.a[k], scale=prior.b[k])
        assert kstest(tree["prior"]["variance"][..., k].values.ravel(), law.cdf).pvalue > 0.001
    drawn = tree["posterior"]["variance"].values[0]
    expected = invgamma.logpdf(drawn, prior.a, scale=prior.b).sum(axis=-1)
    np.testing.assert_allclose(tree["log_prior"]["variance"][0], expected, rtol=1e-4, atol=1e-4)
    assert (tree["log_prior"]["level"] == 0).all()


def test_predicted_taps_are_of_the_classes_of_the_known_ones(tree, taps, model):
    """Their mean and spread are those of the model at the drawn parameters, to five standard errors."""
    where, what = taps.indices(model.grid)
    gap = (
        tree["posterior_predictive"]["taps"][0]
        - (tree["posterior"]["level"][0].values * model.scaling.unit + model.scaling.centre).mean(axis=-1)[
            :, where, what
        ]
    )
    spread = np.sqrt((tree["posterior"]["variance"][0].values * model.scaling.unit**2).mean(axis=-1) / (J * K))
    z = (gap / spread[:, where, what]).values
    assert abs(z.mean()) < 5 / np.sqrt(z.size)
    assert z.std() == pytest.approx(1, abs=0.02)


ANY_STATISTIC = [*STATISTICS, lambda taps: taps.std(axis=(1, 2))]


@pytest.mark.parametrize("statistic", slow_but(["log_score", ANY_STATISTIC[-1]], ANY_STATISTIC))
def test_a_statistic_is_of_known_and_predicted_taps_alike(taps, model, statistic):
    """Of samples at the centres of their bins, a hundredth of the range away at most."""
    tree = to_arviz(model, taps, draws=20, statistic=statistic)
    observed, predicted = (tree[name]["taps"] for name in ("observed_data", "posterior_predictive"))
    expected = {
        "mean": taps.taps.mean(axis=(1, 2)),
        "peak": taps.taps.max(axis=(1, 2)),
        "log_score": model.log_likelihood(taps.taps)[np.arange(len(taps)), *taps.indices(model.grid)] / model.exponent,
        "samples": taps.taps,
    }.get(statistic, taps.taps.std(axis=(1, 2)))
    np.testing.assert_allclose(observed, expected, atol=1e-3 if statistic == "log_score" else np.ptp(model.edges) / 59)
    assert predicted.dims == ("chain", "draw", *observed.dims)
    assert abs(float(predicted.mean() - observed.mean())) < 0.5 * float(observed.std())


def unknown_of_the_third(taps):
    return np.where(np.arange(len(taps)) == 2, np.nan, 0.0)


def seen(taps):
    """A number for the known taps alone, which it gets first."""
    seen.calls += 1
    return np.full(len(taps), np.nan if seen.calls > 1 else 0.0)


@pytest.mark.parametrize(
    ("statistic", "told"),
    [
        ("median", "one of mean, peak"),
        (lambda taps: taps.mean(), "one number per tap"),
        (unknown_of_the_third, "a number for each tap, got NaN for tap 2"),
        (seen, "a number for each tap, got NaN for tap drawn like tap 0"),
    ],
)
def test_a_statistic_of_another_kind_is_refused(taps, model, statistic, told):
    seen.calls = 0
    with pytest.raises(InputError, match=f"statistic must .*{told}"):
        to_arviz(model, taps, draws=2, statistic=statistic)


def test_parameters_are_chosen_by_name_and_label(taps, model):
    """In all groups that have them."""
    tree = to_arviz(model, taps, draws=3, var_names="variance", coords={"what": taps.what_name[1], "taxel": [0]})
    for name in ("posterior", "prior"):
        assert tree[name]["variance"].sizes == {"chain": 1, "draw": 3, "where": L, "what": 1, "taxel": 1}
        assert list(tree[name].data_vars) == ["variance"]
    assert tree["log_prior"]["variance"].sizes == {"chain": 1, "draw": 3, "where": L, "what": 1}
    with pytest.raises(InputError, match="no parameter 'rate'; choose from level, variance"):
        to_arviz(model, taps, draws=3, var_names=["rate"])
    with pytest.raises(InputError, match="what has no 'cube'"):
        to_arviz(model, taps, draws=3, coords={"what": "cube"})
    with pytest.raises(InputError, match="the gaussian model has no dimension 'wher'; choose from where, what, taxel"):
        to_arviz(model, taps, draws=3, coords={"wher": 0})
    with pytest.raises(InputError, match="coords must be labels by dimension"):
        to_arviz(model, taps, draws=3, coords=["where"])


def test_draws_follow_their_seed(tree, taps, model):
    """The same for one seed, and others for another."""
    again, other = (to_arviz(model, taps, draws=5, seed=seed) for seed in (0, 1))
    for name in ("posterior", "prior", "posterior_predictive"):
        for variable in again[name].data_vars:
            first = tree[name][variable].values[:, :5]
            np.testing.assert_array_equal(again[name][variable], first)
            assert not np.array_equal(other[name][variable], first)


def test_markov_chains_stay_chains(taps, model):
    """Evenly thinned to the number of draws, so that what ArviZ says of their mixing is about them."""
    level = np.random.default_rng(0).normal(size=(4, 50, L, M, 1, K))
    known = {"level": level, "variance": np.ones_like(level)}
    chains = SamplePosterior(known, {}, {"prior": model.posterior.prior})
    tree = to_arviz(replace(model, posterior=chains), taps, draws=40)

    kept = np.linspace(0, 49, 10).astype(int)
    np.testing.assert_allclose(tree["posterior"]["level"], level[:, kept][..., 0, :], rtol=1e-6)
    assert tree["log_likelihood"].sizes == {"chain": 4, "draw": 10, "tap": len(taps)}
    assert tree.attrs["inference_library"] == "numpyro"


NAMES = ["histogram", "profile-ar", "profile-mvn", "matrix-normal", "smooth", "session:profile"]


@pytest.mark.parametrize("name", slow_but(["session:profile"], [*NAMES, "student"]))
def test_all_models_have_all_groups(taps, make_taps, name):
    """With finite numbers."""
    used = make_taps(4, M, J, K, sessions=2, repeats=4) if name == "smooth" else taps
    tree = to_arviz(fit(used, name, bins=20, unconverged=True), used, draws=3)

    assert len(tree.children) == 6
    for group in tree.children.values():
        assert all(np.isfinite(values).all() for values in group.data_vars.values())
    for variable in tree["prior"].data_vars:
        assert tree["prior"][variable].dims == tree["posterior"][variable].dims


def test_a_function_of_a_user_has_all_groups(taps, monkeypatch, rng):
    """Also one with sessions, whose new session has no part in the log prior; set by hand, as a fit takes seconds."""
    known = {
        "loc": rng.normal(size=(L, M, K)),
        "scale": rng.uniform(0.5, 1.5, size=(L, M, K)),
        "drift": np.array(0.5),
        "shift": rng.normal(size=(2, K)),
    }
    found = generic_fit.GuidePosterior(known, lambda _: known, generic_fit.Convergence(True, "Set by hand.", {}))
    monkeypatch.setattr(generic_fit, "posterior", lambda *_: found)
    monkeypatch.setattr(generic_fit, "check_prior", lambda _: "")
    model = fit(taps, shifted, bins=20, method="map", unconverged=True)
    tree = to_arviz(model, taps, draws=2)
    names = "loc", "scale", "drift", "shift"
    latents = {name: tree["posterior"][name].values[0, 0].astype(float) for name in names}

    assert set(tree["prior"].data_vars) == set(latents)
    assert {"log_likelihood", "posterior_predictive"} < tree.children.keys()
    assert latents["shift"].shape == (3, K)
    expected = norm.logpdf(latents["shift"][:2], 0, latents["drift"]).sum()
    np.testing.assert_allclose(tree["log_prior"]["shift"][0, 0], expected, rtol=1e-4)
    np.testing.assert_allclose(tree["log_prior"]["loc"][0, 0], norm.logpdf(latents["loc"], 0, 3).sum(-1), rtol=1e-4)
    assert tree.attrs["inference_library"] == "numpyro"


def test_the_prior_of_covariances_is_that_of_drawn_precisions(taps, rng):
    """Parameters have a factor of the covariance across taxels, the prior both as they were drawn."""
    model = fit(taps, "matrix-normal", bins=20)
    drawn = model.posterior.draw(rng)
    density = model.prior(model.posterior).log_density(drawn)
    prior, unit = model.posterior.prior, drawn["unit"]
    time = np.linalg.inv(drawn["time_covariance"] * unit)
    taxel = np.linalg.inv(drawn["taxel_covariance"] / unit)

    assert density["taxel"][0] == ("where", "what")
    expected = wishart.logpdf(time, prior.time_freedom, np.linalg.inv(prior.time_scale))
    assert density["time"][1] == pytest.approx(expected)
    expected = wishart.logpdf(taxel[1, 2], prior.taxel_freedom, np.linalg.inv(prior.taxel_scale))
    assert density["taxel"][1][1, 2] == pytest.approx(expected)


def test_classes_without_taps_have_no_part_in_the_log_prior(taps):
    where, what = taps.indices(taps.grid())
    some = taps.select((where != 1) | (what != 1))
    tree = to_arviz(fit(some, "gaussian", grid=taps.grid(), bins=20), taps, draws=2)

    assert (tree["log_prior"]["variance"][:, :, 1, 1] == 0).all()
    assert tree["log_likelihood"].sizes["tap"] == len(some)


def test_a_model_without_a_posterior_is_refused(taps, model):
    """One from a file or a pickle, or with an improper prior."""
    copied = pickle.loads(pickle.dumps(model))  # noqa: S301
    improper = fit(taps, "histogram", bins=20, pseudocount=0.0)

    np.testing.assert_array_equal(copied.log_likelihood(taps.taps), model.log_likelihood(taps.taps))
    for bare in (copied, improper):
        with pytest.raises(InputError, match="model has no posterior"):
            to_arviz(bare, taps)
    with pytest.raises(InputError, match="draws must"):
        to_arviz(model, taps, draws=0)
    with pytest.raises(InputError, match="one that fit returns, got str"):
        to_arviz("model.nc", taps)


# Functions of ArviZ


def test_summary(az, tree):
    """A row for each parameter that is left, of draws that are independent."""
    table = az.summary(tree, var_names=["level"], coords={"taxel": [0]}, round_to="none")
    assert len(table) == L * M
    expected = tree["posterior"]["level"].mean(("chain", "draw"))[..., 0].values.ravel()
    np.testing.assert_allclose(table["mean"], expected, rtol=1e-5)
    assert (table["ess_bulk"] > DRAWS / 4).all()


@pytest.mark.slow
def test_loo(az, make_taps):
    """The exact value of the histogram, where importance sampling works: for few samples and bins."""
    taps = make_taps(2, 2, 1, 2, sessions=2, repeats=10)
    model = fit(taps, "histogram", bins=4, pseudocount=5.0)
    loo = az.loo(to_arviz(model, taps, draws=500), pointwise=True)
    exact = model.leave_out(model.posterior, taps.taps, taps.indices(model.grid)).integrated

    assert float(loo.pareto_k.max()) < loo.good_k
    np.testing.assert_allclose(loo.elpd_i, exact, atol=0.1)
    assert loo.elpd == pytest.approx(exact.sum(), abs=0.5)


PAGE = (Path(__file__).parents[3] / "docs" / "how-to" / "arviz.md").read_text(encoding="utf-8")
CALLS = re.findall(r"^\| `(az\..*?)` \|", PAGE, re.MULTILINE)


@pytest.mark.filterwarnings("ignore:Estimated shape parameter:UserWarning")
@pytest.mark.parametrize("call", [call for call in CALLS if "report" not in call])
def test_calls_of_the_page_run_as_they_are(az, tree, call):
    """And plots have a panel."""
    with az.rc_context({"plot.backend": "none"}):
        view = tree.isel(where=[0], what=[0], taxel=[0])
        found = eval(call, {"az": az, "tree": tree, "view": view})  # noqa: S307
    if "plot" in call:
        assert "plot" in found.viz


def test_all_samples_are_plotted_as_one_distribution(az, taps, model):
    """Their dims have no name that ArviZ takes for its own."""
    whole = to_arviz(model, taps, draws=50, statistic="samples")
    assert az.plot_ppc_dist(whole, kind="ecdf", backend="none").viz["plot"]["taps"].shape == ()


def test_loo_pit_is_uniform_for_a_right_model_and_not_for_a_wrong_one(az, tree, taps):
    """Levels that all classes share make taps too far from what is predicted."""
    pit = az.loo_pit(tree)["taps"]
    assert kstest(pit, "uniform").pvalue > 0.01
    wrong = tree.copy()
    wrong["observed_data"]["taps"] = tree["observed_data"]["taps"] * 1.5
    assert kstest(az.loo_pit(wrong)["taps"], "uniform").pvalue < 0.001


def test_plot_prior_posterior(az, tree):
    """A panel for each parameter with a prior."""
    view = tree.isel(where=[0], taxel=[0])
    panels = az.plot_prior_posterior(view, var_names=["variance"], backend="none").viz["plot"]["variance"]
    assert panels.sizes == {"where": 1, "what": M, "taxel": 1}


def test_psense_summary(az, tree):
    """Taps inform each variance, and the prior that classes share does, too."""
    table = az.psense_summary(tree, var_names=["variance"])
    assert len(table) == L * M * K
    assert (table["likelihood"] > 0).all()
    assert (table["prior"] < 1).all()
