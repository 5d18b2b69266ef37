"""Functions that keep the contract of a generative model, and how others are refused."""

from functools import partial

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from own_stories import alike, correlated, counts, heavy, laplace, levels, shifted, two_levels, walk
from solidtouch.models.errors import InputError
from solidtouch.models.measurement import profile_mvn
from solidtouch.models.measurement.generic import source
from solidtouch.models.measurement.generic.contract import StoryCall, StoryFunction, measurement_model
from solidtouch.models.measurement.generic.story import batch_of
from solidtouch.models.measurement.generic.structure import check_names, structure_of
from solidtouch.models.measurement.registry import model_name

L, M, J, K = 3, 2, 5, 4


def call(**more):
    none = np.zeros(0, dtype=int)
    values = {"where_value": np.arange(3.0), "what_value": None, "time_s": None, **more}
    return StoryCall(none, none, (L, M, J, K), session=none, **values)


def structure(function, **more):
    return structure_of(StoryFunction.of(function, "story"), call(**more))


def test_sites_have_the_dims_of_their_plates():
    assert structure(laplace).dims == {"loc": ("where", "what", "taxel"), "scale": ("where", "what", "taxel")}
    assert structure(levels).dims == {"level": ("where", "what", "sample", "taxel")}
    assert structure(correlated).dims["root"] == ("root_dim_0", "root_dim_1")


@pytest.mark.parametrize(
    ("function", "expected"),
    [
        (laplace, (False, "bins", True)),
        (alike, (False, "bins", True)),
        (levels, (False, "bins", False)),
        (two_levels, (False, "bins", False)),
        (walk, (True, "bins", False)),
        (correlated, (False, "bins", False)),
        (heavy, (False, "density", False)),
    ],
)
def test_what_the_observed_site_is(function, expected):
    found = structure(function)

    assert (found.swapped, found.measure, found.exchangeable) == expected


def test_discrete_variables_of_samples_are_to_be_summed_out():
    found = structure(two_levels)

    assert found.enumerated == ("upper",)
    assert set(found.dims) == {"low", "gap", "scale", "share"}


def test_variables_of_sessions_are_known_by_their_axis():
    assert structure(shifted).by_session == {"shift": 0}
    assert structure(laplace).by_session == {}


def test_masked_samples_are_independent_without_a_table():
    """As the mask may differ from sample to sample."""

    def masked(where, what, taps=None, *, L, M, J, K):
        scale = numpyro.sample("scale", dist.LogNormal(0.0, 1.0))
        with numpyro.handlers.mask(mask=jnp.arange(J)[:, None] > 0):
            numpyro.sample("taps", dist.Normal(0.0, scale).expand([len(where), J, K]), obs=taps)

    found = structure(masked)

    assert (found.measure, found.exchangeable, found.independent) == ("bins", False, True)


def test_a_censored_sample_has_no_bin_of_a_table():
    def saturated(where, what, taps=None, *, J, K):
        loc = numpyro.sample("loc", dist.Normal(0.0, 1.0))
        with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
            numpyro.sample("taps", dist.RightCensoredDistribution(dist.Normal(loc, 1.0), jnp.arange(K) == 0), obs=taps)

    found = structure(saturated)
    assert not found.exchangeable
    assert found.measure == "bins"


def test_a_forecast_from_samples_before_is_not_exchangeable():
    def looks_back(where, what, taps=None, *, L, M, J, K):
        scale = numpyro.sample("scale", dist.LogNormal(0.0, 1.0))
        mean = 0.0 if taps is None else jnp.asarray(taps).mean(axis=(1, 2), keepdims=True)
        with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
            numpyro.sample("taps", dist.Normal(mean, scale), obs=taps)

    assert not structure(looks_back).exchangeable


def test_a_forecast_may_hide_in_a_product():
    """Wherever its latent variables are, even where their product with the samples is 0."""

    def hidden(where, what, taps=None, *, L, M, J, K):
        slope = numpyro.sample("slope", dist.Normal(0.0, 1.0))
        mean = 0.0 if taps is None else slope * jnp.where(taps > 0, 1.0, 0.0)[:, :1, :1]
        with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
            numpyro.sample("taps", dist.Normal(mean, 1.0), obs=taps)

    assert not structure(hidden).exchangeable


def test_nothing_is_drawn_to_find_the_sites():
    """A draw of each latent variable would be compiled at its full size."""

    class NeverDrawn(dist.Normal):
        def sample(self, *_, **__):
            raise AssertionError("drawn")

    def story(where, what, taps=None, *, L, M, J, K):
        with numpyro.plate("L", L, dim=-3), numpyro.plate("M", M, dim=-2), numpyro.plate("K", K, dim=-1):
            loc = numpyro.sample("loc", NeverDrawn(0.0, 1.0))
        with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("taxel", K, dim=-1):
            numpyro.sample("taps", dist.Laplace(loc[where, what][:, None], 1.0), obs=taps)

    assert structure(story).dims == {"loc": ("where", "what", "taxel")}


def test_arguments_that_are_named_are_filled_in():
    seen = {}

    def curious(where, what, taps=None, *, L, K, J, where_value, what_value, time_s, session, width=2.0):
        seen.update(where_value=where_value, what_value=what_value, time_s=time_s, width=width, session=session)
        loc = numpyro.sample("loc", dist.Normal(0.0, 1.0))
        with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
            numpyro.sample("taps", dist.Normal(loc, width), obs=taps)

    structure(curious, what_value=np.array([2.0, 4.0]), time_s=np.arange(J) / 50)

    np.testing.assert_array_equal(seen["what_value"], [2.0, 4.0])
    np.testing.assert_array_equal(seen["where_value"], np.arange(3.0))
    assert (len(seen["time_s"]), seen["width"]) == (J, 2.0)


def test_values_of_positions_are_taken_by_class(make_taps):
    """Also where classes are traced, to judge taps under all of them; NumPy may compute with the values."""

    def sloped(where, what, taps=None, *, J, K, where_value):
        slope = numpyro.sample("slope", dist.Normal(0.0, np.ptp(where_value)))
        with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
            numpyro.sample("taps", dist.Normal(slope * where_value[where][:, None, None], 1.0), obs=taps)

    taps = make_taps(J=J, K=K)
    assert structure_of(StoryFunction.of(sloped, "s"), batch_of(taps.grid(), taps.preprocessing, K)).measure == "bins"


@pytest.mark.parametrize(
    ("name", "missing"), [("what_value", "the objects have no sizes"), ("time_s", "sampling rate is unknown")]
)
def test_values_that_the_taps_lack_are_refused(name, missing):
    with pytest.raises(InputError, match=missing):
        call().arguments((name,))


def test_a_decorated_function_says_what_it_takes():
    @measurement_model(raw=True)
    def marked(where, what, taps=None): ...

    @measurement_model
    def plain(where, what, taps=None): ...

    assert StoryFunction.of(marked, "marked").raw
    assert not StoryFunction.of(plain, "plain").raw
    assert not StoryFunction.of(laplace, "laplace").raw


def taps_only(shape, obs=lambda taps: taps, site="taps"):
    """A story with one observed site."""

    def story(where, what, taps=None, *, J, K):
        sizes = {"N": len(where), "J": J, "K": K, "1": 1}
        dims = [sizes[axis] for axis in shape]
        numpyro.sample(site, dist.Normal(0.0, 1.0).expand(dims), obs=None if taps is None else obs(taps))

    return story


def local(distribution):
    def story(where, what, taps=None, *, J, K):
        with numpyro.plate("tap", len(where), dim=-3):
            own = numpyro.sample("own", distribution)
            with numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
                numpyro.sample("taps", dist.Normal(own, 1.0), obs=taps)

    return story


def shared(distribution):
    def story(where, what, taps=None, *, J, K):
        own = numpyro.sample("own", distribution)
        with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
            numpyro.sample("taps", dist.Normal(own, 1.0), obs=taps)

    return story


def fails(where, what, taps=None):
    raise KeyError("a key")


def leaves(where, what, taps=None):
    raise SystemExit(5)


def knows_taps(where, what, taps=None, *, J, K):
    own = numpyro.sample("own", dist.Normal(0.0, 1.0))
    numpyro.sample("taps", dist.Normal(own, 1.0).expand(taps.shape), obs=taps)


def draws_nothing(where, what, taps=None, *, J, K):
    own = numpyro.sample("own", dist.Normal(0.0, 1.0))
    if taps is not None:
        numpyro.sample("taps", dist.Normal(own, 1.0).expand([len(where), J, K]), obs=taps)


def lacks_a_part(where, what, taps=None):
    raise NotImplementedError("a part")


def with_more_than_taps(of):
    """A story with one more site."""

    def made(_, own):
        of(own)
        return own

    return centred(made)


def centred(of):
    """A story whose samples have the mean `of(where, own)`."""

    def story(where, what, taps=None, *, J, K):
        own = numpyro.sample("own", dist.Normal(0.0, 1.0))
        with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
            numpyro.sample("taps", dist.Normal(of(where, own), 1.0), obs=taps)

    return story


flat = dist.ImproperUniform(dist.constraints.real, (), ())


@pytest.mark.parametrize(
    ("story", "message"),
    [
        (taps_only("NJK", site="samples"), "site 'taps' with obs=taps; its sites: samples"),
        (taps_only("NJK", obs=lambda _: None), "its site 'taps' is not observed"),
        (taps_only("N1K", obs=lambda taps: taps[:, :1]), r"has shape \(2, 1, 4\) for 2 taps, expected \(2, 5, 4\)"),
        (taps_only("NJK"), "has no latent variable to fit"),
        (taps_only("NJK", obs=lambda taps: taps**2), "must observe taps themselves"),
        (local(dist.Normal(0.0, 1.0)), "'own' of story has a value for every tap"),
        (local(dist.Poisson(2.0)), "'own' of story cannot be enumerated"),
        (shared(dist.Bernoulli(0.5)), "'own' of story is shared by several taps; put a continuous one"),
        (shared(flat), "'own' of story has no proper prior"),
        (shared(flat.expand([K]).to_event(1).mask(False)), "'own' of story has no proper prior"),
        (with_more_than_taps(lambda own: numpyro.factor("more", own)), "a second observed site 'more'"),
        (with_more_than_taps(lambda own: numpyro.sample("x", dist.Normal(own), obs=1.0)), "a second observed site 'x'"),
        (with_more_than_taps(lambda _: numpyro.param("free", 1.0)), "a parameter 'free' without a prior"),
        (lacks_a_part, r"failed when it was tried on 2 taps, line \d+ of its file: NotImplementedError: a part"),
        (fails, r"failed when it was tried on 2 taps, line \d+ of its file: KeyError: 'a key'"),
        (leaves, r"failed when it was tried on 2 taps, line \d+ of its file: SystemExit: 5"),
        (knows_taps, r"failed when it was tried with taps=None, to draw 2, line \d+ of its file: AttributeError"),
        (draws_nothing, r"with taps=None must draw taps of shape \(2, 5, 4\)"),
        (centred(lambda _, own: np.exp(own)), "of its file: NumPy cannot compute with values that JAX traces"),
        (centred(lambda where, _: np.arange(L)[where][:, None, None]), "use jax.numpy, also for arrays to index"),
        (centred(lambda where, _: jnp.zeros(L - 1)[where][:, None, None]), r"line \d+ .*: index 2 is out of bounds"),
        (centred(lambda where, _: jnp.zeros((L, K))[where]), r"need an axis for samples, as in loc\[where, what\]"),
        (centred(lambda _, own: 0.0 if own > 0 else 1.0), "a condition, size or number depends on values that JAX"),
        (centred(lambda where, own: (own + where)[where > 0]), "use jnp.where or the like"),
    ],
)
def test_a_function_that_cannot_be_a_model_is_refused(story, message):
    with pytest.raises(InputError, match=message):
        structure(story)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("cell/loc", r"'cell/loc' of story has a / in its name.*scope divider=.\..\.$"),
        ("where", "'where' of story needs another name"),
        ("taxel", "'taxel' of story needs another name"),
        ("time", "'time' of story needs another name"),
        ("chain", "'chain' of story needs another name"),
        ("", "A latent variable of story has no name"),
    ],
)
def test_names_that_files_cannot_hold_are_refused(name, message):
    story = StoryFunction.of(levels, "story")
    found = structure_of(story, call())
    check_names(story, found)

    with pytest.raises(InputError, match=message):
        check_names(story, found._replace(dims={name: (), **found.dims}))


def without_what(where, taps=None): ...


async def asynchronous(where, what, taps=None): ...


def without_default(where, what, taps): ...


def with_more(where, what, taps=None, *, width): ...


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (without_what, "must begin with the arguments where, what, taps=None"),
        (without_default, "must begin with the arguments where, what, taps=None"),
        (asynchronous, "story is an async function"),
        (with_more, "an argument 'width' that nothing fills in"),
        (3, "is no function but of type int"),
    ],
)
def test_other_arguments_are_refused(function, message):
    with pytest.raises(InputError, match=message):
        StoryFunction.of(function, "story")


def test_arguments_of_its_own_are_given_by_partial():
    """The function keeps its sentence and marks; other arguments, also within long arrays, make another digest."""
    typical = np.zeros(2000)
    other = np.where(np.arange(2000) == 1000, 1e-9, 0.0)
    story = StoryFunction.of(profile_mvn.story, "mvn")
    given, same, changed = (
        StoryFunction.of(partial(profile_mvn.story, typical=values), "mvn")
        for values in (typical, typical.copy(), other)
    )

    assert given.sentence == story.sentence
    assert given.wanted == story.wanted
    assert source.digest(given) == source.digest(same)
    assert len({source.digest(one) for one in (story, given, changed)}) == 3
    assert StoryFunction.of(partial(counts), "counts").raw


def test_a_partial_function_needs_a_name():
    with pytest.raises(InputError, match=r"A partial without a name cannot be a model; register .*st\.register"):
        model_name(partial(len))
