"""Where things stand: class names, circles of imports, sizes of folders and their heads."""

import ast
import sys
from functools import cache
from pathlib import Path

import pytest

from benchmarks.checks import house
from benchmarks.checks.house import PACKAGES, ROOT, circles, class_names, folder_sizes, import_edges, modules

MOST_MODULES, MOST_LINES = 20, 5
LARGER = {"cli"}
"""Folders that hold more modules: commands have a file each."""
HOUSED = (*PACKAGES, "benchmarks")
"""Whose folders are small and have a head."""
FOLDERS = sorted({path.parent.relative_to(ROOT).as_posix() for path in modules(packages=HOUSED)})


@pytest.fixture(scope="module", autouse=True)
def _each_file_is_parsed_once():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(house, "parsed", cache(house.parsed))
        yield


def test_a_class_name_exists_once():
    assert {name for name, number in class_names().items() if number > 1} == set()


def test_no_folder_holds_many_modules():
    """But those that are allowed to; what needs no allowance any more must have none."""
    assert {folder for folder, n in folder_sizes(packages=HOUSED).items() if n > MOST_MODULES} == LARGER


def test_no_module_imports_itself_by_a_detour():
    edges = import_edges()

    assert len(edges) > 2 * len(modules())
    assert circles(edges) == []


def test_a_circle_is_found():
    a, b, c = map(Path, "abc")
    assert circles({(a, b), (b, c), (c, b)}) == [["b", "c"]]


@pytest.mark.parametrize("folder", FOLDERS)
def test_a_folder_says_what_is_inside(folder):
    """In a few lines at its head, and holds no code there."""
    head = house.parsed(ROOT / folder / "__init__.py")

    assert len(head.body) == 1
    assert 1 < len((ast.get_docstring(head) or "").splitlines()) <= MOST_LINES


EVERYWHERE = {"numpy", "scipy", "xarray", "msgspec"}
"""Packages that any file may import."""
EDGES = {
    "anywidget": ("analysis/live/widget.py",),
    "arviz": (
        "analysis/posteriors/comparison.py",
        "models/measurement/fits/nuts.py",
    ),
    "arviz_base": ("analysis/compare/taps.py",),
    "arviz_stats": ("analysis/compare/taps.py",),
    "cloudpickle": ("models/measurement/fits/portable.py",),
    "dask": ("analysis/tasks/dask.py",),
    "distributed": ("analysis/tasks/dask.py",),
    "h5netcdf": ("models/blocks.py",),
    "h5py": (
        "models/io/isolated/hdf5.py",
        "models/io/layouts/formats/hdf5.py",
        "models/io/layouts/formats/hdf5_nodes.py",
        "models/io/layouts/formats/matlab.py",
        "models/io/layouts/formats/matlab_hdf5.py",
        "models/io/own_netcdf.py",
        "models/storage.py",
    ),
    "jax": (
        "analysis/conformance/routes.py",
        "analysis/correctness/sbc_arrays.py",
        "inference/engines/enumeration.py",
        "inference/trials/gpu.py",
        "models/measurement/**/*.py",
        "models/touch.py",
    ),
    "jinja2": ("analysis/page/html.py",),
    "lazy_loader": ("solidtouch/__init__.py",),
    "llvmlite": ("models/compiled.py", "models/vectors.py"),
    "markupsafe": ("analysis/page/html.py",),
    "matplotlib": (
        "analysis/*/figure*_*.py",
        "analysis/*/figures.py",
        "analysis/page/page.py",
        "analysis/page/report.py",
    ),
    "mcap": (
        "hardware/recording/recording.py",
        "models/io/layouts/formats/mcap.py",
        "models/io/mcap_file.py",
        "models/io/rig_reader.py",
    ),
    "mcap_ros2": ("models/io/layouts/formats/mcap.py",),
    "mpmath": ("analysis/conformance/arithmetic.py",),
    "numba": ("models/compiled.py", "models/vectors.py"),
    "numpyro": (
        "inference/engines/enumeration.py",
        "models/measurement/**/*.py",
        "models/touch.py",
    ),
    "pandas": ("models/io/layouts/formats/text.py",),
    "pyarrow": ("models/io/isolated/columnar.py", "models/io/layouts/formats/columnar.py"),
    "rich": ("analysis/live/*.py", "analysis/page/terminal.py", "cli/**/*.py"),
    "serial": ("hardware/link/port.py",),
    "sklearn": ("inference/classifier.py",),
    "threadpoolctl": ("models/threads.py",),
    "tornado": ("analysis/live/server.py",),
    "traitlets": ("analysis/live/widget.py",),
    "typer": (
        "cli/*.py",
        "cli/shared/homing.py",
        "cli/shared/map_options.py",
        "cli/shared/options.py",
        "cli/shared/usage.py",
    ),
    "zarr": (
        "analysis/sweep/store.py",
        "models/io/isolated/zarr_store.py",
        "models/io/layouts/formats/zarr_store.py",
    ),
}
"""The files that may import any other package, wherever in a file and for types alone as well."""


def packages(path):
    """Packages from elsewhere that a file imports."""
    for node in ast.walk(house.parsed(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield str(node.module).partition(".")[0]


def test_packages_from_elsewhere_are_imported_where_they_belong():
    """And every place where one belongs imports it."""
    found = {
        (package, path.relative_to(ROOT))
        for path in modules(packages=(*PACKAGES, "solidtouch"))
        for package in packages(path)
        if package not in EVERYWHERE | sys.stdlib_module_names
    }
    allowed = {(package, pattern) for package, patterns in EDGES.items() for pattern in patterns}
    places = {one: {path.relative_to(ROOT) for path in ROOT.glob(one[1])} for one in allowed}
    matches = {
        (package, path): {one for one in allowed if one[0] == package and path in places[one]}
        for package, path in found
    }

    assert {f"{path} imports {package}" for (package, path), by in matches.items() if not by} == set()
    assert set().union(*matches.values()) == allowed


def test_an_import_anywhere_in_a_file_counts(tmp_path):
    code = "from . import rich\ndef late():\n    import jax.numpy\n    from serial.tools import x\n"
    (tmp_path / "late.py").write_text(code)
    assert set(packages(tmp_path / "late.py")) == {"jax", "serial"}
