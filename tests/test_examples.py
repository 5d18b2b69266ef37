"""The examples in docstrings and in the documentation run and print what they show."""

import ast
import doctest
import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest
from solidtouch.cli.main import run as run_command

import solidtouch
from benchmarks.own_stories import stories

ROOT = Path(__file__).parents[1]
MODULES = sorted(
    path.relative_to(ROOT).with_suffix("").as_posix().removeprefix("solidtouch/").replace("/", ".")
    for package in ("models", "hardware", "inference", "analysis", "cli", "solidtouch")
    for path in (ROOT / package).rglob("*.py")
    if re.search(r"^ *>>> ", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
)
SHOWN_BY_OTHERS = {
    *("Engine", "TouchSensor", "TapModel"),  # interfaces
    *("InputError", "NotConvergedError", "ZeroEvidenceError"),
    *("Episode", "Step"),  # results of `perceive` and `steps`
    "PRESETS",
    *("audit", "compare", "reproduce", "sensitivity", "strategies", "validate"),  # minutes: see api.md
    *(name for name in solidtouch.__all__ if name.endswith("Report")),  # their results
}
PAGES = sorted(
    path.relative_to(ROOT).as_posix()
    for path in (*(ROOT / "docs").rglob("*.md"), ROOT / "README.md")
    if "```python" in path.read_text(encoding="utf-8")
)


def blocks(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.findall(r"^```python\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)


@pytest.fixture
def run(tmp_path, monkeypatch):
    """A function that runs code in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return lambda code: exec(code, {"__name__": "page"})  # noqa: S102


@pytest.mark.parametrize("module", MODULES)
def test_examples_in_docstrings_print_what_they_show(module):
    if module.endswith("classifier"):
        pytest.importorskip("sklearn", reason="scikit-learn is not installed")
    result = doctest.testmod(importlib.import_module(f"solidtouch.{module}"))

    assert result.attempted
    assert not result.failed


@pytest.mark.parametrize("name", sorted(set(solidtouch.__all__) - SHOWN_BY_OTHERS))
def test_a_public_name_has_an_example(name):
    assert doctest.DocTestParser().get_examples(getattr(solidtouch, name).__doc__)


@pytest.mark.parametrize("name", solidtouch.conformance.__all__)
def test_a_name_of_the_conformance_kit_is_described_and_its_functions_have_an_example(name):
    thing = getattr(solidtouch.conformance, name)

    assert thing.__doc__
    assert isinstance(thing, type) or doctest.DocTestParser().get_examples(thing.__doc__)


@pytest.mark.parametrize("page", PAGES)
def test_what_python_blocks_import_is_there(page, tmp_path):
    """Also where they need the output of a long command to run to their end."""
    for block in blocks(page):
        imports = [node for node in ast.parse(block).body if isinstance(node, ast.Import | ast.ImportFrom)]
        for node in imports:
            names = [alias.name for alias in node.names]
            if isinstance(node, ast.ImportFrom):
                module = importlib.import_module(node.module)
                assert all(hasattr(module, name) for name in names), (page, names)
            else:
                assert all(importlib.import_module(name) for name in names)


def test_the_page_about_scikit_learn_runs(run):
    pytest.importorskip("sklearn", reason="scikit-learn is not installed")
    run("\n".join(blocks("docs/how-to/scikit-learn.md")))


def test_the_page_about_conformance_finds_its_mistake(run, capsys):
    """And prints what the page shows, but for the version and size of the kit."""
    page = "docs/reference/conformance/README.md"
    (block,) = blocks(page)
    run(block)
    shown = (ROOT / page).read_text(encoding="utf-8").partition("print(report)\n```")[2].split("```")[1]
    texts = [re.sub(r"kit \S+:|\d+ of \d+ not", "", text) for text in (capsys.readouterr().out, shown)]
    printed, told = ([" ".join(line.split()) for line in text.splitlines()] for text in texts)

    assert told[1:] == printed
    assert "the belief is shifted in the wrong direction" in " ".join(printed)


@pytest.mark.filterwarnings("ignore:Estimated shape parameter")
def test_the_file_of_a_model_is_compared_by_arviz(run, tmp_path, monkeypatch, make_taps):
    """After the command that the page names; models that are wrong make ArviZ warn."""
    (block,) = blocks("docs/reference/models.md")
    make_taps().save(tmp_path / "taps.nc")
    words = ["fit", "taps.nc", "--split", "parity", "--out", "model.nc", "--model", "gaussian", "--draws", "250"]
    monkeypatch.setattr(sys, "argv", ["solidtouch", *words])
    with pytest.raises(SystemExit, match="0"):
        run_command()
    run(block)


def test_the_stories_of_the_page_about_own_models_keep_the_contract(make_taps):
    """The first one is fitted where all of the page runs, and stories like them are by tests of the contract."""
    from solidtouch.models.measurement import registry
    from solidtouch.models.measurement.generic.contract import StoryFunction
    from solidtouch.models.measurement.generic.story import batch_of
    from solidtouch.models.measurement.generic.structure import structure_of

    (partly,) = (block for block in blocks("docs/how-to/your-own-model.md") if "st.register" in block)
    exec(f"import solidtouch as st\n{partly}", {})  # noqa: S102
    assert registry.split_name("wide-profile") == ("wide-profile", False)
    taps = make_taps(J=6, K=3)
    batch = batch_of(taps.grid(), taps.preprocessing, 3)
    shown = stories()
    found = [structure_of(StoryFunction.of(story, name), batch) for name, story in shown.items()]

    assert list(shown) == ["laplace", "two_levels", "walk", "shifted"]
    assert [s.enumerated for s in found] == [(), ("upper",), (), ()]
    assert [list(s.by_session) for s in found] == [[], [], [], ["shift"]]


@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    [
        "docs/explanation/calibration.md",
        "docs/how-to/arviz.md",
        "docs/how-to/tuning.md",
        "docs/how-to/your-own-model.md",
        "docs/reference/api.md",
    ],
)
def test_a_page_runs_from_its_first_block_to_its_last(page, tmp_path):
    subprocess.run([sys.executable, "-c", "\n".join(blocks(page))], cwd=tmp_path, check=True)
