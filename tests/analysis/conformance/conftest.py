"""The foreign programs, and cases with the right answers."""

import pytest
from foreign_programs import FOLDER, STRICT, cases, compile_c, long_case, node, with_answers


@pytest.fixture(scope="module")
def solid_c(tmp_path_factory):
    return compile_c(FOLDER / "solid.c", tmp_path_factory.mktemp("c") / "solid", "-O2", *STRICT)


@pytest.fixture(params=["c", "js"])
def program(request):
    """The command of each program."""
    return request.getfixturevalue("solid_c") if request.param == "c" else [*node(), str(FOLDER / "solid.js")]


@pytest.fixture(scope="module")
def kit():
    return with_answers(cases())


@pytest.fixture(scope="module")
def long_kit():
    return with_answers([long_case()])
