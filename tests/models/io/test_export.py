"""Exported models: what programs read in them, and that they are the same models when read back."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solidtouch.inference import reference
from solidtouch.inference.engines.engine import NumpyEngine
from solidtouch.models.cutting.tap_cutter import TapCutter
from solidtouch.models.errors import InputError
from solidtouch.models.io.export import Decisions, exported, log_tables, save_exported
from solidtouch.models.io.export_reader import load_exported
from solidtouch.models.io.model_file import load_model
from solidtouch.models.measurement.histogram import HistogramModel, fit
from solidtouch.models.measurement.registry import fit_model, measurement_model
from solidtouch.models.measurement.table import TableModel
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.settings import FitSettings

DECISIONS = Decisions("clamp", 0.9, 0.25, 1)


def written(tmp_path, model):
    """The model read back by the function that commands use, and what stands in its file."""
    save_exported(model, tmp_path / "model.json", DECISIONS, force=True)
    return load_model(tmp_path / "model.json"), json.loads((tmp_path / "model.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("value_range", ["global", "taxel"])
@pytest.mark.parametrize(
    ("power", "saturation", "pseudocount"), [("J", np.inf, 0.01), ("JK", 2.7, 0.1), (0.0279, 5.0, 1.0)]
)
def test_a_histogram_comes_back_bit_for_bit(tmp_path, make_taps, value_range, power, saturation, pseudocount):
    """Counts, edges, settings, and every log-likelihood."""
    train, test = make_taps(seed=1), make_taps(seed=2)
    chosen = {"bins": 9, "value_range": value_range, "power": power, "pseudocount": pseudocount}
    model = fit(train, train.grid(), trained_on="the first", saturation=saturation, **chosen)
    read, values = written(tmp_path, model)

    assert isinstance(read, HistogramModel)
    np.testing.assert_array_equal(read.log_likelihood(test.taps), model.log_likelihood(test.taps))
    np.testing.assert_array_equal(read.edges, model.edges)
    np.testing.assert_array_equal(read.counts, model.counts)
    assert read.grid.to_dict() == model.grid.to_dict()
    for name in ("pseudocount", "power", "saturation", "preprocessing", "trained_on", "version", "left_out"):
        assert getattr(read, name) == getattr(model, name)
    assert values["saturation"] == (None if saturation == np.inf else saturation)
    assert (read.novelty, len(read.training)) == (None, 0)


def test_the_keys_are_those_of_a_conformance_case(make_model):
    """All of its header's, of the three that exclude each other the one that is there."""
    text = Path(__file__).parents[3].joinpath("analysis/conformance/dataset/RULES.md").read_text(encoding="utf-8")
    table = text.split("The first line is the header of the case:")[1].split("Exactly one of")[0]
    rows = [line.split("|")[1] for line in table.splitlines() if line.startswith("| `")]
    keys = {key for row in rows for key in re.findall(r"`(\w+)`", row)}

    assert {"L", "edges", "counts", "what_name", "fixation"} < keys
    others = {"probabilities", "training", "mean", "sd", "strategy", "pool"}  # of other models, and of one rule to move
    assert keys - set(exported(make_model(), DECISIONS, "a")) == others


def test_every_key_is_documented(make_model):
    """In docs/how-to/exported-models.md, also the fields of the record and the grid."""
    text = Path(__file__).parents[3].joinpath("docs/how-to/exported-models.md").read_text(encoding="utf-8")
    values = {**exported(make_model(), DECISIONS, "a"), **exported(make_model(untrained=[(0, 0)]), DECISIONS, "a")}

    assert [key for key in [*values, *values["grid"], *values["preprocessing"]] if f"`{key}`" not in text] == []


def test_the_rules_of_a_case_give_the_posteriors_of_the_model(tmp_path, make_model, draw_samples):
    """From nothing but the file, by the reference equations, over taps and moves."""
    model = make_model(value_range="taxel", power="JK")
    _, values = written(tmp_path, model)
    tables = np.log(reference.histogram_probabilities(values["counts"], values["pseudocount"]))
    belief, carried = np.log(values["prior"]), model.log_prior
    engine = NumpyEngine(model, values["border"])
    for number, tap in enumerate(draw_samples(model, 6)):
        bins = [reference.bin_index(tap[:, k], values["edges"][k]) for k in range(values["K"])]
        log_likelihood = reference.tap_log_likelihood(np.transpose(bins), tables, values["power"])
        belief, _ = reference.update_log(belief, log_likelihood)
        carried, _ = engine.update(carried, tap)
        np.testing.assert_allclose(belief, carried, rtol=0, atol=1e-12)
        belief = reference.shift_log(belief, number % 3 - 1, values["border"])
        carried = engine.shift(carried, number % 3 - 1)


def test_untrained_classes_stay_impossible(tmp_path, make_model, draw_samples):
    """Counts of zero would make them flat once a move brings belief there, so probabilities of zero are written."""
    model = make_model(untrained=[(0, 1), (2, 3)])
    taps = draw_samples(model, 20)
    read, values = written(tmp_path, model)

    assert "counts" not in values
    assert values["prior"][0][1] == 0
    assert np.array(values["probabilities"])[0, 1].max() == 0
    np.testing.assert_array_equal(read.log_likelihood(taps), model.log_likelihood(taps))
    np.testing.assert_array_equal(read.log_prior, model.log_prior)
    assert read.left_out == ("object 1 at 0 mm", "object 3 at 3 mm")


def test_empty_bins_stay_impossible(tmp_path, make_model):
    """Without a pseudocount the log tables hold minus infinity, before and after."""
    model = make_model(pseudocount=0.0)
    read, _ = written(tmp_path, model)

    assert np.isneginf(log_tables(model)).any()
    np.testing.assert_array_equal(log_tables(read), log_tables(model))


def as_student(model):
    """Student's t of four degrees of freedom in place of a fitted normal; its own fit takes long."""
    parameters = {"level": model.parameters["level"], "scale": np.sqrt(model.parameters["variance"])}
    return replace(
        model, story=measurement_model("student"), parameters={**parameters, "freedom": np.full(model.K, 4.0)}
    )


@pytest.mark.parametrize(("kind", "bins"), [("student", 30), ("gaussian", 4)])
def test_fitted_distributions_of_single_samples_go_as_probabilities(tmp_path, make_taps, kind, bins):
    """Their log-likelihoods agree to 1e-10, and what is read can be written again."""
    train, test = make_taps(seed=1), make_taps(seed=2)
    model = fit_model("gaussian", train, train.grid(), FitSettings(bins=bins)).model
    model = as_student(model) if kind == "student" else model
    read, values = written(tmp_path, model)
    again, _ = written(tmp_path, read)

    assert isinstance(read, TableModel)
    assert values["kind"] == kind
    assert np.ptp(model.log_likelihood(test.taps), axis=(1, 2)).min() > 1
    for copy in (read, again):
        difference = copy.log_likelihood(test.taps) - model.log_likelihood(test.taps)
        assert np.abs(difference).max() < 1e-10


def test_probabilities_below_double_precision_are_refused(make_taps):
    """A Gaussian's bins far out have logs that no probability in double precision stands for."""
    train = make_taps(L=3, M=4)
    model = fit_model("gaussian", train, train.grid(), FitSettings(bins=1000)).model
    narrow = replace(model, parameters={**model.parameters, "variance": 1e-3 * model.parameters["variance"]})

    assert log_tables(narrow).min() < -800
    with pytest.raises(InputError, match=r"so improbable \(1e-\d+\) .* \(--format c-header\)"):
        exported(narrow, DECISIONS, "a")


@pytest.mark.parametrize(("kind", "why"), [("profile", "no tables of single samples"), ("session", "carries a state")])
def test_what_has_no_tables_is_refused(make_taps, kind, why):
    train = make_taps()
    model = fit_model(kind, train, train.grid(), FitSettings(bins=20, gain_sd=0.1, offset_sd=0.1)).model

    with pytest.raises(InputError, match=f"Cannot export a {kind} model: .*{why}"):
        exported(model, DECISIONS, "a")


def test_given_tables_have_no_netcdf_file(tmp_path, make_model):
    read, _ = written(tmp_path, make_model(untrained=[(0, 0)]))

    with pytest.raises(InputError, match=r"A TableModel cannot be saved"):
        read.save(tmp_path / "a.nc")


DAMAGE = {
    "no format": ({"format": ...}, "not a model but a JSON object with the keys"),
    "another format": ({"format": 2}, "of format 2; this version reads format 1"),
    "a case": ({"kind": ...}, "not a model but a JSON object with the keys"),
    "no sizes": ({"K": ...}, "missing key K"),
    "a size in words": ({"L": "3"}, "L must be an integer of at least 1, got '3'"),
    "another size": ({"L": 4}, "grid has 3 x 4 classes, but L and M are 4 and 4"),
    "other samples": ({"J": 6}, "preprocessing has 5 samples, but J is 6"),
    "no grid": ({"grid": {"where_unit": "mm"}}, "grid: Not a class grid: 'where_value'"),
    "no record": ({"preprocessing": {"sample": 5}}, "preprocessing: not a preprocessing record"),
    "a wrong record": ({"preprocessing": {"samples": 5, "rate_hz": -1}}, "preprocessing: rate_hz must be positive"),
    "no tables": ({"counts": ...}, "either key counts or key probabilities"),
    "two tables": ({"probabilities": []}, "either key counts or key probabilities"),
    "ragged counts": ({"counts": [[1, 2], [3]]}, "counts holds lists of different lengths"),
    "few counts": ({"counts": [[1, 2]]}, r"counts must have shape \(3, 4, 2, 7\), got \(1, 2\)"),
    "halves": ({"counts": np.full((3, 4, 2, 7), 0.5).tolist()}, "counts must be integers of at least 0"),
    "negative": ({"counts": np.full((3, 4, 2, 7), -1).tolist()}, "counts must be integers of at least 0"),
    "no counts": ({"counts": np.zeros((3, 4, 2, 7), int).tolist()}, "counts are all 0"),
    "empty": ({"counts": np.zeros((3, 4, 2, 7), int).tolist(), "pseudocount": 0}, "counts has an empty histogram"),
    "no pseudocount": ({"pseudocount": ...}, "missing key pseudocount"),
    "negative pseudocount": ({"pseudocount": -0.5}, "pseudocount must be at least 0, got -0.5"),
    "words for edges": ({"edges": ["a"] * 8}, "edges must hold finite numbers"),
    "infinite edges": ({"edges": [0, 1, 2, 3, 4, 5, 6, 1e999]}, "edges must hold finite numbers"),
    "falling edges": ({"edges": list(range(8, 0, -1))}, "edges do not increase"),
    "few edges": ({"edges": [1, 2]}, r"edges must have shape \(8,\), got \(2,\)"),
    "another prior": ({"prior": np.eye(3, 4).tolist()}, "prior is not uniform"),
    "another power": ({"power": "K"}, "power: The power must be J, JK, none or a positive number, got 'K'"),
    "no power": ({"power": True}, "power must be J, JK, none or a positive number, got True"),
    "no evidence": ({"saturation": 0}, "saturation: The saturation must be a positive number of taps, got 0"),
    "endless": ({"saturation": "none"}, "saturation must be a number of taps or null, got 'none'"),
    "other names": ({"what_name": ["a", "b", "c", "d"]}, "where_unit or what_name differs from that of its grid"),
    "other places": ({"where_value": [0, 1, 2]}, "where_value differs from that of its grid"),
    "no version": ({"version": None}, "version must be text, got None"),
}


@pytest.mark.parametrize(("changes", "message"), DAMAGE.values(), ids=DAMAGE)
def test_a_damaged_file_is_refused_by_file_and_key(tmp_path, make_model, changes, message):
    values = {**exported(make_model(), DECISIONS, "a"), **changes}
    path = tmp_path / "robot.json"
    path.write_text(json.dumps({key: value for key, value in values.items() if value is not ...}), encoding="utf-8")

    with pytest.raises(InputError, match=rf"robot\.json: .*{message}"):
        load_model(path)


def test_impossible_tables_are_refused(tmp_path, make_model):
    """Negative ones, and those in which no class is possible."""
    model = make_model(untrained=[(0, 0)])
    path = tmp_path / "robot.json"
    for number, message in ((-1.0, "probabilities: A probability is negative"), (0.0, "no possible class")):
        tables = np.full((3, 4, 2, 7), number).tolist()
        path.write_text(json.dumps({**exported(model, DECISIONS, "a"), "probabilities": tables}), encoding="utf-8")
        with pytest.raises(InputError, match=rf"robot\.json: .*{message}"):
            load_model(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[1]", "not a JSON object"),
        ('{"format": 1', "not JSON"),
        ('{"L": 1, "L": 2}', "repeated key L"),
        (
            '{"format": 1, "threshold": 0.9}',
            "not a model but a JSON object with the keys format, threshold; a model is",
        ),
    ],
)
def test_what_is_no_exported_model_is_refused(tmp_path, text, message):
    (tmp_path / "robot.json").write_text(text, encoding="utf-8")

    with pytest.raises(InputError, match=rf"robot\.json: .*{message}"):
        load_model(tmp_path / "robot.json")
    with pytest.raises(InputError, match=r"no\.json: no such file"):
        load_model(tmp_path / "no.json")


JUNK = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**400), 10**400) | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=2),
    max_leaves=5,
)


@settings(max_examples=40)
@given(data=st.data())
def test_no_value_ends_in_another_error(tmp_path_factory, make_model, data):
    """Whatever stands in place of a value, the file is refused in a sentence or read."""
    values = exported(make_model(), DECISIONS, "a")
    key = data.draw(st.sampled_from(sorted(values)))
    inside = values[key] if isinstance(values[key], dict) else values
    inside[data.draw(st.sampled_from(sorted(inside))) if inside is not values else key] = data.draw(JUNK)
    path = tmp_path_factory.getbasetemp() / "junk.json"
    path.write_text(json.dumps(values), encoding="utf-8")
    said = str(path)
    try:
        load_exported(path).log_likelihood(np.zeros((1, 5, 2)))
    except InputError as error:
        said = str(error)

    assert str(path) in said


@pytest.mark.parametrize("name", ["where_value", "where_edges", "what_value"])
def test_numbers_too_large_for_a_float_are_refused(tmp_path, make_model, name):
    values = exported(make_model(), DECISIONS, "a")
    values["grid"][name] = [10**400]
    (tmp_path / "robot.json").write_text(json.dumps(values), encoding="utf-8")
    with pytest.raises(InputError, match=r"robot\.json"):
        load_exported(tmp_path / "robot.json")


def test_the_high_pass_is_what_the_document_says(rng):
    """Coefficients and start of docs/how-to/exported-models.md give what the taps of the model were prepared by."""
    record = Preprocessing(samples=40, rate_hz=50.0, highpass_hz=0.3, trigger="clock")
    frames = rng.normal(size=(40, 2)).cumsum(axis=0) + 100
    c = np.tan(np.pi * 0.3 / 50.0)
    x_before, y = frames[0], np.zeros(2)
    prepared = []
    for x in frames:
        y = (x - x_before + (1 - c) * y) / (1 + c)
        x_before = x
        prepared.append(y)

    (tap,) = TapCutter(record).push(frames)
    np.testing.assert_allclose(prepared, tap.samples, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("sensor_hz", "rate_hz", "up", "down"), [(100.0, 30.0, 3, 10), (20.0, 50.0, 5, 2)])
def test_resampling_is_what_the_document_says(rng, sensor_hz, rate_hz, up, down):
    """Kernel, weights and start of docs/how-to/exported-models.md, and which taxels are used."""
    record = Preprocessing(samples=30, rate_hz=rate_hz, sensor_hz=sensor_hz, taxels=(0, 2), trigger="clock")
    frames = rng.normal(size=(240, 3)).cumsum(axis=0) + 100
    slower = max(up, down)
    width = -(-10 * slower // up)

    def kernel(i):
        if abs(i) > 10 * slower:
            return 0.0
        sinc = np.pi / slower if i == 0 else np.sin(np.pi * i / slower) / i
        return sinc * np.i0(0.1102 * (65 - 8.7) * np.sqrt(1 - (i / (10 * slower)) ** 2))

    x = frames[:, [0, 2]]
    results = []
    for m in range(30):
        around = range(m * down // up - width, m * down // up + width + 1)
        weights = np.array([kernel(m * down - n * up) for n in around])
        differs = np.array([x[max(n, 0)] - x[0] for n in around])
        results.append(x[0] + weights @ differs / weights.sum())

    np.testing.assert_allclose(TapCutter(record).push(frames)[0].samples, results, rtol=0, atol=1e-9)


def test_chosen_taxels_and_the_sensors_rate_are_exported(tmp_path, make_model):
    model = make_model()
    record = replace(model.preprocessing, rate_hz=50.0, sensor_hz=1000.0, taxels=(1, 4))
    save_exported(replace(model, preprocessing=record), tmp_path / "robot.json", DECISIONS)

    assert load_exported(tmp_path / "robot.json").preprocessing == record
    assert not {"sensor_hz", "taxels"} & set(exported(model, DECISIONS, "a")["preprocessing"])
