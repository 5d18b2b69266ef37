"""The site holds every page, public name, command and figure, and its links lead to them."""

import ast
import importlib.util
import inspect
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import typer.main
from slow_cases import slow_but
from solidtouch.cli import main
from solidtouch.cli.shared.interrupt import INTERRUPTED, TERMINATED

import solidtouch as st
from benchmarks.site import exit_codes, gallery
from benchmarks.site.command_pages import FOLDER, path
from benchmarks.site.commands import commands
from benchmarks.site.episode import OUT, SECONDS
from benchmarks.site.links import ROOT, linked
from benchmarks.site.manual import manual, roff
from benchmarks.site.pages import PROJECT, documents, staged

NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.py"))


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    return staged(tmp_path_factory.mktemp("pages")).pages


@pytest.fixture(scope="module")
def read():
    """Options of each command as Typer has them, by its words."""

    def walk(command, words):
        options = (param for param in command.params if param.param_type_name == "option")
        yield words, {name for param in options for name in (*param.opts, *param.secondary_opts)}
        for name, part in getattr(command, "commands", {}).items():
            yield from walk(part, (*words, name))

    return dict(walk(typer.main.get_command(main.app), ()))


def test_every_page_is_in_the_table_of_contents_once(pages):
    """But sources, pages beside the README and the flat list of pages, which are reached by links."""
    listed = []
    for text in pages.values():
        for block in re.findall(r"^```\{toctree\}\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL):
            listed += [name.lstrip("/") for name in block.split() if not name.startswith(":")]
    base = {path: Path(path).parent.as_posix() for path in pages}
    names = {re.sub(r"\.(md|py)$", "", name) for name in listed}
    here = {name.removeprefix(f"{FOLDER}/") for name in names}
    orphans = {page for page, text in pages.items() if text.startswith("---\norphan")}

    assert {page for page in pages if page.startswith("source/")} | {"contents.md", *PROJECT.values()} == orphans
    assert len(listed) == len(set(listed))
    for page in set(pages) - orphans - {"index.md"}:
        name = re.sub(r"\.(md|py)$", "", page)
        assert name in names | {f"reference/{one}" for one in names} | {f"{FOLDER}/{one}" for one in here}, base[page]


def test_every_public_name_has_a_page_and_a_link_to_it(pages):
    for name in set(st.__all__):
        assert f"solidtouch.{name}" in pages[f"reference/api/{name}.md"]
        assert f"(api/{name}.md)" in pages["reference/api.md"], name


def test_every_command_and_option_has_its_place(pages, read):
    every = commands()
    man = manual()

    assert {command.words for command in every} == set(read)
    for command in every[1:]:
        text = pages[path(command)]
        shown = " ".join(re.findall(r"^```\{option\} (.+)$", text, flags=re.MULTILINE))
        assert set(re.findall(r"(?<![\w|-])--[\w-]+", shown)) == read[command.words]
        page = man[f"{command.name.replace(' ', '-')}.1"].replace("\\-", "-")
        assert read[command.words] <= set(re.findall(r"--[\w-]+", page))


def test_a_command_is_described_as_it_is_called():
    fit = next(command for command in commands() if command.words == ("fit",))
    border = next(o for c in commands() if c.words == ("perceive",) for o in c.options if "--border" in o.names)

    assert fit.usage == "solidtouch fit --out PATH [OPTIONS] DATA..."
    assert (border.choices[0], border.default, border.required) == ("uniform", "uniform", False)


def test_exit_codes_are_those_of_the_program():
    """Codes of `run` and of interrupts; those commands whose code ends with 1, or whose options say so."""
    refused = set(re.findall(r"_refuse\(.*?, (\d)\)", inspect.getsource(main.run)))
    failing = set()
    for command in commands():
        file = ROOT / "cli" / f"{(command.words or ('main',))[0].replace('-', '_')}.py"
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            name = command.words[-1].replace("-", "_") if command.words else ""
            if isinstance(node, ast.FunctionDef) and node.name in {name, f"{name}_program"}:
                failing |= {" ".join(command.words)} if "Exit(1)" in ast.unparse(node) else set()
        said = " ".join((command.text, *(option.text for option in command.options)))
        failing |= {" ".join(command.words)} if "exit code 1" in said else set()

    assert set(exit_codes.of_all()) == {"0", str(INTERRUPTED), str(TERMINATED)} | refused
    assert set(exit_codes.of_ones()) == failing


PAGES = (
    "solidtouch.1",
    "solidtouch-rig.1",
    "solidtouch-conformance-run.1",
    "solidtouch-emulate-fault.1",
    "solidtouch-perceive.1",
    "solidtouch-view.1",
)
"""The program, a group, commands of groups and others."""


@pytest.mark.parametrize("name", slow_but(PAGES, sorted(manual())))
def test_a_man_page_is_sound(name):
    text = manual()[name]

    assert re.findall(r"^\.SH (\w+)", text, flags=re.MULTILINE)[:3] == ["NAME", "SYNOPSIS", "DESCRIPTION"]
    assert not re.search(r"(?<!\\)--", text)
    assert roff(".x `a-b`\\") == "\\&.x \\fBa\\-b\\fR\\e"


def test_groff_has_no_objection(tmp_path):
    groff = "/usr/bin/groff"
    if not Path(groff).exists():
        pytest.skip("groff is not installed")
    every = tmp_path / "all.1"
    every.write_text("\n".join(manual().values()), encoding="utf-8")
    done = subprocess.run(
        [groff, "-man", "-ww", "-z", "-Tutf8", "-Kutf8", every], capture_output=True, text=True, check=True
    )

    assert done.stderr == ""


def test_every_figure_is_in_the_gallery_with_a_command_that_exists():
    shown = {picture.name for picture in gallery.pictures([name for name in documents() if name.endswith(".md")])}
    made = {p.stem for p in (ROOT / "docs").rglob("images/*") if p.suffix in {".svg", ".png"}}
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text("utf-8"), flags=re.MULTILINE))

    assert shown <= made == set(gallery.commands())
    prose = "".join((ROOT / page).read_text(encoding="utf-8") for page in documents())
    assert [name for name in made - shown if f"/{name}." not in prose] == []
    for command in gallery.commands().values():
        words = command.split()
        if words[0] == "make":
            assert words[1] in targets
        else:
            assert importlib.util.find_spec(words[2]) is not None


def test_links_follow_files_to_their_places():
    moved = {"a.md": "x/a.md", "b/c.py": "source/b/c.py.md"}
    text = "[a](a.md#b) `[a](a.md)` [b](b/c.py) [c](https://a.md) [d](#d)\n```\n[a](a.md)\n```\n"

    assert linked(text, "x", moved.get) == text.replace("(b/c.py)", "(../source/b/c.py.md)")
    assert linked("[a](a.md)", "", moved.get) == "[a](x/a.md)"


def test_the_moving_picture_stands_still_where_that_is_preferred():
    root = ET.parse(ROOT / OUT).getroot()  # noqa: S314 - a file of this repository
    text = (ROOT / OUT).read_text(encoding="utf-8")
    taps = [node for node in root if node.get("class") == "tap"]
    still, moving = text.split("@media (prefers-reduced-motion: no-preference)")

    assert (ROOT / OUT).stat().st_size < 1e6
    assert len(taps) == text.count("@keyframes") == 7
    assert "animation" not in still
    assert f"{(len(taps) + 2) * SECONDS:.1f}s" in moving
    assert "Tap 7: decided, 6 mm rod" in "".join(taps[-1].itertext())


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_parses_and_names_public_things(notebook):
    text = notebook.read_text(encoding="utf-8")
    tree = ast.parse(text)
    used = {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "st"
    }
    imported = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}

    assert text.startswith("# %% [markdown]\n# # ")
    assert used <= set(st.__all__)
    assert not any(module.startswith("solidtouch") for module in imported)
    assert re.search(r"figure|plot", text.rpartition("# %%\n")[2])


@pytest.mark.slow
@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_as_a_script(notebook, tmp_path):
    subprocess.run([sys.executable, notebook], cwd=tmp_path, check=True)


@pytest.mark.slow
def test_the_site_builds_and_asks_nothing_of_the_network(tmp_path):
    pytest.importorskip("sphinx", reason="the extra docs is not installed")
    words = [sys.executable, "-m", "benchmarks.site.build", "--without-notebooks", "--out", tmp_path / "site"]
    subprocess.run(words, cwd=ROOT, check=True)
    loaded = r"<(?:script|img|link|iframe)\b[^>]*\b(?:src|href)=\"(?:https?:)?//[^\"]*\""
    found = {page: re.findall(loaded, page.read_text("utf-8")) for page in (tmp_path / "site").rglob("*.html")}

    assert len(found) > len(documents())
    assert {page.name: tags for page, tags in found.items() if tags} == {}
