"""The table in docs/reference/faults.md names every fault once, with a switch that exists and tests that exist."""

import ast
import re
from pathlib import Path

import pytest
from solidtouch.hardware.emulator.faults import FAULTS

HERE = Path(__file__)
PAGE = HERE.parents[3] / "docs" / "reference" / "faults.md"
ALWAYS = {19, 20, 33}


def rows():
    """Number, switches and tests of each row."""
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if cells[0].isdigit():
            number, _, switches, _, tests = cells
            yield int(number), re.findall(r"`(\w+)`", switches), re.findall(r"`(test_\w+)`", tests)


def fault_tests(path):
    return {node.name for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if is_test(node)}


def is_test(node):
    return isinstance(node, ast.FunctionDef) and node.name.startswith("test_fault_")


@pytest.fixture(scope="module")
def all_tests():
    return set().union(*(fault_tests(path) for path in HERE.parent.glob("test_rig_faults_*.py")))


def test_every_row_is_there_once():
    assert [number for number, _, _ in rows()] == list(range(1, 34))


def test_every_switch_is_in_the_row_that_it_says():
    named = {switch: number for number, switches, _ in rows() for switch in switches}

    assert named == {name: fault.number for name, fault in FAULTS.items()}


def test_only_what_is_always_so_has_no_switch():
    assert {number for number, switches, _ in rows() if not switches} == ALWAYS


def test_every_row_has_tests_and_every_test_a_row(all_tests):
    named = [test for _, _, tests in rows() for test in tests]

    assert all(tests for _, _, tests in rows())
    assert set(named) == all_tests


def test_a_test_has_the_number_of_its_row():
    for number, _, tests in rows():
        for test in tests:
            assert number in [int(part) for part in re.findall(r"_(\d\d)(?=_)", test)]
