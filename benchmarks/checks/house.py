"""Size and shape of the code: files, lines, names, parameters, start-up, and the files that a tap or a study enters.

Run `python -m benchmarks.checks.house`.
"""

import ast
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from time import perf_counter

from rich.console import Console
from rich.table import Table

import solidtouch as st

ROOT = Path(__file__).parents[2]
PACKAGES = ("models", "hardware", "inference", "analysis", "cli")
LONG = 400
STARTS = 5


def main() -> None:
    """Prints the table."""
    table = Table("", "", box=None, show_header=False)
    for name, value in [*sizes(), *starts(), *ways()]:
        table.add_row(name, str(value))
    Console().print(table)


def sizes() -> Iterator[tuple[str, object]]:
    """Counts over the source files of the package."""
    files = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    lines = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in files}
    modules = [path for path in files if path.name != "__init__.py"]
    folders = Counter(path.parent.relative_to(ROOT).as_posix() for path in modules)
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in files]
    functions = [node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    classes = Counter(node.name for tree in trees for node in tree.body if isinstance(node, ast.ClassDef))
    parameters = max(functions, key=_parameters)
    body = max(functions, key=_length)
    yield "files, lines", f"{len(files)}, {sum(lines.values())}"
    yield "median lines of a module", median(lines[path] for path in modules)
    yield f"modules above {LONG} lines", sum(lines[path] > LONG for path in modules)
    yield "most modules in a folder", "{}, {}".format(*folders.most_common(1)[0])
    yield "class names that exist twice", sum(number > 1 for number in classes.values())
    yield "public names", len(vars(st)["__all__"])
    yield "longest parameter list", f"{_parameters(parameters)}, {parameters.name}"
    yield "longest function", f"{_length(body)} lines, {body.name}"


def starts() -> Iterator[tuple[str, str]]:
    """Seconds from the start of a process to its end, the least of several."""
    for words in (("-c", "pass"), ("-c", "import solidtouch"), ("-m", "solidtouch.cli", "--help")):
        seconds = min(_seconds(words) for _ in range(STARTS))
        yield f"python {' '.join(words)}", f"{seconds:.2f} s"


def ways() -> Iterator[tuple[str, int]]:
    """Source files of which something is called for one tap of many, and for a study of one data set and a figure."""
    train, test = st.simulate("paper", sessions=2, seed=4)
    model = st.fit(train)
    rig = st.SimulatedRig("paper", seed=4, session=1, position_mm=2.3, what=1)
    episode = st.steps(rig, model, stop=1.0, move=st.fixation(7))
    for _ in range(2):
        next(episode)
    entered = called_files(lambda: next(episode))
    simulator = sum("simulator" in path.parts for path in entered)
    yield "files of one tap, from the rig to the decision", len(entered) - simulator
    yield "further files, of the simulated rig", simulator
    st.trials(model, test, 100)
    yield (
        "files of fit and trials, from taps to their result",
        len(called_files(lambda: st.trials(st.fit(train), test, 100))),
    )

    def study() -> None:
        report = st.reproduce(data_sets=1, trials=50)
        report.plot(next(iter(report.figures)))

    study()
    yield "files of reproduce, from taps to a figure", len(called_files(study))


def called_files(act: Callable[[], object]) -> set[Path]:
    """Files of the package of which a function is called meanwhile; those only imported are not counted."""
    entered = set()

    def note(frame, event, _):
        if event == "call":
            entered.add(frame.f_code.co_filename)

    sys.setprofile(note)
    try:
        act()
    finally:
        sys.setprofile(None)
    paths = {Path(name) for name in entered}
    return {path.relative_to(ROOT) for path in paths if any(path.is_relative_to(ROOT / name) for name in PACKAGES)}


def _parameters(function: ast.FunctionDef) -> int:
    given = function.args
    return len(given.posonlyargs) + len(given.args) + len(given.kwonlyargs)


def _length(function: ast.FunctionDef) -> int:
    return (function.end_lineno or function.lineno) - function.lineno + 1


def _seconds(words: tuple[str, ...]) -> float:
    began = perf_counter()
    subprocess.run([sys.executable, *words], check=True, stdout=subprocess.DEVNULL)  # noqa: S603
    return perf_counter() - began


if __name__ == "__main__":
    main()
