"""Machine code on disk is an aid: damaged or outdated files cost a compilation, not the program."""

import importlib.util
import sys
from pathlib import Path

import pytest

CODE = """
from typing import NamedTuple
from {types} import Pair
from solidtouch.models.compiled import compiled

@compiled
def total(pair):
    return pair.first + pair.second
"""
TYPES = "from typing import NamedTuple\n\nclass Pair(NamedTuple):\n    first: float\n    second: float\n"


def load(folder, types):
    """The module with the loop as a new process would have it, whose types are in a module of their own."""
    for name in (types, "loop"):
        path = folder / f"{name}.py"
        spec = importlib.util.spec_from_file_location(name, path)
        module = sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    return sys.modules["loop"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr("numba.config.CACHE_DIR", "")
    for name in ("pairs", "couples", "loop"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    (tmp_path / "pairs.py").write_text(TYPES)
    (tmp_path / "loop.py").write_text(CODE.format(types="pairs"))
    module = load(tmp_path, "pairs")
    assert module.total(module.Pair(1.0, 2.0)) == 3.0
    assert index_of(tmp_path).stat().st_size > 0
    yield tmp_path
    for name in ("pairs", "couples", "loop"):
        sys.modules.pop(name, None)


def index_of(folder) -> Path:
    (index,) = folder.glob("__pycache__/*.nbi")
    return index


def hits(module):
    return sum(module.total.stats.cache_hits.values())


def test_code_on_disk_is_used(folder):
    module = load(folder, "pairs")

    assert module.total(module.Pair(1.0, 2.0)) == 3.0
    assert hits(module) == 1


def test_a_damaged_file_is_made_again(folder):
    index = index_of(folder)
    index.write_bytes(index.read_bytes()[:-20])
    module = load(folder, "pairs")

    assert module.total(module.Pair(1.0, 2.0)) == 3.0
    assert hits(module) == 0
    again = load(folder, "pairs")
    assert again.total(again.Pair(2.0, 2.0)) == 4.0
    assert hits(again) == 1


def test_types_may_move_to_another_module(folder):
    """As between two versions in one folder; the index on disk still names the old module."""
    (folder / "couples.py").write_text(TYPES)
    (folder / "loop.py").write_text(CODE.format(types="couples"))
    del sys.modules["pairs"]
    (folder / "pairs.py").unlink()
    module = load(folder, "couples")

    assert module.total(module.Pair(1.0, 2.0)) == 3.0
    assert hits(module) == 0


@pytest.mark.parametrize(("line", "name"), [("from couples import both", "both"), ("import couples", "couples.both")])
def test_a_change_of_a_function_that_is_called_counts(folder, monkeypatch, line, name):
    """Wherever it is and however it is named; its own code is part of the other's."""
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # a copy from the same second would count as new
    called = "from solidtouch.models.compiled import compiled\n\n@compiled\ndef both(a, b):\n    return a {} b\n"
    code = CODE.replace("return pair.first + pair.second", f"return {name}(pair.first, pair.second)")
    (folder / "loop.py").write_text(f"{line}\n{code.format(types='pairs')}")
    for sign, expected in (("+", 3.0), ("*", 2.0)):
        path = folder / "couples.py"
        path.write_text(called.format(sign))
        spec = importlib.util.spec_from_file_location("couples", path)
        sys.modules["couples"] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules["couples"])
        module = load(folder, "pairs")

        assert module.total(module.Pair(1.0, 2.0)) == expected
