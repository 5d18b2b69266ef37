"""The pages of the site in their order: README, docs, notebooks, and what is generated.

docs/README.md is the table of contents: its headings are the sections, its lists their pages.
"""

import re
from pathlib import Path
from typing import NamedTuple

from benchmarks.site.api import api_pages, with_links_to_names
from benchmarks.site.command_pages import FOLDER, command_pages
from benchmarks.site.gallery import gallery
from benchmarks.site.links import PICTURES, ROOT, in_repository, linked, relative
from benchmarks.site.sources import source_page, source_place

CONTENTS = "docs/README.md"
PROJECT = {
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
    "CODE_OF_CONDUCT.md": "code-of-conduct.md",
    "analysis/conformance/dataset/RULES.md": "reference/conformance/rules.md",
}
"""Staged paths of pages beside the README, which are in no section."""
_NAMES = {"README.md": "index.md", CONTENTS: "contents.md"} | PROJECT
_FOLDERS = {"Tutorials": "tutorials", "How to": "how-to", "Notebooks": "notebooks", "Reference": "reference"} | {
    "Explanation": "explanation",
    "Decisions": "decisions",
}
_GENERATED = {"Reference": {f"{FOLDER}/index.md": "[Command line]: every command with its options and exit codes."}}
"""Pages of a section that the repository does not hold."""
_READ_BY_NOTEBOOKS = ("docs/reference/conformance/solid.c",)


class Section(NamedTuple):
    """A section of the table of contents: its items as Markdown, and the pages in the repository that they link to."""

    name: str
    items: tuple[str, ...]
    pages: tuple[str, ...]


def documents() -> dict[str, str]:
    """Staged path of every page that the repository holds."""
    found = [*(ROOT / "docs").rglob("*.md"), *(ROOT / "docs" / "notebooks").glob("*.py")]
    names = ["README.md", *PROJECT, *sorted(path.relative_to(ROOT).as_posix() for path in found)]
    return {name: _NAMES.get(name, name.removeprefix("docs/").replace("README.md", "index.md")) for name in names}


def sections() -> list[Section]:
    """Sections of the table of contents, in its order."""
    text = (ROOT / CONTENTS).read_text(encoding="utf-8")
    made = []
    for name, body in re.findall(r"^## (.+?)\n(.*?)(?=^## |\Z)", text, flags=re.MULTILINE | re.DOTALL):
        items = tuple(re.findall(r"^- .+$", body, flags=re.MULTILINE))
        targets = [re.findall(r"\]\(([^)]+)\)", item)[0] for item in items]
        made.append(Section(name, items, tuple(in_repository(ROOT / CONTENTS, target) for target in targets)))
    return made


class Staged(NamedTuple):
    """What the site is made of: text of pages by their staged paths, and the files that they show or read."""

    pages: dict[str, str]
    files: dict[str, Path]


def staged(folder: Path) -> Staged:
    """All pages of the site.

    Args:
        folder: Where they will be; pages of sources include files relative to it.
    """
    known = documents()
    files: dict[str, Path] = {}
    sources: set[str] = set()
    pages = {}
    for name, path in known.items():
        text = (ROOT / name).read_text(encoding="utf-8")

        def place(target: str, name: str = name) -> str:
            file = in_repository(ROOT / name, target)
            if file == "docs":
                return known[CONTENTS]
            if file in known:
                return known[file]
            if Path(file).suffix in PICTURES:
                files[file.removeprefix("docs/")] = ROOT / file
                return file.removeprefix("docs/")
            sources.add(file)
            return source_place(file)

        pages[path] = linked(text, Path(path).parent.as_posix(), place)
    files |= {file.removeprefix("docs/"): ROOT / file for file in _READ_BY_NOTEBOOKS}
    pages["reference/api.md"] = with_links_to_names(pages["reference/api.md"])
    pages |= api_pages() | command_pages() | {"gallery.md": gallery(known)}
    pages |= {source_place(name): source_page(name, sources, folder) for name in sources}
    pages |= _section_pages(known)
    pages["decisions/index.md"] += _toctree(sorted(path for path in known.values() if _is_decision(path)))
    pages["index.md"] += _toctree([f"{_FOLDERS[section.name]}/index" for section in sections()] + ["gallery"])
    for path in (known[CONTENTS], *PROJECT.values(), *map(source_place, sources)):
        pages[path] = f"---\norphan: true\n---\n\n{pages[path]}"
    return Staged(pages, files)


def _section_pages(known: dict[str, str]) -> dict[str, str]:
    """The page of each section that lists its pages, but of one that has such a page."""
    made = {}
    for section in sections():
        folder = _FOLDERS[section.name]
        path = f"{folder}/index.md"
        own = _GENERATED.get(section.name, {})
        pages = [*own, *(known[page] for page in section.pages)]
        if path in known.values():
            continue
        items = [item.replace("- [", "[", 1) for item in section.items]
        lines = [linked(item, folder, lambda target: known[in_repository(ROOT / CONTENTS, target)]) for item in items]
        shown = [text.replace("]", f"]({relative(page, folder)})", 1) for page, text in own.items()]
        lines = [*shown, *lines]
        made[path] = "\n".join([f"# {section.name}", "", *(f"- {line}" for line in lines), "", _toctree(pages)])
    return made


def _is_decision(path: str) -> bool:
    return path.startswith("decisions/") and path != "decisions/index.md"


def _toctree(names: list[str]) -> str:
    return "\n".join(["", "```{toctree}", ":hidden:", "", *(f"/{name}" for name in names), "```", ""])
