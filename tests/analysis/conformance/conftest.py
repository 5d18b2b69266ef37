"""The foreign programs, and cases with the right answers."""

import json

import pytest
from foreign_programs import FOLDER, STRICT, cases, compile_c, long_case, node, with_answers
from jsonschema import Draft202012Validator
from referencing import Registry, Resource

import solidtouch as st


@pytest.fixture(scope="session")
def solid_c(tmp_path_factory):
    return compile_c(FOLDER / "solid.c", tmp_path_factory.mktemp("c") / "solid", "-O2", *STRICT)


@pytest.fixture(params=["c", "js"])
def program(request):
    """The command of each program."""
    return request.getfixturevalue("solid_c") if request.param == "c" else [*node(), str(FOLDER / "solid.js")]


@pytest.fixture(scope="session")
def exported(tmp_path_factory):
    """The whole kit as files; tests read it only."""
    folder = tmp_path_factory.mktemp("exported") / "kit"
    st.conformance.export(folder)
    return folder


@pytest.fixture(scope="session")
def schemas(exported):
    """A validator for each schema, by name; they refer to each other by the names of their files."""
    found = {path.name: json.loads(path.read_text()) for path in exported.glob("*.schema.json")}
    resources = [(name, Resource.from_contents(schema)) for name, schema in found.items()]
    registry = Registry().with_resources(resources)
    return {
        name.removesuffix(".schema.json"): Draft202012Validator(schema, registry=registry)
        for name, schema in found.items()
    }


@pytest.fixture(scope="session")
def kit():
    return with_answers(cases())


@pytest.fixture(scope="session")
def long_kit():
    return with_answers([long_case()])
