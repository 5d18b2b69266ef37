"""Size and shape of the code, and the files that a result passes through; run `python -m benchmarks.checks.house`.

With a folder or a revision of git it measures another version, without what has to run.
"""

import ast
import inspect
import re
import shutil
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from solidtouch.hardware.emulator.emulated_bench import emulated_bench
from solidtouch.hardware.journal import NoJournal
from solidtouch.hardware.rig.open_rig import build_rig, connected

import solidtouch as st
from benchmarks.page import table

ROOT = Path(__file__).parents[2]
PACKAGES = ("models", "hardware", "inference", "analysis", "cli")
SHARED = {"stats", "experiment", "page", "validation"}  # no studies, or based on all of them
LINES = ("lines", "code", "docstrings and comments", "blank")
LONG, STARTS = 400, 5
_IMPORT = """import sys, time; began = time.perf_counter(); import solidtouch
print(time.perf_counter() - began, *({'jax', 'matplotlib', 'numpy'} & sys.modules.keys()))"""


def main() -> None:
    """Prints the tables."""
    version = next(iter(sys.argv[1:]), None)
    root = Path(version or ROOT)
    with TemporaryDirectory() as temporary:
        if not root.is_dir():
            root, archive = Path(temporary), Path(temporary, "version.tar")
            subprocess.run(["git", "archive", "-o", archive, str(version)], cwd=ROOT, check=True)  # noqa: S603, S607
            shutil.unpack_archive(archive, root, filter="data")
        print(table(("package", "files", *LINES), [[*map(str, row)] for row in package_rows(root)]))
        figures = [*shape(root), *(() if version else (*start(), *ways(Path(temporary))))]
        print(table(("measure", "value"), [[name, str(value)] for name, value in figures]))


def modules(root: Path = ROOT, packages: tuple[str, ...] = PACKAGES) -> list[Path]:
    """All source files of the packages, their heads included."""
    return [path for package in packages for path in sorted((root / package).rglob("*.py"))]


def parsed(path: Path) -> ast.Module:
    """The syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


def class_names(root: Path = ROOT) -> Counter[str]:
    """How often each name of a class at the top of a file occurs."""
    return Counter(node.name for path in modules(root) for node in parsed(path).body if isinstance(node, ast.ClassDef))


def folder_sizes(root: Path = ROOT, packages: tuple[str, ...] = PACKAGES) -> Counter[str]:
    """Number of modules in each folder, without its head."""
    files = (path.relative_to(root) for path in modules(root, packages) if path.name != "__init__.py")
    return Counter(path.parent.as_posix() for path in files)


def imports(path: Path, root: Path = ROOT) -> Iterator[Path]:
    """Modules of the project that a file imports anywhere in it, late and for types alone as well."""
    own = path.relative_to(root).with_suffix("").parts
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = root.joinpath(*own[: len(own) - node.level], *(node.module or "").split("."))
            for alias in node.names:
                module = base / f"{alias.name}.py"
                yield module if module.is_file() else base.with_suffix(".py")


def import_edges(root: Path = ROOT) -> set[tuple[Path, Path]]:
    """Pairs of modules of which the first imports the second, relative to the root."""
    pairs = ((path, other) for path in modules(root) for other in imports(path, root) if other.is_file())
    return {(path.relative_to(root), other.relative_to(root)) for path, other in pairs}


def circles(edges: set[tuple[Path, Path]]) -> list[list[str]]:
    """Groups of modules that import each other, directly or by a detour."""
    files = sorted({path for edge in edges for path in edge})
    number = {path: i for i, path in enumerate(files)}
    ends = np.array([[number[path] for path in edge] for edge in edges]).T
    graph = csr_array((np.ones(len(edges)), tuple(ends)), shape=(len(files), len(files)))
    n, of = connected_components(graph, connection="strong")
    return [[files[i].as_posix() for i in np.flatnonzero(of == k)] for k in range(n) if (of == k).sum() > 1]


def package_rows(root: Path) -> list[list[str | int]]:
    """Files and lines of each package, the lines by what they hold, and their sums."""
    kinds = {package: [_kinds(path) for path in modules(root, (package,))] for package in PACKAGES}
    kinds["all"] = [row for rows in kinds.values() for row in rows]
    return [[name, len(rows), *(sum(column) for column in zip(*rows, strict=True))] for name, rows in kinds.items()]


def _kinds(path: Path) -> tuple[int, int, int, int]:
    """Lines of a file: all, of code, of docstrings and comments, blank ones."""
    lines = path.read_text(encoding="utf-8").splitlines()
    texts = (node for node in ast.walk(parsed(path)) if isinstance(node, ast.Expr))
    texts = (node for node in texts if isinstance(node.value, ast.Constant) and isinstance(node.value.value, str))
    told = {line for node in texts for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)}
    told |= {number for number, line in enumerate(lines, 1) if line.lstrip().startswith("#")}
    blank = sum(not line.strip() for number, line in enumerate(lines, 1) if number not in told)
    return len(lines), len(lines) - len(told) - blank, len(told), blank


def shape(root: Path) -> Iterator[tuple[str, object]]:
    """Figures of the source files."""
    files = [path for path in modules(root) if path.name != "__init__.py"]
    lengths = [len(path.read_text(encoding="utf-8").splitlines()) for path in files]
    functions = (node for path in files for node in ast.walk(parsed(path)) if isinstance(node, ast.FunctionDef))
    parameters = {len([*one.args.posonlyargs, *one.args.args, *one.args.kwonlyargs]): one.name for one in functions}
    edges = import_edges(root)
    found = circles(edges)
    sides = [[{*path.parts[1:-1][:1]} - SHARED for path in edge if path.parts[0] == "analysis"] for edge in edges]
    stub = root / "solidtouch" / "__init__.pyi"
    yield "median lines of a module", median(lengths)
    yield f"modules above {LONG} lines", sum(length > LONG for length in lengths)
    yield "most modules in a folder", "{1} ({0})".format(*folder_sizes(root).most_common(1)[0])
    yield "circles of imports", f"{len(found)} with {sum(map(len, found))} modules"
    yield "imports between studies", sum(len(side) == 2 and all(side) and side[0] != side[1] for side in sides)
    yield "class names that exist twice", sum(number > 1 for number in class_names(root).values())
    yield "longest parameter list", "{} ({})".format(*max(parameters.items()))
    public = [node for node in parsed(stub).body if isinstance(node, ast.ImportFrom)] if stub.is_file() else []
    yield "public names", sum(len(node.names) for node in public)
    for model in ("gaussian", "student"):
        named = [path.relative_to(root) for path in files if re.search(f"[\"']{model}[\"']", path.read_text("utf-8"))]
        yield f"files that name the model {model}", listed(named)


def listed(paths: list[Path]) -> str:
    """Files by number and name."""
    return f"{len(paths)} ({', '.join(map(str, paths))})"


def start() -> Iterator[tuple[str, str]]:
    """Time of the import in new processes, and which large packages come with it."""
    command = [sys.executable, "-c", _IMPORT]
    runs = [subprocess.check_output(command, text=True).split() for _ in range(STARTS)]  # noqa: S603
    loaded = ", ".join(runs[0][1:]) or "none of numpy, jax, matplotlib"
    yield "`import solidtouch`", f"{median(float(run[0]) for run in runs):.2f} s; loads {loaded}"


def ways(folder: Path) -> Iterator[tuple[str, str]]:
    """Files of which a function is called for one tap of a rig, and for a study from its files to a figure."""
    train, test = st.simulate("paper", sessions=2, seed=4)
    with (
        emulated_bench(folder / "bench", homed=True) as bench,
        connected(build_rig(bench.rig, bench.clock, NoJournal())) as rig,
    ):
        bench.emulation.control({"object": 1})
        model = replace(st.fit(train), preprocessing=rig.preprocessing)  # the simulated finger taps at set times
        episode = st.steps(rig, model, stop=1.0, move=st.fixation(7))
        _ = next(episode), next(episode)
        entered = called_files(lambda: next(episode))
    own = [path for path in entered if not {"emulator", "simulator"} & {*path.parts}]
    yield "files of one tap, from the port to the decision", listed(own)
    files = [folder / "train.nc", folder / "test.nc"]
    for taps, path in zip((train, test), files, strict=True):
        taps.save(path)

    def study() -> None:
        report = st.reproduce(*map(st.load_taps, files), trials=20)
        report.plot("fig5_passive")

    study()  # compiles
    yield "files of reproduce, from taps to an error figure", listed(called_files(study))


def called_files(act: Callable[[], object]) -> list[Path]:
    """Files of the packages of which a function is called meanwhile, in any thread, in the order of the first calls."""
    entered: dict[str, None] = {}

    def note(frame, event, _):
        if event == "call" and frame.f_code.co_flags & inspect.CO_OPTIMIZED:  # not the body of a class or module
            entered[frame.f_code.co_filename] = None

    threading.setprofile_all_threads(note)
    try:
        act()
    finally:
        threading.setprofile_all_threads(None)
    own = {path.as_posix(): path.relative_to(ROOT) for path in modules()}
    return [own[name] for name in entered if name in own]


if __name__ == "__main__":
    main()
