"""Where things stand: class names, sizes of folders and their heads."""

import ast
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("models", "hardware", "inference", "analysis", "cli")
MOST_MODULES, MOST_LINES = 20, 5
LARGER = {"models", "hardware", "hardware/emulator", "inference", "cli"}
"""Folders that hold more modules, for now."""
TWICE = {"Cells", "Frame", "TapCounts"}
"""Class names that exist twice in `models`, for now."""
FOLDERS = sorted({path.parent.relative_to(ROOT).as_posix() for path in (ROOT / "analysis").rglob("*.py")})


def modules():
    return [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]


def test_a_class_name_exists_once():
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in modules()]
    names = Counter(node.name for tree in trees for node in tree.body if isinstance(node, ast.ClassDef))

    assert {name for name, number in names.items() if number > 1} == TWICE


def test_no_folder_holds_many_modules():
    """But those that are allowed to; what needs no allowance any more must have none."""
    folders = Counter(path.parent for path in modules() if path.name != "__init__.py")

    assert {folder.relative_to(ROOT).as_posix() for folder, n in folders.items() if n > MOST_MODULES} == LARGER


@pytest.mark.parametrize("folder", FOLDERS)
def test_a_folder_of_analysis_says_what_is_inside(folder):
    """In a few lines at its head, and holds no code there."""
    head = ast.parse((ROOT / folder / "__init__.py").read_text(encoding="utf-8"))

    assert len(head.body) == 1
    assert 1 < len((ast.get_docstring(head) or "").splitlines()) <= MOST_LINES
