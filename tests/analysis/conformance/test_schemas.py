"""The JSON Schemas of the kit, by an independent validator: they accept what is written, and refuse mistakes in it."""

import json
from copy import deepcopy

import pytest
from foreign_programs import play
from json_schemas import schema_at
from jsonschema import Draft202012Validator
from solidtouch.analysis.conformance.answers import FIT, OPTIONAL, QUANTITIES
from solidtouch.analysis.conformance.case import FORMAT, LEVELS
from solidtouch.analysis.conformance.catalogue import catalogue, own_kit
from solidtouch.analysis.conformance.dataset.export import STATIC
from solidtouch.analysis.conformance.dataset.version import LICENSE, provenance
from solidtouch.analysis.conformance.formats.as_json import REPORT_FORMAT
from solidtouch.analysis.conformance.mistakes import MISTAKES
from solidtouch.analysis.conformance.report import ConformanceReport
from solidtouch.analysis.conformance.verdict import Verdict
from solidtouch.inference.reference import BORDERS

LARGE = 60_000  # bytes; validators in Python take long over more
EXAMPLES = ("root-j", "fit", "tables", "near-ties", "impossible-later", "episode-uniform-holes")


def complaints(schema, thing):
    return [f"{'/'.join(map(str, error.absolute_path))}: {error.message}"[:200] for error in schema.iter_errors(thing)]


def check_case(schemas, folder, name):
    case = json.loads((folder / f"{name}.json").read_text())
    header, *taps = map(json.loads, (folder / f"{name}.jsonl").read_text().splitlines())

    assert complaints(schemas["case"], case) == []
    assert complaints(schemas["header"], header) == []
    assert [found for tap in taps if (found := complaints(schemas["tap"], tap))] == []


def test_schemas_are_schemas(schemas):
    assert sorted(f"{name}.schema.json" for name in schemas) == sorted(n for n in STATIC if n.endswith(".schema.json"))
    for name, schema in schemas.items():
        Draft202012Validator.check_schema(schema.schema)
        assert schema.schema["$schema"] == "https://json-schema.org/draft/2020-12/schema", name


def test_schemas_find_each_other_by_the_location_of_their_files(schemas, exported):
    """In whatever folder a validator runs; a relative `$id` would be looked for in that one."""
    case = json.loads((exported / "root-j.json").read_text())
    index = json.loads((exported / "index.json").read_text())

    for name, thing in (("case", case), ("index", index), ("report", report())):
        by_location = schema_at(exported / f"{name}.schema.json")
        assert complaints(by_location, thing) == []
        assert complaints(by_location, thing | {"kit": "one", "provenance": {}})
    assert [name for name, schema in schemas.items() if "$id" in schema.schema] == []


def test_exported_files_have_their_schemas(schemas, exported):
    """The index, cases and lines; those of large cases are seen by the slow tests."""
    assert complaints(schemas["index"], json.loads((exported / "index.json").read_text())) == []
    for name in catalogue():
        if (exported / f"{name}.json").stat().st_size < LARGE:
            check_case(schemas, exported, name)


@pytest.mark.slow
def test_large_files_have_their_schemas(schemas, exported):
    large = [name for name in catalogue() if (exported / f"{name}.json").stat().st_size >= LARGE]

    assert large
    for name in large:
        check_case(schemas, exported, name)


def test_a_kit_for_single_precision_has_its_schemas(schemas, tmp_path):
    from solidtouch.analysis.conformance.front import export

    export(tmp_path / "kit", EXAMPLES, precision="single")
    assert complaints(schemas["index"], json.loads((tmp_path / "kit" / "index.json").read_text())) == []
    check_case(schemas, tmp_path / "kit", "root-j")


def test_answers_of_the_foreign_programs_have_the_schema(schemas, exported, program):
    text = "".join((exported / f"{name}.jsonl").read_text() for name in (*EXAMPLES, "fit-outside", "prior-holes"))
    answers = [json.loads(line) for line in play(program, text).stdout.splitlines()]

    assert len(answers) >= 30
    assert {0, 1} <= {answer["tap"] for answer in answers}
    assert any("error" in answer for answer in answers)
    assert [found for answer in answers if (found := complaints(schemas["answer"], answer))] == []


VERDICTS = (
    Verdict("ties", "differs", "its move is +1 instead of +0", 2, "move", "move-sign"),
    Verdict("impossible-tap", "differs", "it says an answer where zero_evidence is due", 1, "error"),
    Verdict("root-jk", "failed", "it ended with exit code 1"),
    Verdict("single-edges", "left out", "32 bits cannot do it"),
    Verdict("root-none", "pass", "it left a process running, which was stopped"),
    Verdict("root-j", "pass", seconds=0.0),
)


def report():
    found = {verdict.case: verdict for verdict in VERDICTS}
    return ConformanceReport("It", found, own_kit(), "single", ("log_evidence",)).as_object()


def test_reports_have_the_schema(schemas):
    assert complaints(schemas["report"], report()) == []


def case(exported, name):
    return json.loads((exported / f"{name}.json").read_text())


def changed(thing, path, value):
    """A thing in which one place has another value, or is gone where that is `...`."""
    thing = deepcopy(thing)
    *way, last = path
    place = thing
    for step in way:
        place = place[step]
    if value is ...:
        del place[last]
    else:
        place[last] = value
    return thing


@pytest.mark.parametrize(
    ("name", "path", "value"),
    [
        ("root-j", ["format"], 2),
        ("root-j", ["case"], "Root J"),
        ("root-j", ["prior"], ...),
        ("root-j", ["prior", 0, 0], -0.1),
        ("root-j", ["prior", 0], 0.2),
        ("root-j", ["border"], "open"),
        ("root-j", ["power"], "K"),
        ("root-j", ["power"], 0),
        ("root-j", ["L"], 0),
        ("root-j", ["M"], 2.5),
        ("root-j", ["thresholds"], []),
        ("root-j", ["fixation"], -1),
        ("root-j", ["counts"], ...),
        ("root-j", ["counts", 0, 0, 0, 0], 0.5),
        ("root-j", ["pseudocount"], ...),
        ("root-j", ["edges"], ...),
        ("root-j", ["edges", 0], "0"),
        ("root-j", ["probabilities"], [[[[1.0]]]]),
        ("tables", ["probabilities", 0, 0, 0, 0], -1e-9),
        ("normal", ["sd"], ...),
        ("normal", ["sd", 0, 0, 0], 0.0),
        ("normal", ["mean", 0, 0], 1.0),
        ("normal", ["counts"], [[[[1]]]]),
        ("info-what", ["strategy"], "info"),
        ("info-what", ["pool"], ...),
        ("info-what", ["pool", 0], [1.0]),
        ("root-j", ["strategy"], "info-what"),
        ("info-what", ["expected", 0, "information", 0], None),
        ("fit", ["training", "where"], ...),
        ("fit", ["edges"], [0.0, 1.0]),
        ("root-j", ["taps", 0, "move"], 0.5),
        ("root-j", ["taps", 1, "samples"], [1.0, 2.0]),
        ("root-j", ["taps"], []),
        ("root-j", ["expected", 0, "posterior"], ...),
        ("root-j", ["expected", 0, "posterior", 0, 0], None),
        ("root-j", ["expected", 0, "what", 0], 1.5),
        ("root-j", ["expected", 0, "log_evidence"], None),
        ("root-j", ["expected", 0, "decisions", 0], -1),
        ("root-j", ["expected", 0, "move"], None),
        ("fit", ["expected", 0, "counts"], ...),
        ("impossible-later", ["expected", -1, "error"], "impossible"),
        ("near-ties", ["expected", 0, "allowed_moves"], [1]),
        ("root-j", ["tolerances", "what"], ...),
        ("root-j", ["tolerances", "what", "absolute"], -1),
        ("root-j", ["level"], "all"),
        ("root-j", ["equations"], [11]),
        ("root-j", ["index_base"], 1),
        ("root-j", ["provenance", "digits"], 16),
        ("root-j", ["provenance", "kit"], "1.0"),
        ("root-j", ["provenance"], ...),
    ],
)
def test_mistakes_in_a_case_are_refused(schemas, exported, name, path, value):
    assert complaints(schemas["case"], case(exported, name)) == []
    assert complaints(schemas["case"], changed(case(exported, name), path, value))


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (["kit"], "one"),
        (["passed"], None),
        (["without"], ["counts"]),
        (["levels", 0, "level"], "all"),
        (["levels", 0, "passed"], -1),
        (["levels", 0, "passes"], ...),
        (["cases", 0, "status"], "wrong"),
        (["cases", 0, "sentence"], ...),
        (["cases", 0, "quantity"], "belief"),
        (["cases", 0, "cause"], "bad-luck"),
        (["cases", 0, "about_cause"], ...),
        (["cases", 0, "hint"], "no such key"),
        (["cases", 5, "tap"], 1),
        (["cases", 5, "seconds"], -0.1),
        (["sentences"], []),
    ],
)
def test_mistakes_in_a_report_are_refused(schemas, path, value):
    assert complaints(schemas["report"], changed(report(), path, value))


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (["license"], "MIT"),
        (["released"], "today"),
        (["levels", "core"], ...),
        (["cases", 0, "files"], ["root-j.json"]),
        (["cases", 0, "files", 1], "../root-j.jsonl"),
        (["cases", 0, "taps"], 0),
    ],
)
def test_mistakes_in_an_index_are_refused(schemas, exported, path, value):
    index = json.loads((exported / "index.json").read_text())
    assert complaints(schemas["index"], changed(index, path, value))


def properties(schema):
    return set(schema["properties"])


def test_schemas_know_the_words_of_the_code(schemas):
    """So that a new border, level, quantity, status or mistake is one for them as well."""
    header, tap, answer, whole, index, verdicts = (
        schemas[name].schema for name in ("header", "tap", "answer", "case", "index", "report")
    )
    given = header["properties"]
    one = verdicts["properties"]["cases"]["items"]["properties"]

    assert given["format"]["const"] == index["properties"]["format"]["const"] == FORMAT
    assert verdicts["properties"]["format"]["const"] == REPORT_FORMAT
    assert given["border"]["enum"] == list(BORDERS)
    assert whole["properties"]["level"]["enum"] == index["properties"]["levels"]["required"] == list(LEVELS)
    assert whole["$defs"]["provenance"]["required"] == list(provenance())
    assert index["properties"]["license"]["const"] == LICENSE
    compared = [name for name in QUANTITIES if name not in FIT]
    assert properties(answer["else"]["else"]) == set(compared)
    assert answer["else"]["else"]["required"] == [name for name in compared if name not in (*OPTIONAL, "information")]
    assert answer["else"]["then"]["required"] == list(FIT)
    assert verdicts["properties"]["without"]["items"]["enum"] == compared
    assert one["quantity"]["enum"] == [*QUANTITIES, "error"]
    assert one["cause"]["enum"] == [mistake.name for mistake in MISTAKES]
    assert set(one) == set().union(*report()["cases"])
    assert properties(tap) == {"tap", "move", "samples"}


def test_schemas_describe_every_key_that_is_written(schemas, exported):
    """And require those that all files have; an export writes no key that has no description."""
    cases = [json.loads((exported / f"{name}.json").read_text()) for name in catalogue()]
    header, whole = schemas["header"].schema, schemas["case"].schema
    written = set().union(*cases)
    always = set(cases[0]).intersection(*cases)

    assert properties(header) | properties(whole) == written
    assert set(header["required"]) | set(whole["required"]) == always
    assert set(whole["properties"]["tolerances"]["required"]) == set(cases[0]["tolerances"])
    index = json.loads((exported / "index.json").read_text())
    assert set(schemas["index"].schema["required"]) == properties(schemas["index"].schema) == set(index)
    assert set(schemas["report"].schema["required"]) == properties(schemas["report"].schema) == set(report())
