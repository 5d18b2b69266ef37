"""The page about sweeps does what it says."""

import re
import runpy
import shutil
from pathlib import Path

from solidtouch.analysis.sweep.run import sweep
from solidtouch.analysis.sweep.store import QUANTITIES
from solidtouch.analysis.sweep.study import load_study, parse_study
from solidtouch.analysis.tasks.local import in_this_process

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "how-to" / "sweep.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    return re.search(rf"^```{language}\n(.*?)^```$", PAGE, flags=re.MULTILINE | re.DOTALL)[1]


def test_the_study_on_the_page_is_the_example():
    assert parse_study(block("toml")) == load_study(DOCS / "examples" / "study.toml")


def test_the_example_runs_and_is_read_as_the_page_says(tmp_path, monkeypatch, capsys):
    path = tmp_path / "study.toml"
    shutil.copy(DOCS / "examples" / "study.toml", path)
    path.write_text(path.read_text(encoding="utf-8").replace("trials = 1000", "trials = 40"), encoding="utf-8")
    sweep(path, tmp_path / "study.zarr", in_this_process)

    monkeypatch.chdir(tmp_path)
    Path("read.py").write_text(block("python"), encoding="utf-8")
    runpy.run_path("read.py")
    printed = capsys.readouterr().out

    assert re.search(r"^policy +passive +active$|^policy +active +passive$", printed, flags=re.MULTILINE)
    assert "pending or failed: 0" in printed


def test_the_page_names_every_quantity():
    assert not [name for name in QUANTITIES if not name.endswith("_se") and f"`{name}`" not in PAGE]
