"""Where things stand: class names, circles of imports, sizes of folders and their heads."""

import ast
from collections import Counter
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("models", "hardware", "inference", "analysis", "cli")
MOST_MODULES, MOST_LINES = 20, 5
LARGER = {"cli"}
"""Folders that hold more modules: commands have a file each."""
HOUSED = (*PACKAGES, "benchmarks")
"""Whose folders are small and have a head."""


def modules(packages=PACKAGES):
    return [path for package in packages for path in (ROOT / package).rglob("*.py")]


FOLDERS = sorted({path.parent.relative_to(ROOT).as_posix() for path in modules(HOUSED)})


def test_a_class_name_exists_once():
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in modules()]
    names = Counter(node.name for tree in trees for node in tree.body if isinstance(node, ast.ClassDef))

    assert {name for name, number in names.items() if number > 1} == set()


def test_no_folder_holds_many_modules():
    """But those that are allowed to; what needs no allowance any more must have none."""
    folders = Counter(path.parent for path in modules(HOUSED) if path.name != "__init__.py")

    assert {folder.relative_to(ROOT).as_posix() for folder, n in folders.items() if n > MOST_MODULES} == LARGER


def imports(path):
    """Modules of the project that a file imports anywhere in it, late and for types alone as well."""
    own = path.relative_to(ROOT).with_suffix("").parts
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = ROOT.joinpath(*own[: len(own) - node.level], *(node.module or "").split("."))
            for alias in node.names:
                module = base / f"{alias.name}.py"
                yield module if module.is_file() else base.with_suffix(".py")


def test_no_module_imports_itself_by_a_detour():
    files = [path for path in modules() if path.name != "__init__.py"]
    graph = {path: {other for other in imports(path) if other.is_file()} for path in files}

    assert sum(map(len, graph.values())) > 2 * len(files)
    TopologicalSorter(graph).prepare()  # raises a CycleError, which names the modules


@pytest.mark.parametrize("folder", FOLDERS)
def test_a_folder_says_what_is_inside(folder):
    """In a few lines at its head, and holds no code there."""
    head = ast.parse((ROOT / folder / "__init__.py").read_text(encoding="utf-8"))

    assert len(head.body) == 1
    assert 1 < len((ast.get_docstring(head) or "").splitlines()) <= MOST_LINES
