"""Reference posteriors in Python, and JSON Schemas of their files and of draws."""

import gzip
import json
import re
from copy import deepcopy
from pathlib import Path

import arviz as az
import numpy as np
import pytest
import xarray as xr
from json_schemas import schema_at
from jsonschema import Draft202012Validator
from solidtouch.analysis.posteriors import catalogue, files
from solidtouch.analysis.posteriors.files import read_draws
from solidtouch.models.measurement.registry import NAMES

import solidtouch as st

DATA = Path(catalogue.__file__).parent / "data"
FOUND = {path.name.split(".")[0]: json.loads(path.read_text()) for path in DATA.glob("*.schema.json")}
SCHEMAS = {name: schema_at(DATA / f"{name}.schema.json") for name in FOUND}


@pytest.fixture
def gaussian():
    return st.conformance.reference_posterior("gaussian")


# Schemas
def test_schemas_are_schemas():
    assert set(SCHEMAS) == {"data", "draws", "posterior"}
    for schema in FOUND.values():
        Draft202012Validator.check_schema(schema)
        assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
        assert "$id" not in schema  # by which others would not be found beside it


def test_the_version_is_that_of_the_folder():
    assert f"Version {catalogue.VERSION} (" in (DATA / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", NAMES)
def test_files_and_draws_have_their_schemas(name):
    draws = st.conformance.reference_posterior(name).draws
    chains = [{number: values[chain].tolist() for number, values in draws.items()} for chain in range(2)]

    SCHEMAS["posterior"].validate(json.loads((DATA / f"{name}.json").read_text()))
    SCHEMAS["data"].validate(json.loads((DATA / f"{name}.data.json").read_text()))
    SCHEMAS["draws"].validate(chains)


@pytest.mark.parametrize(
    ("schema", "keys", "value"),
    [
        ("posterior", ["format"], 2),
        ("posterior", ["method"], "nuts"),
        ("posterior", ["diagnostics"], {}),
        ("posterior", ["parameters", "level"], "L,M"),
        ("posterior", ["summary"], []),
        ("posterior", ["summary", 0, "name"], "level.0"),
        ("posterior", ["summary", 0, "scale"], "is"),
        ("posterior", ["summary", 0, "variance"], 0),
        ("posterior", ["summary", 0, "mcse_mean"], 0.1),
        ("posterior", ["summary", 0, "sd"], 1.0),
        ("data", ["L"], 0),
        ("data", ["where", 0], 0),
        ("data", ["taps", 0, 0], 1.0),
        ("data", ["prior", "a"], "2"),
        ("data", ["basis"], [[1.0]]),
        ("data", ["tap"], []),
    ],
)
def test_mistakes_in_files_are_refused(schema, keys, value):
    whole = json.loads((DATA / f"gaussian.{'data.' * (schema == 'data')}json").read_text())
    *path, last = keys
    part = whole
    for key in path:
        part = part[key]
    part[last] = value

    assert not SCHEMAS[schema].is_valid(whole)


# Draws
def test_draws_as_json_are_those_of_the_csv_files(gaussian, tmp_path):
    chains = [{number: values[chain].tolist() for number, values in gaussian.draws.items()} for chain in range(10)]
    (tmp_path / "draws.json.gz").write_bytes(gzip.compress(json.dumps(chains).encode()))
    found = read_draws([tmp_path / "draws.json.gz"])

    np.testing.assert_equal(found, gaussian.draws)
    assert st.conformance.judge_draws("gaussian", [tmp_path / "draws.json.gz"]).status == "pass"


@pytest.mark.parametrize(
    "draws", [{}, [], [{}], [{"a": 1.0}], [{"a": [[1.0]]}], [{"a": ["x"]}], [{"a": [None]}], [[1.0]]], ids=repr
)
def test_the_schema_and_the_reader_refuse_the_same_draws(draws, tmp_path):
    (tmp_path / "draws.json").write_text(json.dumps(draws))

    assert not SCHEMAS["draws"].is_valid(draws)
    with pytest.raises(st.InputError, match=r"draws\.json"):
        read_draws([tmp_path / "draws.json"])


def structured(draws):
    """Parameters as arrays, with an axis of length 1 as NumPyro's plates have them."""
    return {
        word: np.stack([values for name, values in draws.items() if name.startswith(word)], axis=-1).reshape(
            10, 100, 3, 2, 1, 2
        )
        for word in ("level", "variance")
    }


def labelled(draws):
    dims = ("l", "m", "one", "k", "draw", "chain")
    return xr.Dataset({name: (dims, np.moveaxis(v, [0, 1], [-1, -2])) for name, v in structured(draws).items()})


@pytest.mark.parametrize(
    "form",
    [
        dict,
        structured,
        labelled,
        lambda draws: az.from_dict({"posterior": structured(draws)}),
        lambda _: str(DATA / "gaussian.csv.gz"),
    ],
    ids=["numbers", "arrays", "xarray", "arviz", "path"],
)
def test_draws_in_any_form_have_the_same_verdict(gaussian, form):
    right = st.conformance.judge_draws("gaussian", gaussian.draws)

    assert right.status == "pass"
    assert st.conformance.judge_draws("gaussian", form(gaussian.draws)) == right


@pytest.mark.parametrize(
    ("draws", "sentence"),
    [
        (3, "Draws must be arrays by name, an xarray data set or files, not int."),
        ({"level": np.zeros(9)}, r"Draws of level have shape \(9,\) instead of \(chain, draw, ...\)."),
        ({"level": [["a"]]}, "Draws of level are not real numbers of shape"),
        ({"level": [[1j]]}, "Draws of level are not real numbers of shape"),
        ({"level": [[1.0], [1.0, 2.0]]}, "Draws of level are not real numbers of shape"),
        ({"level": np.zeros((2, 9)), "variance": np.zeros((2, 8))}, "different numbers of chains or of draws"),
        ({"level[1]": np.zeros((2, 9)), "level.1": np.zeros((2, 9))}, "has level.1 twice"),
        ({"level": np.zeros((0, 9, 3, 2, 2))}, "too few: 0 chains of 9 draws; at least one chain of 4 draws is due"),
        ([1, 2], "files, not list"),
        ({}, "The draws, 0 chains of 0 draws, have no number level.1.1.1."),
        ({"level": np.zeros((900, 3, 2, 2))}, "900 chains of 3 draws, have no number level.1.1.1, only level.1.1,"),
        (xr.Dataset({"level": ("draw", np.zeros(9))}), "has no variables with the dims chain and draw"),
        ([], "no file"),
    ],
)
def test_other_objects_are_refused(draws, sentence):
    with pytest.raises(st.InputError, match=sentence):
        st.conformance.judge_draws("gaussian", draws)


@pytest.mark.parametrize(("name", "opened"), [("draws.csv", open), ("draws.csv.gz", gzip.open)])
def test_files_beyond_256_mib_are_not_read(name, opened, tmp_path, monkeypatch):
    """Nor unpacked, nor devices without an end."""
    monkeypatch.setattr(files, "_MOST_BYTES", 1 << 20)
    path = tmp_path / name
    with opened(path, "wb") as file:
        file.write(bytes((1 << 20) + 1))

    with pytest.raises(st.InputError, match=f"{re.escape(str(path))} is larger than 1 MiB, the most"):
        st.conformance.judge_draws("gaussian", path)


def test_a_name_that_is_no_text_is_refused():
    with pytest.raises(st.InputError, match=r"There is no reference posterior '\[\]'; choose from histogram, "):
        st.conformance.reference_posterior([])


def test_a_reference_is_not_changed_by_its_reader(gaussian):
    before = deepcopy(gaussian.data)
    gaussian.data["taps"][:] = 0
    gaussian.draws["level.1.1.1"][:] = 0

    np.testing.assert_equal(gaussian.data, before)
    assert st.conformance.judge_draws("gaussian", gaussian.draws).status == "pass"
