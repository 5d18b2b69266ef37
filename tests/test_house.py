"""Where things stand: class names, circles of imports, sizes of folders and their heads."""

import ast
import sys
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


EVERYWHERE = {"numpy", "scipy", "xarray", "msgspec"}
"""Packages that any file may import."""
EDGES = {
    "arviz": (
        "analysis/audit/variance/gains.py",
        "analysis/compare/taps.py",
        "models/measurement/fits/nuts.py",
    ),
    "arviz_plots": ("analysis/audit/figures_checks.py",),
    "arviz_stats": ("analysis/compare/taps.py",),
    "dask": ("analysis/sweep/dask.py",),
    "distributed": ("analysis/sweep/dask.py",),
    "h5py": ("models/io/mat.py", "models/io/model_file.py", "models/taps.py"),
    "jax": (
        "analysis/audit/variance/gains.py",
        "analysis/conformance/routes.py",
        "analysis/correctness/sbc_arrays.py",
        "inference/engines/enumeration.py",
        "inference/trials/gpu.py",
        "models/measurement/**/*.py",
        "models/touch.py",
    ),
    "jinja2": ("analysis/page/html.py",),
    "lazy_loader": ("solidtouch/__init__.py",),
    "markupsafe": ("analysis/page/html.py",),
    "matplotlib": (
        "analysis/*/figure*_*.py",
        "analysis/*/figures.py",
        "analysis/page/page.py",
        "analysis/page/report.py",
    ),
    "mcap": ("hardware/recording/recording.py", "models/io/rig_reader.py"),
    "mpmath": ("analysis/conformance/exact.py",),
    "numba": ("models/compiled.py",),
    "numpyro": (
        "analysis/audit/variance/gains.py",
        "inference/engines/enumeration.py",
        "models/measurement/**/*.py",
        "models/touch.py",
    ),
    "pandas": ("models/io/csv_rows.py",),
    "rich": ("analysis/live/*.py", "analysis/page/terminal.py", "cli/**/*.py"),
    "serial": ("hardware/link/port.py",),
    "sklearn": ("inference/classifier.py",),
    "threadpoolctl": ("models/threads.py",),
    "typer": ("cli/*.py", "cli/shared/options.py"),
    "zarr": ("analysis/sweep/store.py",),
}
"""The files that may import any other package, wherever in a file and for types alone as well."""


def packages(path):
    """Packages from elsewhere that a file imports."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield str(node.module).partition(".")[0]


def test_packages_from_elsewhere_are_imported_where_they_belong():
    """And every place where one belongs imports it."""
    found = {
        (package, path.relative_to(ROOT))
        for path in modules((*PACKAGES, "solidtouch"))
        for package in packages(path)
        if package not in EVERYWHERE | sys.stdlib_module_names
    }
    allowed = {(package, pattern) for package, patterns in EDGES.items() for pattern in patterns}
    matches = {
        (package, path): {one for one in allowed if one[0] == package and path.full_match(one[1])}
        for package, path in found
    }

    assert {f"{path} imports {package}" for (package, path), by in matches.items() if not by} == set()
    assert set().union(*matches.values()) == allowed


def test_an_import_anywhere_in_a_file_counts(tmp_path):
    code = "from . import rich\ndef late():\n    import jax.numpy\n    from serial.tools import x\n"
    (tmp_path / "late.py").write_text(code)
    assert set(packages(tmp_path / "late.py")) == {"jax", "serial"}
