"""Models from functions of users: likelihoods, fits, files, decisions."""

import re
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from own_stories import alike, correlated, counts, heavy, laplace, levels, normal, shifted, two_levels, walk
from scipy import stats
from scipy.special import logsumexp
from slow_cases import slow_but
from solidtouch.inference.engines.engine import make_engine
from solidtouch.models.errors import InputError, NotConvergedError
from solidtouch.models.io.model_file import load_model
from solidtouch.models.measurement import registry
from solidtouch.models.measurement.generic import fit as fits
from solidtouch.models.measurement.generic import form, sessions, source
from solidtouch.models.measurement.generic.contract import StoryCall, StoryFunction, measurement_model
from solidtouch.models.measurement.generic.form import GenericForm
from solidtouch.models.measurement.generic.structure import structure_of
from solidtouch.models.measurement.likelihood.bins import TableForm
from solidtouch.models.measurement.likelihood.story_likelihood import log_likelihoods
from solidtouch.models.measurement.registry import fit_model, model_name
from solidtouch.models.progress import no_progress
from solidtouch.models.settings import FitSettings
from solidtouch.models.threads import one_blas_thread

import solidtouch as st

L, M, J, K, B = 3, 2, 5, 4, 12
STORIES = {story.__name__: story for story in (laplace, levels, two_levels, walk, correlated, heavy, shifted)}


@pytest.fixture(scope="module")
def taps(make_taps):
    return make_taps(L, M, J, K, repeats=5)


@pytest.fixture(scope="module", autouse=True)
def _few_steps():
    """The numbers do not matter here, only that they are the same everywhere."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fits, "_AT_ONCE", 20)
        patch.setattr(fits, "TRIED", 20)
        patch.setattr(fits, "STEPS", 40)
        patch.setattr(fits, "_WINDOW", 10)
        patch.setattr(fits, "RUNS", 1)
        patch.setattr(fits, "STARTS", 2)
        yield


def quick(story, taps, progress=no_progress, **more):
    settings = FitSettings(**{"method": "map", "bins": B, "unconverged": True, "power": "none", **more})
    return fit_model(story if isinstance(story, str) else model_name(story), taps, taps.grid(), settings, "", progress)


def near_the_taps(fit, _):
    """In place of a fit, which takes a second of compiling: values at which the taps of each class are likely."""
    where, what, session = fit.batch.where, fit.batch.what, fit.batch.session
    levels = np.array([[fit.samples[(where == l) & (what == m)].mean(axis=0) for m in range(M)] for l in range(L)])
    loc, spread = levels.mean(axis=2), np.random.default_rng(3).uniform(0.5, 1.5, size=(L, M, K))
    values = {
        "loc": loc,
        "rate": 1.0 + loc.clip(0),
        "level": levels if fit.structure.dims.get("level", ())[2:3] == ("sample",) else loc,
        "scale": spread,
        "variance": spread**2,
        "root": np.linalg.cholesky(0.4 * np.eye(K) + 0.6),
        "drift": np.array(0.5),
        "low": loc - 0.5,
        "gap": 0.5 + spread,
        "share": np.random.default_rng(4).uniform(0.2, 0.8, size=(L, M, K)),
        "shift": np.linspace(-0.3, 0.4, (1 + session.max()) * K).reshape(-1, K),
    }
    if fit.structure.dims == {"loc": ()}:
        values["loc"] = loc.mean()
    if fit.structure.dims == {"loc": ("taxel",)}:
        values["loc"] = loc.mean(axis=(0, 1))
    if fit.structure.dims == {"loc": ("what", "sample")}:
        values["loc"] = levels.mean(axis=(0, 3))
    centre = {name: values[name] for name in fit.names}

    def around(key):
        rng = np.random.default_rng(int(np.asarray(jax.random.key_data(key))[-1]))
        return {name: value * rng.uniform(0.9, 1.1, size=np.shape(value)) for name, value in centre.items()}

    return fits.GuidePosterior(centre, around, fits.Convergence(True, "Set by hand.", {}))


def set_by_hand(story, taps, **more):
    """A model whose parameters are set and not fitted; its prior is not looked at."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fits, "posterior", near_the_taps)
        patch.setattr(fits, "check_prior", lambda _: "")
        return quick(story, taps, **more)


@pytest.fixture(scope="module")
def fitted(taps):
    """Models with parameters set by hand."""
    return {name: set_by_hand(story, taps) for name, story in STORIES.items()}


def scaled(model, taps):
    """Samples and bins in the units of the model, shapes (N, 1, 1, J, K)."""
    bins = model.bins(taps.taps)
    opened = model.edges.copy()
    opened[0], opened[-1] = -np.inf, np.inf
    parts = taps.taps, opened[bins], opened[bins + 1]
    return [((part - model.scaling.centre) / model.scaling.unit)[:, None, None] for part in parts]


def log_probability(normal, lower, upper):
    """On the side where the smaller tail is, so that the difference keeps its digits."""
    with np.errstate(divide="ignore"):
        left, right = normal.cdf(upper) - normal.cdf(lower), normal.sf(lower) - normal.sf(upper)
        return np.log(np.where(normal.cdf(lower) > 0.5, right, left))


def by_hand(name, model, taps):
    """Log-likelihoods from SciPy, shape (N, L, M)."""
    samples, lower, upper = scaled(model, taps)
    own = {key: np.asarray(values) for key, values in model.parameters.items()}
    if name == "laplace":
        base = stats.laplace(own["loc"][:, :, None], own["scale"][:, :, None])
        return log_probability(base, lower, upper).sum(axis=(-2, -1))
    if name == "levels":
        return log_probability(stats.norm(own["level"], 1.0), lower, upper).sum(axis=(-2, -1))
    if name == "two_levels":
        low, gap, scale, share = (own[key][:, :, None] for key in ("low", "gap", "scale", "share"))
        parts = [
            np.log(weight) + log_probability(stats.norm(low + shift, scale), lower, upper)
            for weight, shift in ((1 - share, 0.0), (share, gap))
        ]
        return logsumexp(parts, axis=0).sum(axis=(-2, -1))
    before = np.concatenate([np.zeros_like(samples[..., :1, :]), samples[..., :-1, :]], axis=-2)
    return log_probability(stats.norm(before, own["scale"][:, :, None]), lower, upper).sum(axis=(-2, -1))


@pytest.mark.parametrize("name", slow_but(["two_levels"], ("laplace", "levels", "two_levels", "walk")))
def test_a_class_has_the_likelihood_of_its_story(name, fitted, taps):
    model = fitted[name].model
    few = taps.select(np.arange(0, len(taps), 9))
    expected = by_hand(name, model, few)

    assert model.log_likelihood(few.taps).shape == (len(few), L, M)
    likely = expected > -300  # where differences of distribution functions have digits enough
    assert likely.mean() > 0.3
    np.testing.assert_allclose(model.log_likelihood(few.taps)[likely], expected[likely], rtol=1e-9, atol=1e-7)


@pytest.mark.parametrize("name", slow_but(["two_levels"], STORIES))
def test_all_ways_to_a_likelihood_agree(name, fitted, taps):
    """Compiled, by the story run for every tap, under true classes, by engines; also in states."""
    plain = fitted[name].model
    states = registry.fit_model("session:gaussian", taps, taps.grid(), FitSettings(bins=B)).model.states
    few = taps.select(np.arange(0, len(taps), 9))
    where, what = few.indices(plain.grid)
    for model in (plain, replace(plain, states=states) if name in ("laplace", "two_levels", "walk") else plain):
        found = model.log_likelihood(few.taps)
        np.testing.assert_allclose(log_likelihoods(model, few.taps), found, rtol=1e-9, atol=1e-9)
        own = model.form.own(few.taps, model.edges, where, what)
        np.testing.assert_allclose(own, found[np.arange(len(few)), where, what], rtol=1e-9, atol=1e-9)
    engines = [make_engine(engine, plain) for engine in ("numpy", "numpyro", "filter")]
    beliefs = [engine.update(plain.log_prior, few.taps[0])[0] for engine in engines]
    for belief in beliefs[1:]:
        np.testing.assert_allclose(np.exp(belief), np.exp(beliefs[0]), atol=1e-10)


def test_a_story_without_a_table_has_no_second_likelihood(fitted):
    """And says so, as a comparison with itself would pass whatever it says."""
    assert {name for name, fit in fitted.items() if not fit.model.runs_story} == {"laplace", "shifted"}


def test_exchangeable_samples_have_a_table_and_others_none(fitted):
    assert {name for name, fit in fitted.items() if isinstance(fit.model.plain_form, TableForm)} == {"laplace"}


def test_a_built_in_story_has_the_likelihood_of_its_fast_form(taps):
    built_in = fit_model("gaussian", taps, taps.grid(), FitSettings(bins=B, power="none")).model
    parameters = {name: values[:, :, 0] for name, values in built_in.parameters.items()}
    own = replace(set_by_hand(normal, taps).model, parameters=parameters)

    np.testing.assert_allclose(own.log_likelihood(taps.taps), built_in.log_likelihood(taps.taps), rtol=1e-9)


def test_counts_have_the_probabilities_of_the_integers_in_their_bins(taps, make_taps, rng):
    what = taps.indices(taps.grid())[1]
    values = rng.poisson(2.0 + 3.0 * what[:, None, None], size=(len(taps), J, K)).astype(float)
    counted = taps.__class__(taps.dataset.assign(taps=(taps.dataset["taps"].dims, values)))
    model = set_by_hand(counts, counted, edges=np.arange(-0.5, 21.0, 3.0)).model
    rate = model.parameters["rate"][0, 1, 2]
    edges = np.append(model.edges[:-1], np.inf)
    expected = np.diff(stats.poisson(rate).cdf(np.ceil(edges) - 1))

    assert (model.scaling.centre == 0).all()
    np.testing.assert_allclose(np.exp(model.plain_form.log_prob[0, 1, 2]), expected, rtol=1e-9)


def test_a_new_session_is_drawn_from_its_prior(fitted, taps):
    """At the fitted values the likelihood is the mean over shifts, wider than in a known session."""
    model = fitted["shifted"].model
    parts = model.plain_form.parts
    shifts = np.array([part.log_prob.argmax(axis=-1)[0, 0, 0] for part in parts])
    each = np.array([part.own(taps.taps, model.edges, *taps.indices(model.grid)) for part in parts])

    assert len(set(shifts.tolist())) > 1
    mean = logsumexp(each, axis=0) - np.log(len(parts))
    where, what = taps.indices(model.grid)
    states = model.log_likelihood(taps.taps)[np.arange(len(taps)), where].reshape(len(taps), len(parts), -1)
    found = logsumexp(states[np.arange(len(taps)), :, what] + model.states.log_prior, axis=1)
    np.testing.assert_allclose(found, mean, atol=0.1)  # of other draws, those of states with weights


@pytest.mark.slow
def test_draws_made_together_are_those_made_one_by_one(fitted, monkeypatch):
    """New sessions and tables, three at a time, of which the last ones are fewer."""
    model, S = fitted["shifted"].model, 7
    monkeypatch.setattr(form, "_DRAWS", 3)
    monkeypatch.setattr(sessions, "_AT_ONCE", 3)
    own = [[np.random.default_rng(d) for d in range(S)] for _ in range(2)]
    points = [{"shift": np.full((1, K), (d + 1) / (S + 1))} if d % 2 else {} for d in range(S)]
    known = [{**model.parameters, "drift": np.array(0.1 * d + 0.1)} for d in range(S)]
    for few in (slice(0, S, 2), slice(1, S, 2)):  # drawn freely, and at quantiles
        made = list(sessions.in_new_sessions(model.program, known[few], own[0][few], points[few]))
        assert len(made) == len(known[few])
        forms = list(model._forms_of(made))
        each = zip(made, forms, known[few], own[1][few], points[few], strict=True)
        for together, made_form, *given in each:
            alone = sessions.with_new_session(model.program, *given)
            np.testing.assert_allclose(together["shift"], alone["shift"], rtol=1e-12)
            np.testing.assert_allclose(made_form.log_prob, model.form_of(alone).log_prob, rtol=1e-12)


def test_every_draw_has_a_new_session_of_its_own(taps):
    """Shifts are drawn again and again, also relative to their spread."""
    draws = set_by_hand(shifted, taps, method="svi", integrate=4).model.draws
    new = np.array([draw["shift"][-1] / draw["drift"] for draw in draws])

    assert draws[0]["shift"].shape == (3, K)
    assert len(np.unique(new.round(6))) == new.size


def test_the_story_judges_sessions_with_the_draws_and_states_that_decide(fitted, taps):
    """A draw keeps its new session, and in states the probabilities of bins are moved."""
    model = fitted["shifted"].model
    states = registry.fit_model("session:gaussian", taps, taps.grid(), FitSettings(bins=B)).model.states
    shift = model.parameters["shift"]
    draws = tuple({**model.parameters, "shift": np.concatenate([shift, new])} for new in (shift[:1] - 1, shift[:1] + 1))
    for other in (replace(model, draws=draws), replace(model, states=states)):
        few = taps.taps[::9]
        np.testing.assert_allclose(log_likelihoods(other, few), other.log_likelihood(few), rtol=1e-9, atol=1e-9)


def test_a_story_that_ignores_labels_tells_no_classes_apart(taps):
    model = set_by_hand(alike, taps).model
    found = model.log_likelihood(taps.taps)

    np.testing.assert_allclose(found, np.broadcast_to(found[:, :1, :1], found.shape), rtol=1e-12)


@pytest.mark.parametrize("name", slow_but(["walk"], ("laplace", "walk", "correlated")))
def test_drawn_taps_follow_the_story(name, fitted):
    """Their mean log probability per bin is that of its own expectation: taps of other classes are less likely."""
    model, n = fitted[name].model, 300
    where, what = np.full(n, 1), np.arange(n) % 2
    made = model.form.sample(where, what, model.edges, J, np.random.default_rng(1))
    own = model.form.own(made, model.edges, where, what)
    other = model.form.own(made, model.edges, where, 1 - what)

    assert made.shape == (n, J, K)
    assert (own - other).mean() > 3 * (own - other).std() / np.sqrt(n)


@pytest.mark.parametrize("name", slow_but(["walk"], ("laplace", "walk")))
def test_decisions_are_integrated_over_draws(name, taps):
    """By the mean likelihood of whole taps over the draws, in every route."""
    model = set_by_hand(STORIES[name], taps, method="svi", integrate=4).model
    few = taps.select(np.arange(0, len(taps), 9))
    each = [replace(model, parameters=draw, draws=()).log_likelihood(few.taps) for draw in model.draws]
    expected = logsumexp(each, axis=0) - np.log(4)

    assert np.abs(each[0] - each[1]).max() > 1e-3
    np.testing.assert_allclose(model.log_likelihood(few.taps), expected, rtol=1e-9)
    np.testing.assert_allclose(log_likelihoods(model, few.taps), expected, rtol=1e-9)
    beliefs = [
        make_engine(engine, model).update(model.log_prior, few.taps[0])[0] for engine in ("numpy", "numpyro", "filter")
    ]
    for belief in beliefs[1:]:
        np.testing.assert_allclose(np.exp(belief), np.exp(beliefs[0]), atol=1e-10)


@pytest.mark.parametrize("name", slow_but(["session:gaussian"], ("histogram", "profile", "session:gaussian")))
def test_built_in_models_are_integrated_too(name, taps, tmp_path):
    """And their file keeps the draws."""
    settings = FitSettings(bins=B, integrate=3, power="none")
    with one_blas_thread():
        fit = fit_model(name, taps, taps.grid(), settings)
    model, few = fit.model, taps.select(np.arange(0, len(taps), 9))
    plain = replace(model, draws=())
    forms = [plain.form_of(draw) for draw in model.draws]
    if name == "histogram":
        each = [part.own(few.taps, model.edges, *few.indices(model.grid)) for part in forms]
        where, what = few.indices(model.grid)
        expected, found = logsumexp(each, axis=0) - np.log(3), model.log_likelihood(few.taps)
        np.testing.assert_allclose(found[np.arange(len(few)), where, what], expected, rtol=1e-9)
    assert len(forms) == 3
    assert np.abs(model.log_likelihood(few.taps) - plain.log_likelihood(few.taps)).max() > 1e-3
    np.testing.assert_allclose(log_likelihoods(model, few.taps), model.log_likelihood(few.taps), rtol=1e-9)
    belief = [make_engine(e, model).update(model.log_prior, few.taps[0])[0] for e in ("numpy", "numpyro", "filter")]
    np.testing.assert_allclose(np.exp(belief[1]), np.exp(belief[0]), atol=1e-10)
    np.testing.assert_allclose(np.exp(belief[2]), np.exp(belief[0]), atol=1e-10)
    model.save(tmp_path / "model.nc")
    np.testing.assert_array_equal(
        load_model(tmp_path / "model.nc").log_likelihood(few.taps), model.log_likelihood(few.taps)
    )


def test_a_histogram_without_a_posterior_cannot_be_integrated(taps):
    with pytest.raises(InputError, match="has no posterior to integrate over"):
        fit_model("histogram", taps, taps.grid(), FitSettings(pseudocount=0, integrate=2))


@pytest.fixture
def in_file(tmp_path, monkeypatch):
    """A function of a file that leaves a mark whenever the file is run."""

    def write(body="dist.Normal(0.0, 1.0)"):
        path = tmp_path / "my_models.py"
        path.write_text(
            f"""from pathlib import Path
import numpyro, numpyro.distributions as dist
Path({str(tmp_path / "mark")!r}).touch()
def mine(where, what, taps=None, *, L, M, J, K):
    "A level of each class."
    with numpyro.plate("L", L, dim=-3), numpyro.plate("M", M, dim=-2), numpyro.plate("K", K, dim=-1):
        loc = numpyro.sample("loc", {body})
    with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("taxel", K, dim=-1):
        numpyro.sample("taps", dist.Normal(loc[where, what][:, None], 1.0), obs=taps)
def timed(where, what, taps=None, *, L, M, J, K):
    with numpyro.plate("M", M, dim=-2), numpyro.plate("J", J, dim=-1):
        loc = numpyro.sample("loc", {body})
    with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("taxel", K, dim=-1):
        numpyro.sample("taps", dist.Normal(loc[what][:, :, None], 1.0), obs=taps)
""",
            encoding="utf-8",
        )
        return path

    monkeypatch.setattr(source, "_registered", {})
    return write


def forget(monkeypatch, tmp_path):
    monkeypatch.setattr(source, "_registered", {})
    (tmp_path / "mark").unlink()


def test_opening_a_fit_runs_no_code(in_file, taps, tmp_path, monkeypatch):
    """Its tables decide as before; a fit without tables asks for the code."""
    path = in_file()
    fit = set_by_hand(f"{path}:mine", taps)
    fit.model.save(tmp_path / "fit.nc")
    set_by_hand(f"{path}:timed", taps).model.save(tmp_path / "timed.nc")
    forget(monkeypatch, tmp_path)
    opened = load_model(tmp_path / "fit.nc")

    np.testing.assert_array_equal(opened.log_likelihood(taps.taps), fit.model.log_likelihood(taps.taps))
    assert opened.name == f"{path}:mine"
    with pytest.raises(InputError, match=r"timed\.nc: this fit needs the code of .*--story"):
        load_model(tmp_path / "timed.nc")
    assert not (tmp_path / "mark").exists()
    with pytest.raises(InputError, match=r"^save\(\) and to_datatree\(\) need the code of .*mine, "):
        opened.save(tmp_path / "again.nc")
    named = load_model(tmp_path / "timed.nc", f"{path}:timed")
    assert named.log_likelihood(taps.taps).shape == (len(taps), L, M)


def test_a_fit_of_a_function_says_how_to_name_it(in_file, taps, tmp_path, monkeypatch):
    """By its file, whatever it was registered as."""
    path = in_file()
    function = source.named(f"{path}:timed").function
    registry.register(function, "off")
    registry.register(partial(function), "partly")
    for name in ("off", "partly"):
        set_by_hand(name, taps).model.save(tmp_path / f"{name}.nc")
    forget(monkeypatch, tmp_path)
    monkeypatch.chdir(tmp_path)

    with pytest.raises(InputError, match=r"the code of off, .*, or with --story my_models\.py:timed\.$"):
        load_model("off.nc")
    assert load_model("off.nc", "my_models.py:timed").name == "my_models.py:timed"
    with pytest.raises(InputError, match=r"the code of partly, .*--story FILE\.py:FUNCTION, if it is in a file\.$"):
        load_model("partly.nc")


def test_changed_code_is_not_taken_for_that_of_the_fit(in_file, taps, tmp_path, monkeypatch):
    path = in_file()
    set_by_hand(f"{path}:mine", taps).model.save(tmp_path / "fit.nc")
    set_by_hand(f"{path}:timed", taps).model.save(tmp_path / "timed.nc")
    forget(monkeypatch, tmp_path)
    in_file("dist.Normal(0.0, 2.0)")

    with pytest.raises(
        InputError, match=r"fit\.nc: .*changed since\. Name the right one, fit again, or leave it out: the tables"
    ):
        load_model(tmp_path / "fit.nc", f"{path}:mine")
    with pytest.raises(InputError, match=r"timed\.nc: .*changed since\. Name the right one, or fit again\.$"):
        load_model(tmp_path / "timed.nc", f"{path}:timed")
    assert load_model(tmp_path / "fit.nc").grid.shape == (L, M)


@pytest.mark.parametrize("name", slow_but(["walk"], ("laplace", "walk", "shifted")))
def test_a_model_survives_its_file(name, fitted, taps, tmp_path):
    fitted[name].model.save(tmp_path / "model.nc")
    again = load_model(tmp_path / "model.nc")

    assert again.name == name
    np.testing.assert_array_equal(again.log_likelihood(taps.taps), fitted[name].model.log_likelihood(taps.taps))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("raise RuntimeError('no')", r"my\.py: running it failed: RuntimeError: no"),
        ("raise SystemExit(5)", r"my\.py: running it failed: SystemExit: 5"),
        ("def other(): ...\ndef _own(): ...", r"my\.py: no function 'mine'; it has other\."),
        ("mine = 3", "is no function"),
    ],
)
def test_a_file_without_the_function_is_refused(content, message, tmp_path):
    (tmp_path / "my.py").write_text(content, encoding="utf-8")

    with pytest.raises(InputError, match=message):
        source.named(f"{tmp_path}/my.py:mine")


def test_a_missing_file_and_an_unknown_name_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        source.named(f"{tmp_path}/my.py:mine")
    with pytest.raises(InputError, match=r"FILE\.py:FUNCTION"):
        registry.split_name("laplacian")
    with pytest.raises(InputError, match="'gaussian' is a built-in model; register the function under another name"):
        registry.register(laplace, "gaussian")
    with pytest.raises(InputError, match="'<lambda>' cannot be the name of a model"):
        registry.model_name(lambda: None)
    with pytest.raises(InputError, match="a name or a NumPyro function, got 3"):
        registry.model_name(3)


def test_functions_of_one_name_are_told_apart_by_other_names(monkeypatch):
    monkeypatch.setattr(source, "_registered", {})

    def twin(where, what, taps=None): ...

    twin.__name__ = "laplace"
    with pytest.raises(InputError, match=r"2 functions are named 'laplace'; register .* st\.register"):
        registry.model_names([laplace, "gaussian", twin])
    assert registry.model_names([laplace, "gaussian", registry.register(twin, "twin")]) == [
        "laplace",
        "gaussian",
        "twin",
    ]


def test_a_function_whose_fit_fails_is_not_kept(taps, monkeypatch):
    """A name that stood for another function before stands for it still."""
    monkeypatch.setattr(source, "_registered", {})

    def fails(where, what, taps=None):
        raise KeyError("a key")

    with pytest.raises(InputError, match="failed when it was tried"):
        st.fit(taps, fails)
    assert source.registered("fails") is None
    before = source.add(laplace, "fails")
    with pytest.raises(InputError, match="failed when it was tried"):
        st.fit(taps, fails)
    assert source.registered("fails") is before


def test_another_function_of_the_same_file_is_not_taken_for_the_fitted_one(in_file, taps, tmp_path):
    path = in_file()
    set_by_hand(f"{path}:mine", taps).model.save(tmp_path / "fit.nc")

    for story, message in (
        (f"{path}:timed", "it is another function"),
        (f"{path}", "fit is of .*mine. No function"),
        (laplace, "it is another function"),
        (lambda taps: taps, "must begin with the arguments"),
    ):
        with pytest.raises(InputError, match=rf"fit\.nc: .*{message}"):
            load_model(tmp_path / "fit.nc", story)


@pytest.mark.parametrize(("shape", "limit"), [((60, 5, 4), 0.1), ((12, 5, 4), 0.25), ((60, 50, 12), 0.6)])
def test_few_taps_and_long_ones_may_change_more_between_windows(shape, limit):
    assert fits.largest_change(fits.Fit(None, None, None, np.zeros(shape), 0)) == pytest.approx(limit)


@pytest.mark.slow
def test_the_best_start_goes_on_until_the_loss_is_still(taps, monkeypatch):
    """Of two starts the first is the better one at this seed; more runs follow only where the loss still changes.

    What is drawn lies around the centre and follows its seed. Progress is full at the end.
    """
    found, bars = [], []

    def progress(name, steps):
        bars.append((f"{name}: {steps}", []))
        return bars[-1][1].append

    for starts, still in ((1, 0.0), (2, 1e9)):
        for name, value in {"STARTS": starts, "_STILL": still, "_IN_ALL": 0.0, "_PER_SAMPLE": 0.0}.items():
            monkeypatch.setattr(fits, name, value)
        fit = quick(alike, taps, progress, method="svi", seed=1, steps=80)
        found.append((fit.convergence.converged, fit.convergence.stats["loss"]))
    (moving, long), (still, short) = found

    assert (moving, still, len(long), len(short)) == (False, True, 20 + 2 * 40, 20 + 40)
    assert [(name, sum(done)) for name, done in bars] == [("alike, steps: 100", 100), ("alike, steps: 120", 120)]
    assert bars[0][1] == [20] * 5 + [0]
    assert long[-10:].mean() < long[:10].mean() - 0.2
    np.testing.assert_array_equal(short, long[: len(short)])
    draws = [fit.posterior.draw(np.random.default_rng(seed))["loc"] for seed in (1, 1, 2)]
    np.testing.assert_array_equal(draws[0], draws[1])
    assert 1e-3 < np.abs(draws[0] - draws[2]).max() < 2
    assert np.abs(draws - fit.posterior.point()["loc"]).max() < 2


def test_a_singular_curvature_is_told(taps, monkeypatch):
    """Far from the most probable values, there is no normal distribution around them."""
    monkeypatch.setattr(fits, "check_prior", lambda _: "")

    def far(where, what, taps=None, *, J, K):
        loc = numpyro.sample("loc", dist.Normal(0.0, 1.0))
        numpyro.sample("taps", dist.Cauchy(loc + 30.0, 1.0).expand([len(where), J, K]), obs=taps)

    convergence = quick(far, taps, method="laplace").convergence
    assert not convergence.converged
    assert "curvature at the most probable values is singular" in convergence.sentence


@pytest.mark.slow
def test_all_fits_find_the_same_levels(taps, monkeypatch):
    """And draw around them as widely, up to what a factorised guide leaves out."""
    for name, value in {"TRIED": 200, "STEPS": 800, "_WINDOW": 100, "RUNS": 5}.items():
        monkeypatch.setattr(fits, name, value)

    def guide(where, what, taps=None, *, L, M, K, **_):
        place = numpyro.param("place", jnp.zeros((L, M, K)))
        width = numpyro.param("width", 0.1 * jnp.ones((L, M, K)), constraint=dist.constraints.positive)
        with numpyro.plate("L", L, dim=-3), numpyro.plate("M", M, dim=-2), numpyro.plate("K", K, dim=-1):
            numpyro.sample("loc", dist.Normal(place, width))

    def known_scale(where, what, taps=None, *, L, M, J, K):
        with numpyro.plate("L", L, dim=-3), numpyro.plate("M", M, dim=-2), numpyro.plate("K", K, dim=-1):
            loc = numpyro.sample("loc", dist.Normal(0.0, 3.0))
        with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("taxel", K, dim=-1):
            numpyro.sample("taps", dist.Normal(loc[where, what][:, None], 1.0), obs=taps)

    def guided(where, what, taps=None, *, L, M, J, K):
        known_scale(where, what, taps, L=L, M=M, J=J, K=K)

    measurement_model(guide=guide)(guided)
    found = {method: quick(known_scale, taps, method=method) for method in ("svi", "nuts", "map", "laplace")}
    found["guide"] = quick(guided, taps, method="svi")
    n = 2 * 5 * J  # samples of a class and taxel
    model = found["svi"].model
    where, what = taps.indices(model.grid)
    samples = (taps.taps - model.scaling.centre) / model.scaling.unit
    means = np.array([[samples[(where == l) & (what == m)].mean(axis=(0, 1)) for m in range(M)] for l in range(L)])
    exact = means * n / (n + 1 / 9)
    for name, fit in found.items():
        within = {"svi": 0.8, "guide": 0.8, "nuts": 0.3}.get(name, 0.15) * n**-0.5  # of a posterior deviation
        np.testing.assert_allclose(fit.model.parameters["loc"], exact, atol=within, err_msg=name)
        if name != "map":
            draws = [fit.posterior.draw(np.random.default_rng(seed))["loc"] for seed in range(200)]
            np.testing.assert_allclose(np.std(draws, axis=0).mean(), (n + 1 / 9) ** -0.5, rtol=0.15, err_msg=name)


@pytest.mark.slow
def test_discrete_variables_are_summed_for_one_class_and_taxel():
    """Where all plates have one element."""
    story, none = StoryFunction.of(two_levels, "two_levels"), np.zeros(0, dtype=int)
    batch = StoryCall(none, none, (1, 1, 1, 1), session=none)
    own = replace(batch, where=np.zeros(2, dtype=int), what=np.zeros(2, dtype=int))
    samples = np.array([0.3, 1.2]).reshape(2, 1, 1)
    with jax.enable_x64(True), numpyro.validation_enabled(False):
        fit = fits.Fit(story, structure_of(story, batch), own, samples, 0)
        programs = fits.Variational.of(fit, "map")
        _, losses = programs.forward(programs.begin(jax.random.key(0), fit.data), fit.data)

    assert losses.shape == (fits._AT_ONCE,)
    assert np.isfinite(losses).all()


@pytest.mark.slow
def test_chains_sum_over_what_is_discrete(make_taps):
    """Without a warning of NumPyro, which would fail the test, and have draws of the other variables alone."""

    def two(where, what, taps=None, *, J, K):
        low = numpyro.sample("low", dist.Normal(0.0, 3.0))
        with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
            upper = numpyro.sample("upper", dist.Bernoulli(0.5))
            numpyro.sample("taps", dist.Normal(low + upper, 1.0), obs=taps)

    fit = quick(two, make_taps(2, 1, 2, 1, sessions=1, repeats=2), method="nuts", steps=50)
    assert list(fit.posterior.point()) == ["low"]
    assert fit.convergence.stats["ess"] > 1


def test_one_value_cannot_be_integrated_over(taps):
    with pytest.raises(InputError, match="map has one value and no draws"):
        quick(laplace, taps, integrate=3)


def test_too_many_variables_for_a_laplace_approximation_are_refused(taps, monkeypatch):
    monkeypatch.setattr(fits, "_MOST_CURVED", 10)
    monkeypatch.setattr(fits, "check_prior", lambda _: "")

    with pytest.raises(InputError, match=r"laplace has 48, at most 10"):
        quick(laplace, taps, method="laplace")


def level_of(distribution):
    """A story of one level, whose samples are distributed as the function of the level and positions says."""

    def story(where, what, taps=None, *, J, K):
        loc = numpyro.sample("loc", dist.Normal(0.0, 1.0))
        with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("taxel", K, dim=-1):
            numpyro.sample("taps", distribution(loc, jnp.asarray(where)[:, None, None]), obs=taps)

    return story


@pytest.mark.parametrize(
    ("distribution", "message"),
    [
        (
            lambda loc, where: dist.Normal(loc, jnp.where(where == 1, -1.0, 1.0)),
            "story is not a number for a tap of position 1 and object 0",
        ),
        pytest.param(
            lambda loc, where: dist.Normal(jnp.where(where == 1, jnp.log(-1.0 - loc**2), loc), 1.0),
            "story is not a number for a tap of position 1 and object 0",
            marks=pytest.mark.slow,
        ),
        (
            lambda loc, where: dist.HalfNormal(1.0 + loc**2 + 0.0 * where),
            "story excludes samples that occur, for a tap of position 0.*of both signs",
        ),
    ],
)
def test_a_density_that_is_not_finite_is_told_with_its_class(distribution, message, taps):
    with pytest.raises(InputError, match=message):
        quick(level_of(distribution), taps)


def test_a_probability_that_is_not_a_number_is_told_with_its_class(fitted, taps, monkeypatch):
    """Also of a model without a table, where it is computed."""
    wrong = np.full((1, L, M), -3.0)
    wrong[0, 1, 0] = np.nan
    monkeypatch.setattr(GenericForm, "log_prob", lambda *_: wrong)

    with pytest.raises(InputError, match=r"position 1 and object 0 .* not a number; .* its GaussianRandomWalk, and"):
        fitted["walk"].model.log_likelihood(taps.taps[:1])


@pytest.mark.parametrize(
    ("distribution", "told"),
    [
        (lambda loc, where: dist.Normal(50.0 * loc + 0.0 * where, 500.0), "deviation of [45]"),
        (
            lambda loc, where: dist.Normal(100.0 + loc + 0.0 * where, 1.0),
            "a mean of 9.* taps one of .*standardised",
        ),
        (lambda loc, where: dist.Cauchy(loc + 0.0 * where, 1.0), "^$"),
    ],
)
def test_a_prior_far_from_the_taps_is_told_with_figures(distribution, told, taps, monkeypatch):
    """Ten times too wide or too high, and not heavy tails."""
    monkeypatch.setattr(fits, "posterior", near_the_taps)

    assert re.search(told, quick(level_of(distribution), taps).convergence.warning)


@pytest.mark.parametrize(
    ("drawn", "told"),
    [
        (lambda rng, loc: rng.normal(loc, 0.3, size=(60, J, K)), None),
        (lambda rng, loc: rng.normal(0.001 * loc, 1e-3, size=(60, J, K)), r"deviation of 0\.0\d* to 0\.0"),
    ],
)
def test_draws_from_a_prior_are_compared_with_the_taps(drawn, told, taps, rng):
    """Ten times too narrow, and not one that varies enough."""
    samples = (taps.taps - taps.taps.mean()) / taps.taps.std()
    fit = fits.Fit(StoryFunction.of(laplace, "my-models.py:laplace"), None, None, samples, 0)
    moments = np.array([(made.mean(), made.std()) for made in (drawn(rng, loc) for loc in rng.normal(size=10))]).T
    warning = fits._far(fit, *moments)

    assert bool(warning) == (told is not None)
    assert told is None or ("my-models.py:laplace" in warning and re.search(told, warning))


def test_a_prior_far_from_the_taps_is_told_of_a_fit_that_did_not_converge(taps):
    """Which may be why."""
    wide = level_of(lambda loc, where: dist.Normal(loc + 0.0 * where, 500.0))
    lost = fits.Convergence(False, "Lost.", {})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fits, "posterior", lambda *given: near_the_taps(*given)._replace(told=lost))
        with pytest.raises(NotConvergedError, match=r"not converge: Lost\. The prior of .* more .*--steps .* Use it"):
            quick(wide, taps, unconverged=False)


@pytest.mark.slow
def test_categories_are_samples_too(make_taps):
    """Distributions that take integers alone are fitted and judged, each category by its probability."""

    def graded(where, what, taps=None, *, M, J, K):
        with numpyro.plate("M", M):
            loc = numpyro.sample("loc", dist.Normal(0.0, 1.0))
        level = jnp.broadcast_to(loc[what][:, None, None], (len(where), J, K))
        with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
            numpyro.sample("taps", dist.OrderedLogistic(level, jnp.array([-1.0, 0.0, 1.0])), obs=taps)

    taps = make_taps(L=1, M=2, J=3, K=2, repeats=8)
    counts = np.clip(np.round(taps.taps), 0, 3)
    taps = taps.__class__(taps.dataset.assign(taps=(taps.dataset["taps"].dims, counts)))
    model = registry.fit_model(
        registry.model_name(measurement_model(raw=True)(graded)),
        taps,
        taps.grid(),
        FitSettings(bins=9, power="none", method="map", unconverged=True),
    ).model
    below = [np.r_[0.0, 1 / (1 + np.exp(loc - np.array([-1.0, 0.0, 1.0]))), 1.0] for loc in model.parameters["loc"]]
    expected = [[np.log(np.diff(cdf))[tap.astype(int)].sum() for cdf in below] for tap in counts]

    np.testing.assert_allclose(model.log_likelihood(counts)[:, 0], expected, rtol=1e-6)
