"""Files of fitted models: what goes in comes out, ArviZ reads them, and damaged ones are refused in a sentence."""

import json
from dataclasses import replace

import h5py
import numpy as np
import pytest
import xarray as xr
from netcdf_readings import same_by_both_ways
from slow_cases import slow_but
from solidtouch.models.errors import InputError
from solidtouch.models.io.arviz_tree import draw_groups
from solidtouch.models.io.model_file import load_model, save_model
from solidtouch.models.measurement import registry
from solidtouch.models.measurement.draws import Draws, posterior_draws
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.measurement.model import Fitted
from solidtouch.models.measurement.novelty import NoveltyScores
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.measurement.student import StudentPosterior
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.settings import FitSettings
from solidtouch.models.storage import write_groups
from solidtouch.models.taps import TapSet

L, M, J, K, B = 3, 4, 6, 5, 9
NAMES = [*registry.NAMES, "session:profile"]


@pytest.fixture(scope="module")
def taps(make_taps):
    return make_taps(L, M, J, K, sessions=2, repeats=2)


@pytest.fixture(scope="module")
def grid(taps):
    return taps.grid()


@pytest.fixture(scope="module")
def fitted(taps, grid, as_student):
    """All models by name; `student`, whose fit takes long, with the parameters of `gaussian`."""
    settings = FitSettings(bins=B, unconverged=True, gain_sd=0.1, offset_sd=0.2)
    models = {name: fit_model(name, taps, grid, settings, "taps.nc: all of it") for name in NAMES if name != "student"}
    student = as_student(models["gaussian"].model)
    posterior = StudentPosterior(student.parameters, lambda _: {}, 600, 0.1, np.linspace(9.0, 2.0, 600))
    return models | {"student": Fitted(student, posterior, posterior.convergence())}


def without(taps, *cells):
    """The taps without those of these (where, what) classes."""
    where, what = taps.indices(taps.grid())
    return taps.select(~np.any([(where == l) & (what == m) for l, m in cells], axis=0))


def old_layout(model, path):
    """The file of a histogram model as versions without other models wrote it, format 1."""
    dataset = xr.Dataset(
        {
            "counts": (("where", "what", "taxel", "bin"), model.counts),
            "probabilities": (("where", "what", "taxel", "bin"), model.probabilities),
            "edges": (("edge",) if model.edges.ndim == 1 else ("taxel", "edge"), model.edges),
            "training": ("digest", model.training),
        },
        {"where": ("where", model.grid.where_value), "what": ("what", np.asarray(model.grid.what_name, dtype=np.str_))},
        {
            "kind": "histogram",
            "format": 1,
            "pseudocount": model.pseudocount,
            "power": str(model.power),
            "preprocessing": model.preprocessing.to_json(),
            "grid": json.dumps(model.grid.to_dict()),
            "left_out": json.dumps(model.left_out),
            "trained_on": model.trained_on,
            "version": model.version,
        },
    )
    if model.novelty is not None:
        dataset["novelty_misfit"] = ("training_tap", model.novelty.misfit)
        dataset["novelty_cell"] = ("training_tap", model.novelty.cell)
        dataset["novelty_best"] = ("training_tap", model.novelty.misfit)
    dataset.to_netcdf(path, engine="h5netcdf")


@pytest.mark.parametrize("name", slow_but(("histogram", "gaussian", "matrix-normal", "session:profile"), NAMES))
def test_every_model_survives_its_file(fitted, taps, tmp_path, name):
    """To the last bit of its log-likelihoods and its prior, with everything that is said about it."""
    model = fitted[name].model
    model.save(tmp_path / "model.nc")
    loaded = load_model(tmp_path / "model.nc")

    assert type(loaded) is type(model)
    for attribute in ("name", "kind", "power", "preprocessing", "left_out", "trained_on", "version", "exponent"):
        assert getattr(loaded, attribute) == getattr(model, attribute)
    assert loaded.name == name
    assert loaded.version
    assert loaded.grid.to_dict() == model.grid.to_dict()
    for attribute in ("edges", "training", "trained", "log_prior"):
        np.testing.assert_array_equal(getattr(loaded, attribute), getattr(model, attribute))
    np.testing.assert_array_equal(loaded.log_likelihood(taps.taps), model.log_likelihood(taps.taps))
    same_by_both_ways(tmp_path / "model.nc", ("/", "constant_data", "parameters"))


@pytest.mark.parametrize("more", [{}, {"value_range": "taxel", "power": 0.125, "pseudocount": 0.0, "bins": 1}])
def test_a_histogram_survives_its_file(taps, grid, tmp_path, more):
    """Nothing is lost or rounded."""
    model = fit(without(taps, (1, 2)), grid, **more)
    model.save(tmp_path / "model.nc")
    loaded = load_model(tmp_path / "model.nc")

    for name in ("pseudocount", "power", "preprocessing", "left_out", "version"):
        assert getattr(model, name) == getattr(loaded, name)
    assert loaded.left_out == ("rod 6 mm at 1.5 mm",)
    for name in ("edges", "counts"):
        np.testing.assert_array_equal(getattr(model, name), getattr(loaded, name))
    np.testing.assert_array_equal(model.log_likelihood(taps.taps), loaded.log_likelihood(taps.taps))


@pytest.mark.parametrize("name", ["gaussian", "profile-mvn", "matrix-normal"])
def test_bins_of_each_taxel_and_untrained_classes_survive(taps, grid, tmp_path, name):
    """An untrained class stays impossible."""
    settings = FitSettings(bins=B, value_range="taxel", power="JK")
    model = fit_model(name, without(taps, (0, 1), (2, 3)), grid, settings).model
    model.save(tmp_path / "model.nc")
    loaded = load_model(tmp_path / "model.nc")

    assert loaded.edges.shape == (K, B + 1)
    assert np.argwhere(np.isneginf(loaded.log_likelihood(taps.taps)[0])).tolist() == [[0, 1], [2, 3]]
    np.testing.assert_array_equal(loaded.log_likelihood(taps.taps), model.log_likelihood(taps.taps))


@pytest.mark.parametrize(("name", "saturation"), [("histogram", 2.75), ("histogram", np.inf), ("profile-ar", 3)])
def test_a_saturation_survives(fitted, tmp_path, name, saturation):
    """Also none; a file of an older version has none."""
    model, path = replace(fitted[name].model, saturation=saturation), tmp_path / "model.nc"
    model.save(path)
    assert load_model(path).saturation == saturation

    attributes(lambda a: {key: value for key, value in a.items() if key != "saturation"})(model, path)
    assert load_model(path).saturation == np.inf


CLOSED = [name for name in NAMES if name != "student"]


@pytest.mark.parametrize("name", slow_but(("histogram", "profile-ar", "matrix-normal", "session"), CLOSED))
def test_a_posterior_in_closed_form_survives_instead_of_draws(fitted, tmp_path, name):
    """Its draws are those of the fitted one to the last bit, also those over which decisions are integrated."""
    integrated = replace(fitted[name].integrated(2, 7).model, posterior=fitted[name].posterior, seed=7)
    integrated.save(tmp_path / "model.nc")
    loaded = load_model(tmp_path / "model.nc")

    assert not {"posterior", "integrated"} & set(opened(tmp_path / "model.nc").children)
    assert (loaded.seed, len(loaded.draws)) == (7, 2)
    drawn = [model.posterior.draw(np.random.default_rng(3)) for model in (loaded, integrated)]
    for before, after in (drawn, *zip(integrated.draws, loaded.draws, strict=True)):
        assert before.keys() == after.keys()
        for parameter in before:
            np.testing.assert_array_equal(before[parameter], after[parameter])


def test_draws_of_older_files_still_decide(fitted, taps, tmp_path):
    """Their seed is not known, so other draws from their posterior would not be of the same fit."""
    model = fitted["histogram"].integrated(3, 5).model
    model.save(tmp_path / "model.nc")
    loaded = load_model(tmp_path / "model.nc")

    assert opened(tmp_path / "model.nc")["integrated"].sizes["integrated"] == 3
    assert loaded.posterior is None
    np.testing.assert_array_equal(loaded.log_likelihood(taps.taps), model.log_likelihood(taps.taps))


def test_a_damaged_posterior_is_refused(fitted, tmp_path):
    """By the name of what is missing."""
    model, path = replace(fitted["profile-ar"].model, posterior=fitted["profile-ar"].posterior), tmp_path / "model.nc"
    changed(lambda data: data.drop_vars("series.square"), "closed_form")(model, path)

    with pytest.raises(InputError, match=r"model.nc: damaged: missing .*series.square"):
        load_model(path)


@pytest.mark.parametrize("name", ["session", "session:profile"])
def test_states_survive(fitted, tmp_path, name):
    """Gains, offsets and their probabilities, 7 times 3 of them."""
    model = fitted[name].model
    model.save(tmp_path / "model.nc")
    loaded = load_model(tmp_path / "model.nc")

    assert loaded.states.gain.shape == (21,)
    for before, after in zip(model.states, loaded.states, strict=True):
        np.testing.assert_array_equal(before, after)


def test_existing_models_are_kept(make_model, tmp_path):
    """Unless forced."""
    path = tmp_path / "model.nc"
    make_model(seed=1).save(path)
    with pytest.raises(InputError, match="already exists"):
        make_model(seed=2).save(path)
    assert (load_model(path).counts == make_model(seed=1).counts).all()
    make_model(seed=2).save(path, force=True)
    assert (load_model(path).counts == make_model(seed=2).counts).all()


# Files of versions that knew no model but the histogram


@pytest.mark.parametrize("more", [{}, {"value_range": "taxel", "power": 0.3, "pseudocount": 0.2}])
def test_files_of_the_first_format_are_read(taps, grid, tmp_path, more):
    """Without their novelty scores, which have no reference; there were no states."""
    model = fit(taps, grid, bins=B, trained_on="taps.nc", **more)
    model = model.with_scores(taps)
    old_layout(model, tmp_path / "old.nc")
    loaded = load_model(tmp_path / "old.nc")

    assert (loaded.name, loaded.power, loaded.trained_on) == ("histogram", model.power, "taps.nc")
    assert len(loaded.states.gain) == 1
    np.testing.assert_array_equal(loaded.training, model.training)
    assert loaded.novelty is None
    np.testing.assert_array_equal(loaded.log_likelihood(taps.taps), model.log_likelihood(taps.taps))


# What ArviZ makes of them


def opened(path):
    with xr.open_datatree(path, engine="h5netcdf") as tree:
        return tree.load()


@pytest.mark.filterwarnings("ignore:Estimated shape parameter:UserWarning")
@pytest.mark.parametrize("name", ["histogram", "profile", "session"])
def test_arviz_opens_files_with_draws(fitted, taps, tmp_path, name):
    """Leave-one-out works on the tree as it is."""
    import arviz as az  # where it comes before NumPyro, it leaves a lazy one behind that lacks submodules

    draws = posterior_draws(fitted[name], taps, 4, 10, 0)
    model, groups = fitted[name].model, draw_groups(fitted[name], taps, draws)
    save_model(model, tmp_path / "model.nc", groups=groups, convergence=fitted[name].convergence)
    tree = opened(tmp_path / "model.nc")
    parameter = next(iter(model.dims))
    dims = ["time" if dim == "sample" else dim for dim in model.dims[parameter]]

    assert np.isfinite(az.loo(tree, reff=1.0).elpd)
    assert list(tree["posterior"][parameter].dims) == ["chain", "draw", *dims]
    assert tree["log_likelihood"]["taps"].sizes == {"chain": 4, "draw": 10, "tap": len(taps)}
    assert tree["posterior"]["what"].values.tolist() == list(model.grid.what_name)
    np.testing.assert_array_equal(tree["log_likelihood"]["session"], taps.session)
    assert tree["posterior"].attrs["inference_library"] == "solidtouch"
    np.testing.assert_array_equal(tree["log_likelihood"]["taps"], draws.log_likelihood)
    assert tree.attrs["converged"] == "True"


def test_what_shows_convergence_is_kept(fitted, tmp_path):
    """The loss of every step, and the sentence."""
    student = fitted["student"]
    save_model(student.model, tmp_path / "model.nc", convergence=student.convergence)
    tree = opened(tmp_path / "model.nc")

    np.testing.assert_array_equal(tree["sample_stats"]["loss"], student.convergence.stats["loss"])
    assert tree.attrs["fit"] == student.convergence.sentence
    assert "posterior" not in tree.children


def test_loading_leaves_draws_on_disk(fitted, taps, tmp_path):
    """A model loads beside draws that no memory holds."""
    model = fitted["profile"].model
    small = Draws(
        {name: np.zeros((1, 1, *values.shape), np.float32) for name, values in model.parameters.items()},
        np.zeros((1, 1, len(taps)), np.float32),
    )
    save_model(model, tmp_path / "model.nc", groups=draw_groups(fitted["profile"], taps, small))
    with h5py.File(tmp_path / "model.nc", "r+") as file:
        for group in ("posterior", "log_likelihood"):
            file[group].create_dataset("vast", shape=(1 << 24, 1 << 24), dtype="f8", chunks=(1, 1 << 16))

    np.testing.assert_array_equal(load_model(tmp_path / "model.nc").edges, model.edges)


# Damaged files


def truncated(model, path):
    """Saves the first half of a model."""
    model.save(path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def changed(change, group="constant_data"):
    """A way of saving a model with a damaged group."""

    def save(model, path):
        groups = model.groups()
        write_groups(groups | {group: change(groups[group])}, path, force=True)

    return save


def attributes(change):
    """A way of saving a model with other attributes."""
    return changed(lambda d: d.drop_attrs(deep=False).assign_attrs(change(d.attrs)), "/")


def setting(name, value):
    """Sets the first element of an array."""

    def change(dataset):
        array = dataset[name].copy(deep=True)
        array.values[(0,) * array.ndim] = value
        return dataset.assign({name: array})

    return change


ANY = {
    "truncated": (truncated, "not a netCDF file"),
    "missing": (lambda *_: None, "no such file"),
    "text": (lambda _, path: path.write_text("model"), "not a netCDF file"),
    "no power": (attributes(lambda a: {k: v for k, v in a.items() if k != "power"}), "damaged: missing 'power'"),
    "other power": (attributes(lambda a: a | {"power": "K"}), "damaged: The power must be"),
    "a power to be learned": (attributes(lambda a: a | {"power": "learned"}), "damaged: The power must be"),
    "a saturation of 0": (attributes(lambda a: a | {"saturation": 0.0}), "damaged: The saturation must be"),
    "a saturation in words": (attributes(lambda a: a | {"saturation": "few"}), "damaged: "),
    "no JSON": (attributes(lambda a: a | {"grid": "{"}), "damaged: "),
    "no grid": (attributes(lambda a: a | {"grid": "{}"}), "damaged: .*[Nn]ot a class grid"),
    "a number as record": (attributes(lambda a: a | {"preprocessing": -3}), "damaged: Not a preprocessing record: .*3"),
    "no record": (attributes(lambda a: a | {"preprocessing": "[]"}), "damaged: .*preprocessing record"),
    "other format": (attributes(lambda a: a | {"format": 99}), "of format 99; this version reads formats 2 and 1"),
    "other kind": (attributes(lambda a: a | {"kind": "neural"}), "not a fitted model of format 2 or 1"),
    "falling edges": (changed(lambda d: d.assign(edges=-d["edges"])), "damaged: edges do not increase"),
    "no edges": (changed(lambda d: d.drop_vars("edges")), "damaged: missing .*edges"),
    "a gain of 0": (changed(setting("state_gain", 0.0)), "damaged: states must be finite, with gains above 0"),
    "an offset of NaN": (changed(setting("state_offset", np.nan)), "damaged: states must be finite"),
    "improbable states": (
        changed(setting("state_log_prior", -9.0)),
        "damaged: probabilities of the states do not sum to 1",
    ),
    "states without offsets": (changed(lambda d: d.drop_vars("state_offset")), "damaged: missing .*state_offset"),
    "two gains": (
        changed(lambda d: d.drop_vars("state_gain").assign(state_gain=("more", np.ones(2)))),
        "damaged: states must have a gain, an offset and a probability each",
    ),
}


DIFFERENT = ["truncated", "missing", "other power", "no JSON", "no record", "other format"]
DIFFERENT += ["falling edges", "no edges", "improbable states", "two gains"]
"""Damage to different parts of a file."""


@pytest.mark.parametrize(
    ("name", "case"),
    slow_but(
        [("histogram", case) for case in DIFFERENT],
        [*(("histogram", case) for case in ANY), *(("profile-ar", case) for case in ("falling edges", "no edges"))],
    ),
)
def test_damaged_files_are_refused(fitted, tmp_path, name, case):
    """The message names the file. All but edges are read alike for every model, before its own part."""
    path, (save_damaged, message) = tmp_path / "model.nc", ANY[case]
    save_damaged(fitted[name].model, path)

    with pytest.raises(InputError, match=rf"model\.nc.*{message}"):
        load_model(path)


def one_object(attributes):
    return attributes | {"grid": json.dumps(json.loads(attributes["grid"]) | {"what_members": [["a"]]})}


COUNTS = {
    "no counts": (changed(lambda d: d.drop_vars("counts")), "damaged: missing .*counts"),
    "other grid": (attributes(one_object), r"damaged: counts have shape \(3, 4, 5, 9\)"),
    "other edges": (changed(lambda d: d.isel(edge=slice(1, None))), r"edges \(9,\)"),
    "counts below 0": (changed(setting("counts", -1)), "counts or the pseudocount are negative"),
    "a pseudocount below 0": (
        attributes(lambda a: a | {"pseudocount": -3.0}),
        "counts or the pseudocount are negative",
    ),
    "an endless pseudocount": (attributes(lambda a: a | {"pseudocount": np.inf}), "the pseudocount are .* infinite"),
    "a misfit of NaN": (changed(setting("novelty_misfit", np.nan)), "novelty scores"),
    "an endless edge": (changed(setting("novelty_edges", np.inf)), "novelty scores"),
    "a reference below 0": (changed(setting("novelty_reference", -1)), "novelty scores"),
    "a class that is not there": (
        changed(lambda d: setting("novelty_cell", d.sizes["where"] * d.sizes["what"])(d)),
        "novelty scores",
    ),
    "a class below 0": (changed(setting("novelty_cell", -1)), "novelty scores"),
}


@pytest.mark.parametrize(("save_damaged", "message"), COUNTS.values(), ids=COUNTS.keys())
def test_damaged_histograms_are_refused(fitted, tmp_path, save_damaged, message):
    model = fitted["histogram"].model
    scores = NoveltyScores(model.counts, model.edges, np.ones(6), np.arange(6))
    save_damaged(replace(model, novelty=scores), tmp_path / "model.nc")

    with pytest.raises(InputError, match=rf"model\.nc.*{message}"):
        load_model(tmp_path / "model.nc")


PARAMETERS = {
    "no level": ("profile", changed(lambda d: d.drop_vars("level"), "parameters"), "missing .*level"),
    "a level of NaN": ("profile", changed(setting("level", np.nan), "parameters"), "level is not finite"),
    "no variance": ("profile", changed(setting("variance", 0.0), "parameters"), "variance is not above 0"),
    "no freedom": ("student", changed(setting("freedom", -1.0), "parameters"), "freedom is not above 0"),
    "no unit": ("gaussian", changed(setting("unit", 0.0)), "unit is not above 0"),
    "fewer samples": (
        "profile-mvn",
        changed(lambda d: d.isel(sample=slice(1, None)), "parameters"),
        r"level .* has shape \(3, 4, 5, 5\) instead of \(3, 4, 6, 5\)",
    ),
    "fewer taxels": (
        "matrix-normal",
        changed(lambda d: d.isel(other_taxel=slice(1, None)), "parameters"),
        r"taxel_covariance .* has shape \(3, 4, 5, 4\)",
    ),
    "other dims": ("profile", changed(lambda d: d.rename(sample="time"), "parameters"), "sample"),
    "no basis": ("smooth", changed(lambda d: d.drop_vars("basis")), "weight .* has shape"),
    "a shorter basis": ("smooth", changed(lambda d: d.isel(basis_function=slice(1, None))), "weight .* has shape"),
    "fewer classes covered": (
        "profile",
        changed(lambda d: d.assign(covered=(("a", "b"), np.ones((2, 2), bool)))),
        r"covered classes have shape \(2, 2\)",
    ),
    "no centre": ("profile-ar", changed(lambda d: d.drop_vars("centre")), "missing .*centre"),
    "a covariance that is none": (
        "matrix-normal",
        changed(setting("time_covariance", -5.0), "parameters"),
        "time_covariance is not a covariance",
    ),
}


FIRST_PARAMETERS = ["no level", "a level of NaN", "no variance", "fewer samples", "fewer classes covered"]
FIRST_PARAMETERS += ["a covariance that is none"]


@pytest.mark.parametrize(
    ("name", "save_damaged", "message"),
    slow_but([PARAMETERS[case] for case in FIRST_PARAMETERS], PARAMETERS.values()),
    ids=PARAMETERS.keys(),
)
def test_damaged_parameters_are_refused(fitted, tmp_path, name, save_damaged, message):
    save_damaged(fitted[name].model, tmp_path / "model.nc")

    with pytest.raises(InputError, match=rf"model\.nc: damaged: .*{message}"):
        load_model(tmp_path / "model.nc")


def test_every_half_of_a_file_is_refused(fitted, taps, tmp_path):
    """Wherever the end is cut off, also within the draws."""
    path = tmp_path / "model.nc"
    model, draws = fitted["gaussian"].model, posterior_draws(fitted["gaussian"], taps, 1, 3, 0)
    save_model(model, path, groups=draw_groups(fitted["gaussian"], taps, draws))
    whole = path.read_bytes()
    for part in range(1, 10):
        path.write_bytes(whole[: len(whole) * part // 10])
        with pytest.raises(InputError, match="not a netCDF file"):
            load_model(path)


def test_tap_sets_are_no_models(taps, tmp_path):
    """Though they are netCDF."""
    taps.save(tmp_path / "taps.nc")
    with pytest.raises(InputError, match=r"taps\.nc: not a fitted model of format 2 or 1, but a tap set\."):
        load_model(tmp_path / "taps.nc")


def test_records_of_other_sizes_are_refused(fitted, tmp_path):
    """The record of preprocessing gives the number of samples."""
    replace(fitted["profile"].model, preprocessing=Preprocessing(samples=J + 1)).save(tmp_path / "model.nc")

    with pytest.raises(InputError, match=r"level .* has shape \(3, 4, 6, 5\) instead of \(3, 4, 7, 5\)"):
        load_model(tmp_path / "model.nc")


def test_a_built_in_model_takes_no_function(taps, grid, tmp_path):
    """Whose name could be wrong without anybody noticing."""
    fit(taps, grid, bins=B).save(tmp_path / "model.nc")

    with pytest.raises(InputError, match=r"model\.nc: the histogram model is built in and takes no function"):
        load_model(tmp_path / "model.nc", story="no.py:walk")


def test_a_model_names_the_origin_of_its_taps(taps, grid, tmp_path):
    """Also in its file; one of an older version names none."""
    model = fit(TapSet(taps.dataset.assign_attrs(source="a bench")), grid, bins=B)
    model.save(tmp_path / "model.nc")
    groups = model.groups()
    del groups["/"].attrs["source"]
    write_groups(groups, tmp_path / "old.nc")

    assert load_model(tmp_path / "model.nc").source == model.source == "a bench"
    assert load_model(tmp_path / "old.nc").source == ""
