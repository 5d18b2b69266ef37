"""Relative links and anchors in README, pages beside it and docs lead to what is there; the index lists every page."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
BESIDE = sorted(ROOT.glob("*.md"))
PAGES = [*BESIDE, *sorted(DOCS.rglob("*.md"))]


def prose(page):
    """A page without code, in which brackets are no links."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    return re.sub(r"`[^`\n]*`", "`code`", text)


def links(page):
    """Targets of links and images, other than addresses on the web."""
    targets = re.findall(r"\]\(<?([^)\s>]+)", prose(page))
    return [target for target in targets if "://" not in target and not target.startswith("mailto:")]


def anchors(page):
    """Anchors of the headings, spelt as GitHub spells them."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    found = set()
    for heading in re.findall(r"^#+ +(.+?) *#*$", text, flags=re.MULTILINE):
        plain = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading).lower()
        slug = re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")
        repeats = sum(re.fullmatch(rf"{re.escape(slug)}(-\d+)?", other) is not None for other in found)
        found.add(f"{slug}-{repeats}" if slug in found else slug)
    return found


def broken(page):
    """Links of a page that lead nowhere."""
    for link in links(page):
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            yield link


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_and_anchors_resolve(page):
    assert list(broken(page)) == []


def test_broken_links_and_anchors_are_found(tmp_path):
    other, page = tmp_path / "other.md", tmp_path / "page.md"
    other.write_text("# A `b`, c\n\n## Twice\n\n## Twice\n", encoding="utf-8")
    page.write_text("[a](other.md#a-b-c) [b](other.md#twice-1) `[c](d)` [e](#f) ![g](h.svg)\n", encoding="utf-8")

    assert list(broken(page)) == ["#f", "h.svg"]


def test_index_lists_every_page():
    listed = {(DOCS / link).resolve() for link in links(DOCS / "README.md")}
    pages = {page for page in DOCS.rglob("*.md") if page.parent.name != "decisions"} - {DOCS / "README.md"}

    assert pages - listed == set()


def test_paths_of_docs_exist():
    """Those that code, tests, Makefile and pages name in text."""
    suffixes = {".py", ".pyi", ".md", ".toml", ".sh", ".html"}
    folders = ("models", "hardware", "inference", "analysis", "cli", "solidtouch", "benchmarks", "tests", "docs")
    files = [path for folder in folders for path in (ROOT / folder).rglob("*") if path.suffix in suffixes]
    texts = [path.read_text(encoding="utf-8") for path in [*files, ROOT / "Makefile", *BESIDE]]
    named = {name for text in texts for name in re.findall(r"\bdocs/[\w/.-]+\.\w+", text)}

    assert sorted(name for name in named if not (ROOT / name).exists()) == []
