"""The paper and the citation: what the journal asks for, sources that can be found, numbers of the docs."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
_, FRONT, BODY = (ROOT / "paper" / "paper.md").read_text(encoding="utf-8").split("---\n", 2)
HEAD = yaml.safe_load(FRONT)
BIB = (ROOT / "paper" / "paper.bib").read_text(encoding="utf-8")
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
SECTIONS = (
    "Summary",
    "Statement of need",
    "State of the field",
    "Software design",
    "Research impact statement",
    "AI usage disclosure",
    "Acknowledgements",
    "References",
)
"""Required by the Journal of Open Source Software, by its instructions for authors of May 2026."""


def entries():
    """Fields of every source by its key."""
    found = re.findall(r"^@\w+\{(\S+),\n(.*?)^\}$", BIB, flags=re.MULTILINE | re.DOTALL)
    return {key: dict(re.findall(r"^ +(\w+) += \{(.*)\},?$", text, flags=re.MULTILINE)) for key, text in found}


def numbers(text):
    """Numbers of prose: no formulas, code or keys of sources."""
    prose = re.sub(r"\$\$.*?\$\$|\$[^$]*\$|`[^`]*`|@\w+", "", text)
    return re.findall(r"(?<![\w.])\d+(?:\.\d+)?(?:e-?\d+)?", prose)


def holds(page, number):
    return re.search(rf"(?<![\d.]){re.escape(number)}(?![\d]|\.\d)", page) is not None


def unfounded(line):
    """Numbers of a sentence that none of the pages named in it holds."""
    pages = [(ROOT / name).read_text(encoding="utf-8") for name in re.findall(r"`((?:docs/\S+|README)\.md)`", line)]
    return [number for number in numbers(line) if not any(holds(page, number) for page in pages)]


def test_the_paper_has_the_sections_and_the_length_that_the_journal_asks_for():
    assert [name for name in re.findall(r"^# (.+)$", BODY, flags=re.MULTILINE) if name in SECTIONS] == list(SECTIONS)
    assert 750 <= len(BODY.split()) <= 1750
    assert {"title", "tags", "authors", "affiliations", "date", "bibliography"} == set(HEAD)
    assert {author["affiliation"] for author in HEAD["authors"]} <= {place["index"] for place in HEAD["affiliations"]}


def test_every_source_is_cited_and_every_citation_has_a_source():
    cited = set(re.findall(r"@(\w+)", BODY))

    assert cited == set(entries())
    assert len(re.findall(r"^@", BIB, flags=re.MULTILINE)) == len(entries())


@pytest.mark.parametrize("key", entries())
def test_a_source_can_be_found(key):
    fields = entries()[key]

    assert {"author", "title", "year"} <= set(fields)
    assert {"doi", "url", "booktitle"} & set(fields)
    assert re.fullmatch(r"10\.\d{4,9}/\S+", fields.get("doi", "10.1000/1"))


def test_every_number_is_on_the_page_that_its_sentence_names():
    lines = [line for line in BODY.splitlines() if numbers(line)]

    assert len(lines) >= 5
    assert {line: found for line in lines if (found := unfounded(line))} == {}


def test_a_number_without_its_page_is_found():
    assert unfounded("It takes 83.6 ns.") == ["83.6"]
    assert unfounded("It takes 83.7 ns and 2e-12 (`docs/explanation/checks.md`).") == ["83.7"]


def test_files_that_the_paper_names_exist():
    named = re.findall(r"`([\w/]+\.(?:md|py))`", BODY)

    assert len(named) >= 5
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_citation_metadata_and_paper_agree():
    solid, reference = entries()["lepora2013solid"], CITATION["references"][0]
    authors = [f"{author['family-names']}, {author['given-names']}" for author in reference["authors"]]

    assert CITATION["title"] == HEAD["title"]
    assert CITATION["license"] == PROJECT["license"]
    assert set(CITATION["keywords"]) <= set(PROJECT["keywords"])
    assert [author["name"] for author in CITATION["authors"]] == [author["name"] for author in PROJECT["authors"]]
    assert [author["name"] for author in HEAD["authors"]] == [author["name"] for author in PROJECT["authors"]]
    assert solid["author"] == " and ".join(authors)
    assert solid["title"].translate({ord(c): "" for c in "{}"}).lower() == reference["title"].lower()
    assert solid["year"] == str(reference["year"])
