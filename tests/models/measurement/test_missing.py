"""Samples that are missing: what is left of a likelihood and a fit, and which models refuse."""

from dataclasses import replace

import jax
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from own_stories import laplace, levels, normal, two_levels, walk
from scipy import stats
from scipy.special import logsumexp
from slow_cases import slow_but
from solidtouch.analysis.experiment.crosscheck import crosscheck_model
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.draws import integrated
from solidtouch.models.measurement.generic import fit as fits
from solidtouch.models.measurement.likelihood.story_likelihood import log_likelihoods
from solidtouch.models.measurement.registry import fit_model, model_name
from solidtouch.models.measurement.shared_gain import session_spread, state_grid
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import TapSet

import solidtouch as st

L, M, J, K, B = 3, 2, 4, 3, 7
SETTINGS = FitSettings(bins=B, power="none", unconverged=True)
OWN = {story.__name__: story for story in (laplace, levels, normal, two_levels)}


def forecast(where, what, taps=None, *, L, M, J, K):
    """Samples near those before, written as single normals."""
    with numpyro.plate("K", K):
        scale = numpyro.sample("scale", dist.LogNormal(0.0, 1.0))
    before = (
        0.0 if taps is None else np.pad(np.ones((1, J - 1, 1)), ((0, 0), (1, 0), (0, 0))) * jax.numpy.roll(taps, 1, 1)
    )
    numpyro.sample("taps", dist.Normal(before, scale).expand([len(where), J, K]), obs=taps)


class Plain(dist.Normal):
    """A normal distribution without its distribution function."""

    cdf = dist.Distribution.cdf


def without_cdf(where, what, taps=None, *, L, M, J, K):
    """Samples whose distribution has no distribution function."""
    with numpyro.plate("L", L, dim=-3), numpyro.plate("M", M, dim=-2), numpyro.plate("K", K, dim=-1):
        loc = numpyro.sample("loc", dist.Normal(0.0, 1.0))
    numpyro.sample("taps", Plain(loc[where, what][:, None], 2.0).expand([len(where), J, K]), obs=taps)


def missing(taps, index, value=np.nan):
    """The same taps without the samples of an index, or with another value there."""
    samples = taps.taps.copy()
    samples[index] = value
    return TapSet(taps.dataset.assign(taps=(taps.dataset["taps"].dims, samples)).assign_attrs(missing="drop"))


@pytest.fixture(scope="module")
def taps(make_taps):
    return make_taps(L, M, J, K, repeats=4)


@pytest.fixture(scope="module")
def random_holes(taps):
    """Taps without a fifth of their samples."""
    return missing(taps, np.random.default_rng(2).random(taps.taps.shape) < 0.2)


def by_hand(fit, _):
    """In place of a fit, which takes seconds to compile."""
    shapes = {
        name: [{"where": L, "what": M, "sample": J, "taxel": K}[dim] for dim in dims]
        for name, dims in fit.structure.dims.items()
    }
    rng = np.random.default_rng(2)
    values = {
        name: rng.normal(size=shape) if name in ("loc", "level", "low") else rng.uniform(0.5, 0.9, size=shape)
        for name, shape in shapes.items()
    }
    return fits.GuidePosterior(values, lambda _: values, fits.Convergence(True, "By hand.", {}))


def set_by_hand(story, taps):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fits, "posterior", by_hand)
        patch.setattr(fits, "check_prior", lambda _: "")  # fits that see what is missing look at it
        return fit_model(model_name(story), taps, taps.grid(), SETTINGS).model


@pytest.fixture(scope="module")
def models(taps, as_student):
    """Models that leave out samples, with states and integrated over draws, too."""
    grid, states = taps.grid(), state_grid(0.1, 0.2, 3, 1)
    found = {name: fit_model(name, taps, grid, SETTINGS) for name in ("histogram", "gaussian", "profile")}
    made = {name: fitted.model for name, fitted in found.items()} | {
        "student": as_student(found["gaussian"].model),
        "histogram in states": replace(found["histogram"].model, states=states),
        "profile in states": replace(found["profile"].model, states=states),
        "histogram integrated": found["histogram"].integrated(3, 0).model,
        "profile integrated": found["profile"].integrated(3, 0).model,
        "smooth": fit_model("smooth", taps, grid, SETTINGS).model,
    }
    return {
        name: model.with_missing("drop")
        for name, model in (made | {n: set_by_hand(s, taps) for n, s in OWN.items()}).items()
    }


NAMES = (
    *("histogram", "gaussian", "profile", "student", "smooth", *OWN),
    *("histogram in states", "profile in states", "histogram integrated", "profile integrated"),
)


@pytest.mark.parametrize("name", slow_but(["profile in states"], NAMES))
def test_a_missing_sample_is_summed_over_its_bins(name, models, taps):
    """Which is what leaving it out means where samples are independent; the sums are over taps that lack nothing."""
    model, tap = models[name], taps.taps[5]
    centres = 0.5 * (model.edges[:-1] + model.edges[1:])
    each = np.tile(tap, (B * B, 1, 1))
    each[:, 1, 2], each[:, 3, 0] = np.repeat(centres, B), np.tile(centres, B)
    expected = logsumexp(model.log_likelihood(each), axis=0)
    lacking = tap.copy()
    lacking[1, 2] = lacking[3, 0] = np.nan
    many = np.concatenate((lacking[None], taps.taps[:40]))  # more taps than bins are looked up in tables

    for given in (lacking[None], many):
        np.testing.assert_allclose(model.log_likelihood(given)[0], expected, rtol=1e-9)
    np.testing.assert_allclose(log_likelihoods(model, lacking[None])[0], expected, rtol=1e-9)
    own = model.form.own(many[:1], model.edges, np.array([2]), np.array([1]))
    assert own[0] == pytest.approx(expected[2, 1], rel=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_a_tap_without_samples_says_nothing(name, models, taps):
    """Its likelihood is 1 in every class that was trained, and 0 in others."""
    model = models[name]
    empty = np.full((1, J, K), np.nan)
    np.testing.assert_allclose(model.log_likelihood(empty), 0.0, atol=1e-12)

    here = (taps.indices(taps.grid())[0] != 1) | (taps.what != 1)
    if name in ("histogram", "profile"):
        holed = fit_model(name, taps.select(here), taps.grid(), SETTINGS).model.with_missing("drop")
        assert np.argwhere(np.isneginf(holed.log_likelihood(empty)[0])).tolist() == [[1, 1]]


def test_densities_of_missing_samples_are_left_out(taps):
    """The others are densities times the widths of bins."""
    model = set_by_hand(without_cdf, taps).with_missing("drop")
    assert model.measure == "density"
    samples = np.where(np.arange(J)[:, None] == 2, np.nan, taps.taps[:3])
    scaled = (samples - model.scaling.centre) / model.scaling.unit
    loc = model.parameters["loc"][:, :, None]
    density = stats.norm(loc, 2.0).logpdf(scaled[:, None, None]) + np.log(np.diff(model.edges)[0] / model.scaling.unit)

    np.testing.assert_allclose(model.log_likelihood(samples), np.nansum(density, axis=(-2, -1)), rtol=1e-9)


@pytest.mark.parametrize("name", ["histogram", "gaussian", "profile"])
def test_a_dead_taxel_leaves_the_model_of_the_others(name, taps, make_taps):
    """In training and at perception; a dead one trained as well as an absent one."""
    alive = TapSet(taps.dataset.isel(taxel=slice(K - 1)))
    dead = missing(taps, np.s_[..., K - 1])
    edges = np.linspace(taps.taps.min(), taps.taps.max(), B + 1)
    settings = SETTINGS.changed(edges=edges)
    fitted = [fit_model(name, each, each.grid(), settings) for each in (alive, dead, taps)]
    (other, lacking, whole), own = (each.model for each in fitted), taps.indices(taps.grid())
    expected = other.log_likelihood(alive.taps)
    scores = [
        integrated(each, part.taps, own, np.random.default_rng(0))
        for each, part in zip(fitted, (alive, dead, dead), strict=True)
    ]
    left_out = [each.leave_out(part).integrated for each, part in zip(fitted[:2], (alive, dead), strict=True)]

    np.testing.assert_allclose(scores[1:], [scores[0]] * 2, rtol=1e-9)
    np.testing.assert_allclose(left_out[1], left_out[0], rtol=1e-9)
    np.testing.assert_allclose(lacking.log_likelihood(dead.taps), expected, rtol=1e-9)
    np.testing.assert_allclose(whole.judging(dead).log_likelihood(dead.taps), expected, rtol=1e-9)


@pytest.mark.parametrize("name", ["histogram", "gaussian", "profile"])
def test_nothing_changes_where_nothing_is_missing(name, taps):
    """To the last digit."""
    marked = missing(taps, [])
    plain, other = (fit_model(name, each, each.grid(), SETTINGS) for each in (taps, marked))

    np.testing.assert_array_equal(plain.model.log_likelihood(taps.taps), other.model.log_likelihood(taps.taps))
    for parameter, values in plain.posterior.point().items():
        np.testing.assert_array_equal(values, other.posterior.point()[parameter])


def test_histograms_count_the_samples_that_are_there(random_holes):
    """By a loop."""
    model = fit_model("histogram", random_holes, random_holes.grid(), SETTINGS).model
    counts = np.zeros((L, M, K, B))
    for where, what, tap in zip(*random_holes.indices(model.grid), random_holes.taps, strict=True):
        for k in range(K):
            counts[where, what, k] += np.histogram(tap[~np.isnan(tap[:, k]), k], model.edges)[0]

    np.testing.assert_array_equal(model.counts, counts)
    assert (model.edges[0], model.edges[-1]) == (np.nanmin(random_holes.taps), np.nanmax(random_holes.taps))


@pytest.mark.parametrize(("name", "axes"), [("gaussian", (0, 1)), ("profile", (0,))])
def test_levels_are_means_of_the_samples_that_are_there(name, axes, random_holes):
    """In units and around centres that these samples alone give."""
    model = fit_model(name, random_holes, random_holes.grid(), SETTINGS).model
    where, what = random_holes.indices(model.grid)
    level = model.parameters["level"] * model.scaling.unit + model.scaling.centre

    np.testing.assert_allclose(model.scaling.centre, np.nanmean(random_holes.taps, axis=(0, 1)), rtol=1e-12)
    for l, m in np.ndindex(L, M):
        own = random_holes.taps[(where == l) & (what == m)]
        np.testing.assert_allclose(level[l, m], np.nanmean(own, axis=axes).reshape(level[l, m].shape), rtol=1e-9)


def test_taps_without_samples_are_as_no_taps(taps):
    """In all that a session model learns; other missing samples change the spread of sessions a little."""
    gone = np.arange(len(taps)) % 5 == 2
    lacking, rest = missing(taps, gone), taps.select(~gone)
    settings = SETTINGS.changed(edges=np.linspace(-4, 9, B + 1))
    for name, rtol in (("session", 1e-9), ("session:gaussian", 1e-4)):  # whose prior is found by steps
        found, expected = (fit_model(name, each, taps.grid(), settings).model for each in (lacking, rest))
        np.testing.assert_allclose(found.log_likelihood(rest.taps), expected.log_likelihood(rest.taps), rtol=rtol)

    whole, few = session_spread(taps, taps.grid(), settings.edges)[:2], missing(taps, np.s_[::3, 1, 0])
    np.testing.assert_allclose(session_spread(few, taps.grid(), settings.edges)[:2], whole, rtol=0.5)


def test_the_law_of_left_out_taps_holds(random_holes):
    """Left-out taps by subtraction have the probability that a fit to the others gives them."""
    fitted = fit_model(
        "histogram", random_holes, random_holes.grid(), SETTINGS.changed(edges=np.linspace(-4, 9, B + 1))
    )
    where, what = random_holes.indices(fitted.model.grid)
    left_out = fitted.leave_out(random_holes)
    rest = random_holes.select(np.arange(len(random_holes)) != 3)
    others = fit_model("histogram", rest, fitted.model.grid, SETTINGS.changed(edges=fitted.model.edges))
    own, tap = (where[3:4], what[3:4]), random_holes.taps[3:4]

    assert left_out.integrated[3] == pytest.approx(
        others.model.integrated(others.posterior, tap, own, None, 1.0, 0.0)[0]
    )
    assert left_out.plug_in[3] == pytest.approx(others.model.judging(rest).log_likelihood(tap)[0][where[3], what[3]])


@pytest.mark.parametrize("story", slow_but([two_levels], [normal, two_levels]))
def test_a_fit_of_a_function_sees_the_samples_that_are_there(story, random_holes):
    """The log density of its taps is the sum over these, in the units that these give."""
    seen = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fits, "posterior", lambda fit, method: seen.append(fit) or by_hand(fit, method))
        model = fit_model(model_name(story), random_holes, random_holes.grid(), SETTINGS).model
    fit, own = seen[0], {name: np.asarray(values) for name, values in model.parameters.items()}
    scaled = (random_holes.taps - model.scaling.centre) / model.scaling.unit
    at = fit.batch.where, fit.batch.what
    if story is normal:
        density = stats.norm.logpdf(scaled, own["level"][at][:, None], np.sqrt(own["variance"][at])[:, None])
    else:
        low, gap, scale, share = (own[name][at][:, None] for name in ("low", "gap", "scale", "share"))
        levels = (np.log1p(-share), low), (np.log(share), low + gap)
        parts = [log_weight + stats.norm.logpdf(scaled, level, scale) for log_weight, level in levels]
        density = logsumexp(parts, axis=0)
    with jax.enable_x64(True):
        held = numpyro.handlers.block(numpyro.handlers.substitute(fit.summed, data=own), hide=list(own))
        if fit.structure.enumerated:
            from numpyro.contrib.funsor import enum, log_density

            held = enum(held, first_available_dim=-8)
        else:
            from numpyro.infer.util import log_density
        found = jax.jit(lambda samples: log_density(held, (samples,), {}, {})[0])(fit.samples)

    assert float(found) == pytest.approx(np.nansum(density), rel=1e-9)


def known_scale(where, what, taps=None, *, L, M, J, K):
    """A level of each class and taxel, whose posterior is normal."""
    with numpyro.plate("L", L, dim=-3), numpyro.plate("M", M, dim=-2), numpyro.plate("K", K, dim=-1):
        level = numpyro.sample("level", dist.Normal(0.0, 3.0))
    with numpyro.plate("tap", len(where), dim=-2), numpyro.plate("taxel", K, dim=-1):
        over_time = None if taps is None else jax.numpy.swapaxes(taps, 1, 2)
        each = dist.Normal(level[where, what][..., None], 1.0).expand([len(where), K, J])
        numpyro.sample("taps", each.to_event(1), obs=over_time)


@pytest.mark.slow
@pytest.mark.parametrize(("method", "far"), [("map", 0.01), ("svi", 0.5), ("nuts", 0.3)])
def test_fits_find_the_level_of_the_samples_that_are_there(method, far, random_holes):
    """Up to a fraction of its posterior deviation; observed with taxels before times, one of them dead in a class."""
    own = np.argwhere((random_holes.what == 1) & (random_holes.where == 0)).ravel()
    taps = missing(random_holes, np.s_[own, :, 2])
    model = st.fit(taps, model=known_scale, method=method, missing="drop", bins=B, unconverged=True)
    where, what = taps.indices(model.grid)
    scaled = (taps.taps - model.scaling.centre) / model.scaling.unit
    for l, m in np.ndindex(L, M):
        of_class = scaled[(where == l) & (what == m)]
        precision = 1 / 9 + (~np.isnan(of_class)).sum(axis=(0, 1))
        deviation = np.abs(model.parameters["level"][l, m] - np.nansum(of_class, axis=(0, 1)) / precision)
        assert (deviation * np.sqrt(precision) < far).all()


@pytest.mark.slow
def test_chains_and_variational_fits_of_built_in_models_leave_out_samples(random_holes):
    """Levels of `gaussian` by chains, and of `student` by its fit, are near the exact ones of `gaussian`."""
    exact = fit_model("gaussian", random_holes, random_holes.grid(), SETTINGS)
    deviation = np.sqrt(exact.posterior.cells.b / exact.posterior.cells.a / exact.posterior.cells.strength)
    for name, method, far in (("gaussian", "nuts", 0.3), ("student", "closed", 1.5)):
        found = fit_model(name, random_holes, random_holes.grid(), SETTINGS.changed(method=method)).model
        gap = np.abs(found.parameters["level"] - exact.model.parameters["level"]) / deviation
        assert gap.max() < far


@pytest.mark.parametrize("name", ["profile-ar", "profile-mvn", "matrix-normal", "smooth", walk, forecast])
def test_a_model_of_dependent_samples_refuses_to_learn(name, random_holes):
    told = name if isinstance(name, str) else name.__name__
    with pytest.raises(InputError, match=f"missing, and {told} cannot be fitted without them"):
        fit_model(model_name(name), random_holes, random_holes.grid(), SETTINGS)


@pytest.mark.parametrize("name", ["profile-mvn", walk, forecast])
def test_a_model_of_dependent_samples_refuses_to_judge(name, taps, random_holes):
    model = fit_model(name, taps, taps.grid(), SETTINGS).model if isinstance(name, str) else set_by_hand(name, taps)
    with pytest.raises(InputError, match=f"{model.kind} cannot leave them out"):
        model.judging(random_holes).log_likelihood(random_holes.taps)


def test_what_is_not_to_be_dropped_is_refused(taps, random_holes, models):
    samples = random_holes.taps
    for model in (models["histogram"].with_missing("refuse"), models["normal"].with_missing("refuse")):
        for judge in (model.log_likelihood, model.bins):
            with pytest.raises(InputError, match="must not be NaN"):
                judge(samples)
    samples = np.where(np.isnan(samples), np.inf, samples)
    for model in models.values():
        with pytest.raises(InputError, match="must not be NaN or infinite"):
            model.log_likelihood(samples)
    with pytest.raises(InputError, match="missing must be refuse or drop, got 'ignore'"):
        models["histogram"].with_missing("ignore")


def test_a_class_without_samples_of_a_taxel_has_no_level(taps):
    own = np.argwhere((taps.indices(taps.grid())[0] == 2) & (taps.what == 1)).ravel()
    for name, index, place in (("gaussian", np.s_[own, :, 1], ""), ("profile", np.s_[own, 3, 1], " at sample 3")):
        lacking = missing(taps, index)
        with pytest.raises(InputError, match=f"{name} .* of taxel 1{place} are missing for position 2 and object 1"):
            fit_model(name, lacking, taps.grid(), SETTINGS)


@pytest.mark.parametrize(
    "name",
    slow_but(
        ["histogram in states"],
        ("histogram", "profile", "histogram in states", "histogram integrated", "normal"),
    ),
)
def test_all_routes_agree_where_samples_are_missing(name, models, random_holes):
    check = crosscheck_model(models[name], random_holes, train=random_holes, episodes=2, length=4, sequence_taps=2)

    assert check.passed, check.rows
    assert not any("nan" in str(row) for row in check.rows)
