"""What a new session depends on: nothing that has a constant number of sessions."""

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from slow_cases import slow_but
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.generic import fit as fits
from solidtouch.models.measurement.generic.contract import StoryCall, StoryFunction
from solidtouch.models.measurement.generic.influence import check_sessions
from solidtouch.models.measurement.generic.structure import structure_of
from solidtouch.models.measurement.registry import fit_model, model_name
from solidtouch.models.settings import FitSettings

M, J, K, N = 2, 2, 1, 12


def moved_by(shift_of, mixed=False):
    """Levels of an object, moved in each session by `shift_of(session)`; if mixed, some taps more."""

    def story(where, what, taps=None, *, M, J, K, session):
        with numpyro.plate("M", M):
            loc = numpyro.sample("loc", dist.Normal(0.0, 3.0))
        level = (loc[what] + shift_of(session))[:, None, None]
        gap = normal("gap", 2) if mixed else None
        with numpyro.plate("tap", len(where), dim=-3):
            if mixed:
                level = level + gap[numpyro.sample("up", dist.Bernoulli(0.3))]
            with numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
                numpyro.sample("taps", dist.Normal(level, 0.01), obs=taps)

    return story


def normal(name, size=None):
    if size is None:
        return numpyro.sample(name, dist.Normal(0.0, 1.0))
    with numpyro.plate("S", size):
        return numpyro.sample(name, dist.Normal(0.0, 1.0))


def constant(session):
    return normal("shift", 4)[session]


def one_hot(session):
    return (session[:, None] == jnp.arange(6)) @ normal("shift", 6)


def walk(session):
    return jnp.cumsum(normal("step", 6))[session]


def later(session):
    return jnp.where(session > 2, normal("late"), normal("early"))


def first(session):
    return jnp.where(session > 0, normal("late"), normal("early"))


def alternate(session):
    return normal("shift", 2)[session % 2]


def slope(session):
    return normal("slope") * session


def shifts(session):
    return normal("shift", int(session.max()) + 1)[session]


def around(session):
    """Sessions around others, which no sample depends on directly."""
    means = normal("mean", int(session.max()) + 1)
    with numpyro.plate("S", len(means)):
        return numpyro.sample("shift", dist.Normal(means, 1.0))[session]


def unused(session):
    return 0.0 * session + 0.0 * len(normal("shift", int(session.max()) + 1))


def looked_at(shift_of, sessions, mixed=False):
    story = StoryFunction.of(moved_by(shift_of, mixed), "story")
    index = np.arange(N)
    batch = StoryCall(0 * index, index % M, (1, M, J, K), np.zeros(1), session=index // M % sessions)
    samples = np.random.default_rng(0).normal(size=(N, J, K))
    return check_sessions(fits.Fit(story, structure_of(story, batch, sessions), batch, samples, 0))


@pytest.mark.parametrize(
    ("shift_of", "name", "sessions"),
    slow_but(
        [(constant, "shift", 1), (walk, "step", 3)],
        [(constant, "shift", 3), (constant, "shift", 1), (one_hot, "shift", 3), (walk, "step", 3), (later, "late", 3)],
    ),
)
def test_elements_that_a_new_session_alone_takes_are_refused(shift_of, name, sessions):
    with pytest.raises(InputError, match=rf"{name!r} for a new session, {sessions}, .* not of a constant size\.$"):
        looked_at(shift_of, sessions)


@pytest.mark.parametrize("shift_of", slow_but([first, around], [first, alternate, slope, shifts, around]))
def test_what_training_sessions_share_with_a_new_one_is_allowed(shift_of):
    assert looked_at(shift_of, 3) == ""


def test_discrete_variables_are_summed_out():
    with pytest.raises(InputError, match="'shift' for a new session"):
        looked_at(constant, 3, mixed=True)


@pytest.mark.slow
def test_sessions_of_which_the_taps_tell_nothing_are_said():
    alone = "How a new session differs from the one that trained story ({}) is known from the prior alone; train with"
    assert looked_at(slope, 1).startswith(alone.format("slope"))
    assert looked_at(around, 1).startswith(alone.format("mean, shift"))
    assert looked_at(unused, 3) == "No sample depends on 'shift', a latent variable of sessions of story."


def test_a_constant_number_of_sessions_is_refused_before_the_fit(make_taps, monkeypatch):
    monkeypatch.setattr(fits, "check_prior", None)
    monkeypatch.setattr(fits, "posterior", None)
    taps = make_taps(1, M, J, K, sessions=3, repeats=2)

    with pytest.raises(InputError, match="'shift' for a new session, 3"):
        fit_model(model_name(moved_by(constant)), taps, taps.grid(), FitSettings(bins=9, method="map"))
