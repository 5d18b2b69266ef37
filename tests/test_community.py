"""Files for people who contribute, cite or review: what they say of the code is there, and machines can read them."""

import re
from collections import Counter
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
TEMPLATES = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"))
FORMS = [path for path in TEMPLATES if path.name != "config.yml"]
INPUTS = {"input", "textarea", "dropdown", "checkboxes", "markdown"}


def read(name):
    return (ROOT / name).read_text(encoding="utf-8")


def test_there_are_forms_for_bugs_numbers_and_questions():
    assert {path.stem for path in FORMS} == {"bug", "wrong-number", "question"}
    assert yaml.safe_load(read(".github/ISSUE_TEMPLATE/config.yml")) == {"blank_issues_enabled": True}


@pytest.mark.parametrize("path", FORMS, ids=lambda path: path.stem)
def test_a_form_asks_something_once(path):
    """Keys are those of the platform; each field has a label and an id of its own, and one must be filled in."""
    form = yaml.safe_load(path.read_text(encoding="utf-8"))
    body = form["body"]
    ids = [field["id"] for field in body]

    assert set(form) == {"name", "description", "labels", "body"}
    assert {field["type"] for field in body} <= INPUTS
    assert len(ids) == len(set(ids))
    assert all(field["attributes"]["label"] for field in body)
    assert any(field.get("validations", {}).get("required") for field in body)


@pytest.mark.parametrize("name", ["CONTRIBUTING.md", ".github/PULL_REQUEST_TEMPLATE.md"])
def test_make_targets_that_are_named_exist(name):
    targets = re.findall(r"^([\w-]+):", read("Makefile"), flags=re.MULTILINE)
    named = re.findall(r"(?:^|`|; )make ([\w-]+)", read(name), flags=re.MULTILINE)

    assert len(named) >= 2
    assert set(named) <= set(targets)


def test_contributing_fits_on_a_screen_and_names_what_the_code_has():
    text = read("CONTRIBUTING.md")

    assert len(text.splitlines()) <= 45
    for name, file in {
        "KINDS": "models/measurement/registry.py",
        "MODEL = Story(": "models/measurement/gaussian.py",
        "KIT_VERSION": "analysis/conformance/dataset/version.py",
        "yield make(": "analysis/conformance/cases/moves.py",
        "SensorSettings": "hardware/rig/settings.py",
        "make_skin": "hardware/skin/fingertip.py",
    }.items():
        assert name in text
        assert name in read(file)
    assert "_OPENERS" in read("models/io/layouts/formats/registry.py")


def test_the_review_page_counts_its_items_and_names_files_that_exist():
    text = read("docs/reference/review-checklist.md")
    stands = Counter(re.findall(r"^\| .+? \| (\w+) \| .+ \|$", text, flags=re.MULTILINE))
    counts = {"met": "are met,", "partly": "are met partly", "fails": "fail,", "authors": "are for the authors"}

    del stands["stands"]
    assert set(stands) == set(counts)
    assert f"Of {stands.total()} items" in text
    assert [word for name, word in counts.items() if f"{stands[name]} {word}" not in text] == []
    assert [name for name in re.findall(r"`([\w./-]+/[\w.-]+)`", text) if not (ROOT / name).exists()] == []
