"""Sessions of users' models: the session at perception is one past those of the training taps."""

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from numpyro.contrib.control_flow import scan
from scipy import stats
from slow_cases import slow_but
from solidtouch.inference.engines.enumeration import log_likelihoods as enumerated
from solidtouch.models.errors import InputError
from solidtouch.models.io.model_file import load_model
from solidtouch.models.measurement.draws import drawn, replicated_bins
from solidtouch.models.measurement.generic import fit as fits
from solidtouch.models.measurement.generic import influence, sessions
from solidtouch.models.measurement.generic.contract import StoryCall, StoryFunction
from solidtouch.models.measurement.generic.runs import Program
from solidtouch.models.measurement.generic.session_draws import some_episodes
from solidtouch.models.measurement.generic.story import at_prior
from solidtouch.models.measurement.generic.structure import structure_of
from solidtouch.models.measurement.likelihood.bins import find_bins
from solidtouch.models.measurement.likelihood.story_likelihood import log_likelihoods as by_story
from solidtouch.models.measurement.likelihood.true_class import OwnTaps
from solidtouch.models.measurement.model import in_states
from solidtouch.models.measurement.registry import check_states, fit_model, model_name
from solidtouch.models.measurement.states import States
from solidtouch.models.settings import FitSettings

L, M, J, K, S = 2, 2, 2, 2, 3


def moved_by(shift_of, samples="exchangeable"):
    """Levels of an object, moved in each session by `shift_of(S)`, shape (S,).

    Samples also rise with time, or the whole tap is moved by +2 or -2.
    """

    def story(where, what, taps=None, *, M, J, K, session):
        with numpyro.plate("M", M):
            loc = numpyro.sample("loc", dist.Normal(0.0, 3.0))
        level = (loc[what] + shift_of(int(session.max()) + 1)[session])[:, None, None]
        if samples == "rising":
            level = level + 0.5 * jnp.arange(J)[:, None]
        with numpyro.plate("tap", len(where), dim=-3):
            if samples == "either":
                level = level + 4.0 * numpyro.sample("up", dist.Bernoulli(0.3)) - 2.0
            with numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
                numpyro.sample("taps", dist.Normal(level, 1.0), obs=taps)

    return story


def trend(size):
    """The session as a covariate."""
    return numpyro.sample("slope", dist.Normal(0.0, 1.0)) * jnp.arange(size)


def walk(size):
    """A walk of which the last step is known."""
    with numpyro.plate("S", size):
        return jnp.cumsum(numpyro.sample("step", dist.Normal(0.5, 1e-12)))


def shifts(size):
    with numpyro.plate("S", size):
        return numpyro.sample("shift", dist.Normal(0.0, 2.0))


LATENTS = {
    trend: {"loc": np.array([-0.3, 0.6]), "slope": np.array(0.25)},
    walk: {"loc": np.array([-0.3, 0.6]), "step": np.array([0.1, -0.2, 0.3])},
    shifts: {"loc": np.array([-0.3, 0.6]), "shift": np.array([1.0, -0.5, 0.3])},
}
SHIFT = {trend: [0.0, 0.25, 0.5, 0.75], walk: [0.1, -0.1, 0.2, 0.7], shifts: [1.0, -0.5, 0.3]}


@pytest.fixture
def fitted(make_taps, monkeypatch):
    """Taps of sessions 2, 5 and 9, and a model of them whose latent variables are set and not fitted."""
    taps = make_taps(L, M, J, K, repeats=6)
    taps = taps.__class__(taps.dataset.assign_coords(session=("tap", np.array([2, 5, 9])[np.arange(len(taps)) % S])))

    def fit(shift_of, samples="exchangeable"):
        latents = LATENTS[shift_of]
        found = fits.GuidePosterior(latents, lambda _: latents, fits.Convergence(True, "Set by hand.", {}))
        monkeypatch.setattr(fits, "posterior", lambda *_: found)
        monkeypatch.setattr(fits, "check_prior", lambda _: "")
        monkeypatch.setattr(influence, "check_sessions", lambda _: "")
        story = moved_by(shift_of, samples)
        settings = FitSettings(bins=9, power="none", method="map")
        return taps, fit_model(model_name(story), taps, taps.grid(), settings), story

    return fit


def log_probability(model, taps, level, samples="exchangeable"):
    """Log probability of the bins of taps (N, J, K) around levels that broadcast over (..., N, J, K)."""
    edges = np.concatenate([[-np.inf], model.edges[1:-1], [np.inf]])
    bins = find_bins(taps, model.edges)
    lower, upper = ((edges[b] - model.scaling.centre) / model.scaling.unit for b in (bins, bins + 1))
    if samples == "rising":
        level = level + 0.5 * np.arange(J)[:, None]

    def at(level):
        with np.errstate(divide="ignore"):  # far away
            return np.log(stats.norm.cdf(upper - level) - stats.norm.cdf(lower - level)).sum(axis=(-2, -1))

    if samples == "either":
        return np.logaddexp(np.log(0.3) + at(level + 2.0), np.log(0.7) + at(level - 2.0))
    return at(level)


@pytest.mark.parametrize("shift_of", [trend, walk])
def test_a_tap_is_judged_in_the_session_after_those_of_training(shift_of, fitted, tmp_path):
    """Numbered from 0 in their order, also after a file; dependent sessions are drawn given those before."""
    taps, (model, *_), story = fitted(shift_of)
    level = (model.parameters["loc"] + SHIFT[shift_of][S])[:, None, None, None]
    likely = log_probability(model, taps.taps, level)
    model.save(tmp_path / "model.nc")

    for one in (model, load_model(tmp_path / "model.nc", story=story)):
        states = one.log_likelihood(taps.taps).reshape(len(taps), L, -1, M)
        np.testing.assert_allclose(states, np.broadcast_to(likely.T[:, None, None], states.shape), rtol=1e-6)


@pytest.mark.parametrize(
    ("shift_of", "samples"),
    [
        (trend, "exchangeable"),
        pytest.param(walk, "rising", marks=pytest.mark.slow),
        pytest.param(trend, "either", marks=pytest.mark.slow),
        pytest.param(walk, "exchangeable", marks=pytest.mark.slow),
        pytest.param(trend, "rising", marks=pytest.mark.slow),
        pytest.param(walk, "either", marks=pytest.mark.slow),
    ],
)
def test_training_taps_are_judged_and_replicated_in_their_own_session(shift_of, samples, fitted):
    taps, fit, _ = fitted(shift_of, samples)
    shift, session = np.array(SHIFT[shift_of]), np.searchsorted([2, 5, 9], taps.session)
    level = fit.model.parameters["loc"][taps.what] + shift[session]
    some = taps.select(np.arange(0, len(taps), 5))

    _, found = next(drawn(fit, taps, 1, 0))
    np.testing.assert_allclose(found, log_probability(fit.model, taps.taps, level[:, None, None], samples), rtol=1e-6)
    _, of_some = next(drawn(fit, some, 1, 0))
    np.testing.assert_allclose(of_some, found[::5], rtol=1e-6)

    rng, (parameters, _) = np.random.default_rng(1), next(drawn(fit, some, 1, 0))
    many = np.array([replicated_bins(parameters, fit.model, some, rng) for _ in range(400)], dtype=float)
    edges = np.concatenate([[-np.inf], fit.model.edges[1:-1], [np.inf]])
    inner = (edges[1:-1] - fit.model.scaling.centre[:, None]) / fit.model.scaling.unit[:, None]
    rise = 0.5 * np.arange(J)[:, None] if samples == "rising" else np.zeros((J, 1))
    moves = [(0.3, 2.0), (0.7, -2.0)] if samples == "either" else [(1.0, 0.0)]
    mean = level[::5, None, None] + rise
    expected = sum(p * stats.norm.sf(inner - (mean + move)[..., None]).sum(axis=-1) for p, move in moves)
    assert np.abs(many.mean(axis=0) - expected).max() < 5 * many.std() / np.sqrt(len(many))


def test_training_sessions_are_kept_beside_gains(fitted):
    """Of a session as a covariate, in `session:`."""
    taps, fit, _ = fitted(trend, "rising")
    own, edges, plain = taps.indices(fit.model.grid), fit.model.edges, fit.model.training_form()
    states = States(np.array([1.0, 2.0]), np.array([0.0, 3.0]), np.log([0.5, 0.5]))
    form = in_states(plain, states, edges)
    hypothesis = np.arange(len(taps)) % S * M + own[1]

    alike = [one.own(taps.taps, edges, own[0], hypothesis) for one in (form, plain)]
    np.testing.assert_allclose(*alike)
    moved = plain.own((taps.taps - 3.0) / 2.0, (edges - 3.0) / 2.0, own[0], hypothesis)
    np.testing.assert_allclose(form.own(taps.taps, edges, own[0], hypothesis + S * M), moved)
    cases = (plain, 0), (form, S * M)
    made = [one.sample(own[0], hypothesis + more, edges, J, np.random.default_rng(0)) for one, more in cases]
    np.testing.assert_allclose(made[1], 2.0 * made[0] + 3.0)


def test_a_tap_of_a_session_that_trained_nothing_has_no_session_of_its_own(fitted):
    taps, fit, _ = fitted(walk)
    other = taps.__class__(taps.dataset.assign_coords(session=("tap", np.full(len(taps), 7))))

    with pytest.raises(InputError, match="No tap of session 7 trained story, which tells sessions apart"):
        next(drawn(fit, other, 1, 0))


@pytest.mark.parametrize("samples", slow_but(["exchangeable"], ("exchangeable", "rising")))
def test_taps_of_an_episode_share_a_session(samples, fitted):
    """The belief after several taps is nearly that of exact integration over what moves all of them."""
    taps, fit, _ = fitted(shifts, samples)
    model, episode = fit.model, taps.taps[taps.where == 0][:5]
    found = model.log_likelihood(episode)[:, 0].sum(axis=0).reshape(-1, M)
    found = np.logaddexp.reduce(found + model.states.log_prior[:, None], axis=0)

    shift = np.linspace(-10, 10, 4001)
    level = (model.parameters["loc"][:, None] + shift)[..., None, None, None]
    each = log_probability(model, episode, level, samples).sum(axis=-1)
    exact = np.logaddexp.reduce(each + stats.norm.logpdf(shift, 0, 2), axis=-1) + np.log(shift[1] - shift[0])
    np.testing.assert_allclose(found - found[0], exact - exact[0], atol=0.05)
    np.testing.assert_allclose(found, exact, atol=0.1)
    assert abs(exact[1] - exact[0]) > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("samples", ["exchangeable", "rising"])
def test_the_models_of_numpyro_have_the_same_sessions(samples, fitted):
    taps, fit, _ = fitted(shifts, samples)
    with jax.enable_x64(True):
        found = enumerated(fit.model, taps.taps[:2])

    np.testing.assert_allclose(found, fit.model.log_likelihood(taps.taps[:2]), rtol=1e-9)
    np.testing.assert_allclose(found, by_story(fit.model, taps.taps[:2]), rtol=1e-9)


def check_spread(draws, log_prior):
    """One in each part of a beta distribution of the quantiles of a shift; weights make it uniform again."""
    point = stats.beta(3, 3).ppf(stats.norm.cdf([one["shift"][-1] for one in draws], 0, 2))
    D = len(draws)
    np.testing.assert_array_equal(np.sort((point * D).astype(int)), np.arange(D))
    weight = stats.beta(3, 3).pdf(point)
    np.testing.assert_allclose(np.exp(log_prior), weight / weight.sum(), rtol=1e-6)
    assert weight.sum() == pytest.approx(D, rel=2 / D)


def test_what_a_new_session_is_drawn_from_is_filled_evenly(fitted):
    model = fitted(shifts)[1].model
    check_spread(model.decides_at, model.states.log_prior)
    assert all((one["shift"][:-1] == model.parameters["shift"]).all() for one in model.decides_at)


def test_priors_without_quantiles_are_drawn_from(fitted, monkeypatch):
    monkeypatch.setattr(sessions, "at_quantiles", lambda *_: None)
    model = fitted(shifts)[1].model
    quantiles = stats.norm.cdf([one["shift"][-1] for one in model.decides_at], 0, 2)

    assert stats.kstest(quantiles, "uniform").pvalue > 0.01
    assert len(set((quantiles * len(quantiles)).astype(int))) < len(quantiles)


@pytest.mark.parametrize("sd", [0.0, 2.7, 4.0])
def test_an_episode_in_a_session_far_out_has_the_exact_belief(sd, fitted):
    """So many standard deviations from the middle of the prior of shifts, in the log evidence of ten taps."""
    taps, fit, _ = fitted(shifts)
    model, rng = fit.model, np.random.default_rng(3)
    episode = rng.normal(model.parameters["loc"][0] + 2 * sd, 1.0, size=(10, *taps.taps.shape[1:]))
    episode = np.clip(episode, model.edges.min(), model.edges.max())
    found = model.log_likelihood(episode)[:, 0].sum(axis=0).reshape(-1, M)
    found = np.logaddexp.reduce(found + model.states.log_prior[:, None], axis=0)
    shift = np.linspace(-15, 15, 12001)
    level = (model.parameters["loc"][:, None] + shift)[..., None, None, None]
    each = log_probability(model, episode, level).sum(axis=-1)
    exact = np.logaddexp.reduce(each + stats.norm.logpdf(shift, 0, 2), axis=-1) + np.log(shift[1] - shift[0])
    np.testing.assert_allclose(found, exact, atol=0.3)


def test_the_error_of_the_draws_of_new_sessions_is_known(fitted):
    """Not much less, on episodes whose exact log evidence is known; half of the draws are far less exact."""
    taps, fit, _ = fitted(shifts)
    model, own = fit.model, taps.indices(fit.model.grid)
    session = np.searchsorted([2, 5, 9], taps.session)
    episodes = some_episodes(session, np.random.default_rng(0))
    shift = np.linspace(-6, 6, 2401)
    level = model.parameters["loc"][own[1]][:, None, None] + shift[:, None, None, None]
    each = log_probability(model, taps.taps, level)
    prior = stats.norm.logpdf(shift, 0, 2) + np.log(shift[1] - shift[0])
    exact = [np.logaddexp.reduce(each[:, rows].sum(axis=1) + prior) for rows in episodes]
    known = OwnTaps(taps.taps, own, model.edges, model.states)
    parts = np.stack([known.log_probability(model.form_of(one)) for one in model.decides_at])
    found = [np.logaddexp.reduce(parts[:, rows].sum(axis=1) + model.states.log_prior) for rows in episodes]
    error = np.abs(np.subtract(found, exact)).mean()

    assert all(len(rows) == 10 and len(set(session[rows])) == 1 for rows in episodes)
    assert error / 3 < model.integration_error(taps.taps, own, episodes) < 10 * error
    assert error > 1e-3


def test_integrated_fits_spread_new_sessions_evenly(fitted):
    model = fitted(shifts)[1].integrated(32, 1).model
    check_spread(model.draws, model.states.log_prior)


def test_a_session_has_no_gain_beside_what_it_has_already(make_taps, monkeypatch):
    """Which is known before the fit; the session as a covariate is no such thing."""
    monkeypatch.setattr(fits, "check_prior", None)  # by which a fit begins
    monkeypatch.setattr(fits, "posterior", None)
    taps = make_taps(L, M, J, K, repeats=2)

    with pytest.raises(InputError, match=r"story has latent variables of sessions \(shift\), which take the place of"):
        fit_model(f"session:{model_name(moved_by(shifts))}", taps, taps.grid(), FitSettings(bins=9, method="map"))
    assert check_states(f"session:{model_name(moved_by(trend))}", taps, taps.grid())


def test_bounded_samples_are_not_moved(make_taps):
    """Counts would become fractions, and positive samples negative."""

    def counts(where, what, taps=None, *, M, J, K):
        with numpyro.plate("M", M, dim=-2), numpyro.plate("K", K, dim=-1):
            rate = numpyro.sample("rate", dist.Gamma(2.0, 1.0))
        with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("taxel", K, dim=-1):
            numpyro.sample("taps", dist.Poisson(rate[what][:, None]), obs=taps)

    taps = make_taps(L, M, J, K, repeats=2)

    assert not check_states(f"session:{model_name(counts)}", taps, taps.grid())


def fixed(_):
    with numpyro.plate("S", S):
        return numpyro.sample("shift", dist.Normal(0.0, 1.0))


def too_few(size):
    with numpyro.plate("S", max(size - 1, 1)):
        return jnp.append(numpyro.sample("shift", dist.Normal(0.0, 1.0)), 0.0)


def together(size):
    return numpyro.sample("shift", dist.GaussianRandomWalk(1.0, size))


def scanned(size):
    def step(before, _):
        now = numpyro.sample("shift", dist.Normal(before, 1.0))
        return now, now

    return scan(step, 0.0, None, length=size)[1]


def one_by_one(size):
    return jnp.stack([numpyro.sample(f"shift{s}", dist.Normal(0.0, 1.0)) for s in range(size)])


def discrete(size):
    with numpyro.plate("S", size):
        return numpyro.sample("shift", dist.Bernoulli(0.5))


def independent(size):
    return numpyro.sample("shift", dist.Normal(jnp.zeros(size), 1.0).to_event(1))


BATCH = StoryCall(*np.zeros((2, 0), dtype=int), (L, M, J, K), np.arange(L), session=np.zeros(0, dtype=int))


def structure(shift_of):
    return structure_of(StoryFunction.of(moved_by(shift_of), "story"), BATCH, S)


@pytest.mark.parametrize(
    ("shift_of", "message"),
    [
        (fixed, r"index 3 is out of bounds.* The last session, 3, is a new one.*int\(session\.max\(\)\) \+ 1"),
        (too_few, "'shift' of story has sessions that no new one can be added to"),
        (together, r"'shift' of story has sessions .*in a plate of size int\(session\.max\(\)\) \+ 1.*jnp\.cumsum"),
        (scanned, "'shift' of story has sessions that no new one can be added to"),
        (discrete, r"'shift' of story is shared by several taps; put a continuous one .* whose prior is a mixture"),
        (one_by_one, "'shift1' of story has sessions that no new one can be added to"),
    ],
)
def test_sessions_to_which_no_new_one_can_be_added_are_refused(shift_of, message):
    with pytest.raises(InputError, match=message):
        structure(shift_of)


def test_what_belongs_to_sessions_is_found():
    assert structure(independent).by_session == {"shift": 0}
    assert structure(walk).by_session == {"step": 0}
    assert structure(trend).by_session == {}


def test_a_new_session_is_drawn_beside_a_scan():
    """Whose latent variable has a value for each time."""

    def story(where, what, taps=None, *, J, K, session):
        shift = shifts(int(session.max()) + 1)[session][:, None, None]
        _, walk = scan(lambda at, _: (numpyro.sample("step", dist.Normal(at, 1.0)),) * 2, 0.0, None, length=J)
        with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
            numpyro.sample("taps", dist.Normal(shift + walk[:, None], 1.0), obs=taps)

    function = StoryFunction.of(story, "story")
    program = Program(function, structure_of(function, BATCH, S), BATCH, S)
    known = {"shift": np.arange(3.0), "step": np.array([0.5, -0.5])}
    new = sessions.with_new_session(program, known, np.random.default_rng(0), {"shift": np.array([0.975])})
    np.testing.assert_allclose(new["shift"], [0, 1, 2, 2 * stats.norm.ppf(0.975)], rtol=1e-6)
    np.testing.assert_array_equal(new["step"], known["step"])


@pytest.mark.slow
def test_sessions_drawn_from_a_prior_follow_each_other():
    """Each is given those before it, and has their number as index."""

    def at(sessions):
        own = [np.random.default_rng(1 + number) for number in range(sessions)]
        return at_prior(StoryFunction.of(moved_by(walk), "story"), BATCH, np.random.default_rng(0), own)

    two, three = at(2), at(3)
    assert (two.program.sessions, three.program.sessions) == (1, 2)
    np.testing.assert_array_equal(three.given[0].latents["step"][:2], two.given[0].latents["step"])
    assert three.given[0].latents["step"].shape == (3,)


def test_a_file_that_does_not_know_its_sessions_is_refused(fitted, tmp_path, monkeypatch):
    _, (model, *_), story = fitted(trend)
    monkeypatch.setattr(type(model), "groups", _without_sessions(type(model).groups))
    model.save(tmp_path / "model.nc")

    with pytest.raises(InputError, match="does not say which sessions trained it; fit again"):
        load_model(tmp_path / "model.nc", story=story)


def _without_sessions(groups):
    def made(model):
        found = groups(model)
        root = found["/"].copy()
        root.attrs = {name: value for name, value in root.attrs.items() if name != "training_sessions"}
        return found | {"/": root}

    return made
