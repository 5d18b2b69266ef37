"""The kit as files."""

import json

import numpy as np
import pytest
from solidtouch.analysis.conformance.case import LEVELS
from solidtouch.analysis.conformance.catalogue import catalogue, expected, own_kit
from solidtouch.analysis.conformance.dataset import export
from solidtouch.analysis.conformance.dataset.export import export_kit
from solidtouch.analysis.conformance.run import Asked, check_answers
from solidtouch.analysis.conformance.tolerance import needs_double
from solidtouch.models.errors import InputError

NAMES = ("root-j", "empty-bins-as-printed", "near-ties", "fit", "impossible-later", "single-edges")


def cases(names=NAMES):
    return [catalogue()[name] for name in names]


def test_files_hold_the_case_and_its_right_answers(tmp_path):
    """Numbers come back as the same doubles, minus infinity as null."""
    export_kit(tmp_path / "kit", own_kit(), cases())
    for case in cases():
        whole = json.loads((tmp_path / "kit" / f"{case.name}.json").read_text())
        lines = [json.loads(line) for line in (tmp_path / "kit" / f"{case.name}.jsonl").read_text().splitlines()]

        assert whole | lines[0] == whole
        assert whole["taps"] == lines[1:]
        np.testing.assert_array_equal([tap["samples"] for tap in whole["taps"]], case.taps)
        assert [line["tap"] for line in whole["expected"]] == [answer.tap for answer in expected(case)]
        for line, answer in zip(whole["expected"], expected(case), strict=True):
            if answer.error is None and answer.tap:
                np.testing.assert_array_equal(line["posterior"], answer.values["posterior"])
                given = np.array(line["log_likelihood"], dtype=np.float64)
                np.testing.assert_array_equal(np.isnan(given), np.isneginf(answer.values["log_likelihood"]))


def test_conventions_stand_in_every_file(tmp_path):
    """Version, index base, numbers and logarithms, so that a file explains itself."""
    export_kit(tmp_path / "kit", own_kit(), cases())
    for name in (*NAMES, "index"):
        whole = json.loads((tmp_path / "kit" / f"{name}.json").read_text())
        assert [whole[key] for key in ("format", "index_base", "numbers", "logarithms")] == [
            1,
            0,
            "IEEE 754 binary64",
            "natural",
        ]


def test_choices_are_listed_where_there_are_several(tmp_path):
    export_kit(tmp_path / "kit", own_kit(), cases())
    near = json.loads((tmp_path / "kit" / "near-ties.json").read_text())["expected"][0]
    clear = json.loads((tmp_path / "kit" / "root-j.json").read_text())["expected"][0]

    assert near["allowed_decisions"] == [[0, 1], [0, 1]]
    assert len(near["allowed_moves"]) == 3
    assert not {"allowed_decisions", "allowed_moves"} & set(clear)


def test_the_right_answers_pass_as_answers(tmp_path):
    """The lines of `expected` are what `check --answers` reads."""
    export_kit(tmp_path / "kit", own_kit(), cases())
    (tmp_path / "answers").mkdir()
    for case in cases():
        right = json.loads((tmp_path / "kit" / f"{case.name}.json").read_text())["expected"]
        (tmp_path / "answers" / f"{case.name}.jsonl").write_text("".join(f"{json.dumps(line)}\n" for line in right))

    assert {verdict.status for verdict in check_answers(tmp_path / "answers", cases(), Asked())} == {"pass"}


def test_an_index_lists_the_cases_that_the_precision_can_do(tmp_path):
    assert export_kit(tmp_path / "kit", own_kit(), cases(), "single") == 5
    index = json.loads((tmp_path / "kit" / "index.json").read_text())

    assert index["precision"] == "single"
    assert [entry["case"] for entry in index["cases"]] == [name for name in NAMES if name != "single-edges"]
    assert {path.stem for path in (tmp_path / "kit").glob("*.jsonl")} == {entry["case"] for entry in index["cases"]}
    assert index["levels"] == {level: own_kit().sizes[level] for level in LEVELS}
    case = catalogue()["single-edges"]
    (left_out,) = index["left_out"]
    assert (left_out["case"], left_out["reason"]) == (case.name, needs_double(case, expected(case)))


def test_arrays_hold_the_case_and_its_right_answers(tmp_path, monkeypatch):
    """Every answer of every tap, as in the JSON, where any case counts as large."""
    monkeypatch.setattr(export, "_LARGE", 0)
    case = catalogue()["root-j"]
    export_kit(tmp_path / "kit", own_kit(), [case])
    right = [answer for answer in expected(case) if "posterior" in answer.values]
    with np.load(tmp_path / "kit" / "root-j.npz") as arrays:
        np.testing.assert_array_equal(arrays["taps"], case.taps)
        np.testing.assert_array_equal(arrays["expected_tap"], [answer.tap for answer in right])
        assert {"expected_posterior", "expected_log_likelihood", "expected_move"} <= set(arrays)
        for name in right[0].values:
            np.testing.assert_array_equal(arrays[f"expected_{name}"], [answer.values[name] for answer in right])


@pytest.mark.slow
def test_large_cases_come_as_arrays_too(tmp_path):
    case = catalogue()["episode-paper-size"]
    export_kit(tmp_path / "kit", own_kit(), [case])
    with np.load(tmp_path / "kit" / "episode-paper-size.npz") as arrays:
        np.testing.assert_array_equal(arrays["taps"], case.taps)
        np.testing.assert_array_equal(arrays["expected_tap"], np.arange(len(case.taps)) + 1)
        assert (arrays["border"], arrays["index_base"], arrays["theta_x"]) == (case.border, 0, case.theta_x)
        assert arrays["tolerance_posterior"].shape == (2,)
        np.testing.assert_array_equal(arrays["expected_posterior"][-1], expected(case)[-1].values["posterior"])


def test_an_existing_folder_is_kept(tmp_path):
    (tmp_path / "kit").mkdir()
    (tmp_path / "kit" / "mine").write_text("x")
    with pytest.raises(InputError, match="--force"):
        export_kit(tmp_path / "kit", own_kit(), cases())

    assert [path.name for path in (tmp_path / "kit").iterdir()] == ["mine"]
