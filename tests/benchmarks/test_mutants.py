"""The errors that `make mutants` plants, and that it tells caught ones from survivors."""

import ast
import json
from pathlib import Path

import pytest

from benchmarks.checks import mutants, mutation

ROOT = Path(__file__).parents[2]
SOURCE = '''"""A docstring with 1 < 2."""

from math import inf

_LIMIT = 3


def count(values: list[int], least: int = 2, *, deep: bool = False) -> "int | float":
    """Not changed: 5 > 4."""
    if not values:
        raise ValueError(f"{least + 1} values are needed.", 7)
    total = max(0, min(values) - least)
    total += values[-1]
    values.append(total)
    return total if deep and total >= least else inf
'''


def test_errors_are_planted_in_code_alone():
    """One change each, valid Python, and nothing in text, annotations, messages or named constants."""
    found = list(mutation.mutants("models/count.py", SOURCE))
    assert {(one.old, one.new) for one in found} == {
        ("2", "3"),
        ("2", "1"),
        ("False", "True"),
        ("not values", "values"),
        ("max", "min"),
        ("min", "max"),
        ("0", "1"),
        ("min(values) - least", "(min(values) + least)"),
        ("total += values[-1]", "total -= values[-1]"),
        ("total += values[-1]", "pass"),
        ("-1", "1"),
        ("1", "2"),
        ("1", "0"),
        ("values.append(total)", "pass"),
        ("total if deep and total >= least else inf", "(inf if deep and total >= least else total)"),
        ("deep and total >= least", "(deep or total >= least)"),
        ("total >= least", "(total > least)"),
    }
    assert len({one.key for one in found}) == len(found)
    for one in found:
        planted = one.planted(SOURCE)
        assert ast.dump(ast.parse(planted)) != ast.dump(ast.parse(SOURCE))
        assert planted.count("\n") == SOURCE.count("\n")


def test_an_edit_elsewhere_keeps_the_names_of_errors():
    """So that a sample and its results outlive other changes."""
    before = {one.key for one in mutation.mutants("models/count.py", SOURCE)}
    after = {one.key for one in mutation.mutants("models/count.py", SOURCE + "\n\ndef more(a):\n    return a + 1\n")}
    assert before < after


def test_samples_grow_and_mix_kinds():
    """The first of many are those of a small one; no figure, and all packages take part."""
    few, many = (mutants.sample(number, "l.py") for number in (20, 120))
    assert many[:20] == few
    assert len({one.kind for one in few}) > 10
    assert {one.module.partition("/")[0] for one in many} == {"models", "hardware", "inference", "analysis"}
    assert not [one for one in many if "figure" in one.module]
    assert all(one.module.endswith("l.py") for one in many)


@pytest.mark.slow
def test_tests_of_a_module_come_first():
    """The mirrored file, then those that import the module, also through helpers, then those of its users.

    Loops need caches of their own.
    """
    tests = mutants.Tests()
    own, later = tests.of("hardware.skin.monitor")
    assert own[0].name == "test_monitor.py"
    assert later
    assert not set(own) & set(later)
    assert "test_resets.py" in {test.name for test in tests.of("hardware.emulator.grbl.controller")[0]}
    assert {"inference.trials.kernel", "models.measurement.likelihood.counting"} <= tests.frozen
    assert "hardware.skin.monitor" not in tests.frozen


@pytest.mark.slow
def test_a_caught_error_is_told_from_a_survivor(tmp_path):
    """A limit that is checked where it should not be is noticed, a pair of parentheses is not."""
    module = "hardware/skin/monitor.py"
    found = mutation.mutants(module, (ROOT / module).read_text(encoding="utf-8"))
    caught = next(one for one in found if one.kind == "removed sign or not")
    harmless = caught._replace(old=caught.old, new=f"({caught.old})", key="0" * 12)
    mutants.judge_all([caught, harmless], tmp_path / "results.jsonl", 2, 60.0)
    rows = mutants._known(tmp_path / "results.jsonl")

    assert rows[caught.key]["outcome"] == "caught"
    assert rows[caught.key]["test"].startswith("tests/hardware/skin/test_monitor.py::")
    assert rows[harmless.key]["outcome"] == "survived"
    table = mutants.report(list(rows.values()), {harmless.key: "Parentheses."})
    assert "| hardware | 2 | 1 | 0 | 1 | 0 | 1.000" in table
    assert "| Parentheses. |" in table


def test_the_table_tells_first_results_from_those_after_new_tests(tmp_path):
    """A survivor that a new test catches counts as caught now, not at first."""
    mutant = next(mutation.mutants("models/count.py", SOURCE))
    results = tmp_path / "results.jsonl"
    results.write_text("".join(json.dumps(mutant._asdict() | {"outcome": o}) + "\n" for o in ("survived", "caught")))
    (line,) = [line for line in mutants.report([*mutants._known(results).values()], {}).splitlines() if "| all" in line]

    assert line.startswith("| all | 1 | 1 | 0 | 0 | 0 | 0.000")
    assert "| 1.000" in line
