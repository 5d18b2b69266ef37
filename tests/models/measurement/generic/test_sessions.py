"""Sessions of users' models: the session at perception is one past those of the training taps."""

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from numpyro.contrib.control_flow import scan
from scipy import stats
from solidtouch.models.errors import InputError
from solidtouch.models.io.model_file import load_model
from solidtouch.models.measurement.generic import fit as fits
from solidtouch.models.measurement.generic.contract import StoryCall, StoryFunction
from solidtouch.models.measurement.generic.story import at_prior
from solidtouch.models.measurement.generic.structure import structure_of
from solidtouch.models.measurement.registry import fit_model, model_name
from solidtouch.models.settings import FitSettings

L, M, J, K, S = 2, 2, 2, 2, 3


def moved_by(shift_of):
    """Levels of an object, moved in each session by `shift_of(S)`, shape (S,)."""

    def story(where, what, taps=None, *, M, J, K, session):
        with numpyro.plate("M", M):
            loc = numpyro.sample("loc", dist.Normal(0.0, 3.0))
        level = loc[what] + shift_of(int(session.max()) + 1)[session]
        with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
            numpyro.sample("taps", dist.Normal(level[:, None, None], 1.0), obs=taps)

    return story


def trend(size):
    """The session as a covariate."""
    return numpyro.sample("slope", dist.Normal(0.0, 1.0)) * jnp.arange(size)


def walk(size):
    """A walk of which the last step is known."""
    with numpyro.plate("S", size):
        return jnp.cumsum(numpyro.sample("step", dist.Normal(0.5, 1e-12)))


LATENTS = {
    trend: {"loc": np.array([-0.3, 0.6]), "slope": np.array(0.25)},
    walk: {"loc": np.array([-0.3, 0.6]), "step": np.array([0.1, -0.2, 0.3])},
}
SHIFT = {trend: 0.25 * S, walk: 0.1 - 0.2 + 0.3 + 0.5}


@pytest.fixture
def fitted(make_taps, monkeypatch):
    """Taps of sessions 2, 5 and 9, and a model of them whose latent variables are set and not fitted."""
    taps = make_taps(L, M, J, K, repeats=6)
    taps = taps.__class__(taps.dataset.assign_coords(session=("tap", np.array([2, 5, 9])[np.arange(len(taps)) % S])))

    def fit(shift_of):
        found = fits.GuidePosterior(LATENTS[shift_of], lambda _: {}, fits.Convergence(True, "Set by hand.", {}))
        monkeypatch.setattr(fits, "posterior", lambda *_: found)
        monkeypatch.setattr(fits, "check_prior", lambda _: "")
        story = moved_by(shift_of)
        settings = FitSettings(bins=9, power="none", method="map")
        return taps, fit_model(model_name(story), taps, taps.grid(), settings).model, story

    return fit


@pytest.mark.parametrize("shift_of", [trend, walk])
def test_a_tap_is_judged_in_the_session_after_those_of_training(shift_of, fitted, tmp_path):
    """Numbered from 0 in their order, also after a file; dependent sessions are drawn given those before."""
    taps, model, story = fitted(shift_of)
    edges = np.concatenate([[-np.inf], model.edges[1:-1], [np.inf]])
    bins = model.bins(taps.taps)
    lower, upper = ((edges[b] - model.scaling.centre) / model.scaling.unit for b in (bins, bins + 1))
    level = (model.parameters["loc"] + SHIFT[shift_of])[:, None, None, None]
    likely = np.log(stats.norm.cdf(upper - level) - stats.norm.cdf(lower - level)).sum(axis=(2, 3))
    model.save(tmp_path / "model.nc")

    for one in (model, load_model(tmp_path / "model.nc", story=story)):
        found = one.log_likelihood(taps.taps)
        np.testing.assert_allclose(found, np.repeat(likely.T[:, None], L, axis=1), rtol=1e-6)


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


def test_sessions_drawn_from_a_prior_follow_each_other():
    """Each is given those before it, and has their number as index."""

    def drawn(sessions):
        own = [np.random.default_rng(1 + number) for number in range(sessions)]
        return at_prior(StoryFunction.of(moved_by(walk), "story"), BATCH, np.random.default_rng(0), own)

    two, three = drawn(2), drawn(3)
    assert (two.program.sessions, three.program.sessions) == (1, 2)
    np.testing.assert_array_equal(three.given.latents["step"][:2], two.given.latents["step"])
    assert three.given.latents["step"].shape == (3,)


def test_a_file_that_does_not_know_its_sessions_is_refused(fitted, tmp_path, monkeypatch):
    _, model, story = fitted(trend)
    monkeypatch.setattr(type(model), "groups", _without_sessions(type(model).groups))
    model.save(tmp_path / "model.nc")

    with pytest.raises(InputError, match="does not say how many sessions trained it; fit again"):
        load_model(tmp_path / "model.nc", story=story)


def _without_sessions(groups):
    def made(model):
        found = groups(model)
        root = found["/"].copy()
        root.attrs = {name: value for name, value in root.attrs.items() if name != "sessions"}
        return found | {"/": root}

    return made
