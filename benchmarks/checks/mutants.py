"""Plants small errors in models, hardware, inference and analysis and counts those that tests notice; `make mutants`.

Each error (see `mutation`) is planted alone in a copy of the packages. Tests of its module run first: those in
`test_<module>.py` and in files that import the module. If all pass, tests of code that uses the module follow. A
failure counts only if the same test passes without the error. Slow tests are left out, as in `make test`.

A hash of the error's text decides the order, and kinds alternate, so an edit elsewhere does not change the sample.
Results are kept in a file with one line per error: a run resumes after an interruption, and a larger `--number` adds to
it. Errors that no fast test can notice, most of which change nothing, are listed with the reason in `explained.toml`.
"""

import argparse
import ast
import json
import os
import queue
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.checks.mutation import Mutant, mutants
from benchmarks.page import check_block, share_interval, table, write_block

ROOT = Path(__file__).parents[2]
PACKAGES = ("models", "hardware", "inference", "analysis")
NOT_TESTED = ("figure", "picture")  # names of files that draw begin so
"""Drawing: tests say what a figure shows, not how it looks."""
_FIRST, _LATER = 5, 5
_MOST_S = 400.0
"""What passes until then in the files of tests of an error counts as all."""
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


class Tests:
    """Which files of tests concern a module, by what imports what."""

    def __init__(self) -> None:
        files = [file for package in (*PACKAGES, "cli") for file in sorted((ROOT / package).glob("**/*.py"))]
        # The entry point imports every command, so through it all tests of commands would concern all modules.
        self._modules = {name: file for file in files if (name := _dotted(file)) not in {"cli.main", "cli.__main__"}}
        self._imports = {name: self._imported(file, name) for name, file in self._modules.items()}
        tests = ROOT / "tests"
        helpers = {file.stem: self._imported(file, "tests") for file in tests.glob("*.py")}
        self._tested = {test: self._imported(test, "tests", helpers) for test in sorted(tests.glob("**/test_*.py"))}
        compiled = {name for name, used in self._imports.items() if "models.compiled" in used}
        self.frozen = compiled.union({"models.compiled"}, *(self._imports[name] for name in compiled))
        """Modules whose code or constants machine code on disk may hold."""

    def of(self, module: str) -> tuple[list[Path], list[Path]]:
        """Tests of a module itself, and of what uses it, nearest first."""
        found: dict[Path, None] = {}
        near, reached = [module], {module}
        own = 0
        while near:
            for name in near:
                found |= dict.fromkeys(self._direct(name))
            own = own or len(found)
            near = [name for name, used in self._imports.items() if used & set(near) and name not in reached]
            reached |= set(near)
        ordered = list(found)
        own = min(own, _FIRST)
        return ordered[:own], ordered[own : own + _LATER]

    def _direct(self, module: str) -> list[Path]:
        file = self._modules[module].relative_to(ROOT)
        mirrored = ROOT / "tests" / file.parent / f"test_{file.name}"
        importing = [test for test, used in self._tested.items() if module in used and test != mirrored]
        importing.sort(key=lambda test: (test.parent != mirrored.parent, len(self._tested[test])))
        return [mirrored] * mirrored.exists() + importing

    def _imported(self, file: Path, name: str, helpers: Mapping[str, set[str]] = {}) -> set[str]:
        """Modules that a file imports, itself or through helpers."""
        found = set()
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                base = node.module or ""
                if node.level:
                    package = name.split(".") if file.name == "__init__.py" else name.split(".")[:-1]
                    parts = package[: len(package) + 1 - node.level]
                    base = ".".join((*parts, *([node.module] if node.module else [])))
                base = base.removeprefix("solidtouch.")
                found |= {base, *(f"{base}.{alias.name}".removeprefix("solidtouch.") for alias in node.names)}
            elif isinstance(node, ast.Import):
                found |= {alias.name.removeprefix("solidtouch.") for alias in node.names}
        return found.union(*(helpers[one] for one in found & set(helpers))) & set(self._modules)


class Run(NamedTuple):
    """What came of some tests.

    Attributes:
        outcome: `passed`, `failed` or `time-out`.
        test: The first that failed, or the one that did not end.
    """

    outcome: str
    test: str = ""


class Bench:
    """A copy of the packages in which one error at a time is planted.

    Args:
        folder: For the copy, made anew.
        limit_s: Most seconds that a test may take.
    """

    def __init__(self, folder: Path, limit_s: float) -> None:
        shutil.rmtree(folder, ignore_errors=True)
        for package in ("", *PACKAGES, "cli"):
            source = ROOT / (package or "solidtouch")
            shutil.copytree(source, folder / "solidtouch" / package, ignore=shutil.ignore_patterns("__pycache__"))
        self._folder, self._limit_s = folder, limit_s
        self._sound: dict[str, bool] = {}
        self._running: subprocess.Popen[bytes] | None = None
        self._stopped = False

    def judge(self, mutant: Mutant, tests: Tests) -> dict[str, Any]:
        """Plants an error and runs tests until one fails."""
        file, dotted = self._folder / "solidtouch" / mutant.module, _dotted(ROOT / mutant.module)
        source = file.read_text(encoding="utf-8")
        began, last = time.monotonic(), Run("passed")
        caches = self._folder / "numba"
        try:
            if dotted in tests.frozen:
                caches = Path(tempfile.mkdtemp(prefix="numba-", dir=self._folder))
            for files in tests.of(dotted):
                _write(file, mutant.planted(source))
                last = self._noticed([str(test.relative_to(ROOT)) for test in files], caches, file, source)
                if last.outcome != "passed":
                    break
        finally:
            _write(file, source)
            if caches.name != "numba":
                shutil.rmtree(caches, ignore_errors=True)
        outcome = {"passed": "survived", "failed": "caught", "time-out": "time-out"}[last.outcome]
        return {"outcome": outcome, "test": last.test, "seconds": round(time.monotonic() - began, 1)}

    def stop(self) -> None:
        """Ends what runs and lets nothing else begin."""
        self._stopped = True
        self._end()

    def _noticed(self, files: list[str], caches: Path, file: Path, source: str) -> Run:
        """The first failure that is due to the error, which is planted when this begins."""
        planted, left_out = file.read_text(encoding="utf-8"), []
        while True:
            run = self._pytest([*files, *(f"--deselect={test}" for test in left_out)], caches)
            if run.outcome == "passed":
                return run
            _write(file, source)
            if run.test not in self._sound:
                self._sound[run.test] = self._pytest([run.test], self._folder / "numba").outcome == "passed"
            if self._sound[run.test] or run.test in left_out:
                return run if self._sound[run.test] else Run("passed")
            left_out.append(run.test)
            _write(file, planted)

    def _pytest(self, words: list[str], caches: Path) -> Run:
        if self._stopped:
            return Run("passed")
        command = [sys.executable, "-m", "pytest", "-vx", "--tb=no", "-m", "not slow"]
        command += ["-p", "no:cacheprovider", "-p", "benchmarks.checks.mutants_plugin"]
        # The copy comes before the folder solidtouch of this repository.
        command += ["-o", f"pythonpath={shlex.quote(str(self._folder.resolve()))} . tests"]
        command += ["-o", f"faulthandler_timeout={self._limit_s}", "-o", "faulthandler_exit_on_timeout=true"]
        environment = os.environ | _ONE_THREAD
        environment |= {
            "PYTHONPATH": os.pathsep.join((str(self._folder.resolve()), str(ROOT))),
            "PYTHONSAFEPATH": "1",  # or the folder solidtouch of this repository came first
            "NUMBA_CACHE_DIR": str(caches),
        }
        with tempfile.TemporaryFile("w+") as output:
            process = subprocess.Popen(  # noqa: S603 - this project's own tests
                [*command, *words],
                cwd=ROOT,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
            self._running = process
            try:
                code = process.wait(_MOST_S)
            except subprocess.TimeoutExpired:
                return Run("passed")
            finally:
                self._end()
            output.seek(0)
            text = output.read()
        if code in {0, 5}:  # 5: all of these tests are slow
            return Run("passed")
        failed = re.findall(r"^(?:FAILED|ERROR) (\S*?\.py(?:::\w+)*)", text, re.MULTILINE)
        begun = re.findall(r"^(\S*?\.py(?:::\w+)+)", text, re.MULTILINE)
        if "Timeout (" in text and not failed:
            return Run("time-out", begun[-1] if begun else words[0])
        return Run("failed", (failed or begun[-1:] or words)[0])

    def _end(self) -> None:
        """Ends the tests that run, with every process that they have started."""
        process, self._running = self._running, None
        if process is not None:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def sample(number: int, only: str = "") -> list[Mutant]:
    """The first errors, the kinds in turn, at most one in a line."""
    by_kind: dict[str, list[Mutant]] = {}
    taken: set[tuple[str, int]] = set()
    for mutant in sorted(_all(only), key=lambda one: one.key):
        if (mutant.module, mutant.line) not in taken:
            taken.add((mutant.module, mutant.line))
            by_kind.setdefault(mutant.kind, []).append(mutant)
    ranked = [(rank, kind, one) for kind, of in by_kind.items() for rank, one in enumerate(of)]
    return [one for *_, one in sorted(ranked, key=lambda row: row[:2])][:number]


def _all(only: str) -> Iterator[Mutant]:
    for package in PACKAGES:
        for file in sorted((ROOT / package).glob("**/*.py")):
            module = file.relative_to(ROOT).as_posix()
            if not file.name.startswith(NOT_TESTED) and only in module:
                yield from mutants(module, file.read_text(encoding="utf-8"))


def judge_all(chosen: Iterable[Mutant], results: Path, workers: int, limit_s: float) -> None:
    """Judges errors side by side and adds a line for each to a file."""
    chosen, tests, number = list(chosen), Tests(), count(1)
    benches = [Bench(results.parent / f"mutants-{worker}", limit_s) for worker in range(workers)]
    idle, stopped = queue.SimpleQueue[Bench](), threading.Event()
    for bench in benches:
        idle.put(bench)

    def judge(mutant: Mutant) -> None:
        bench = idle.get()
        row = mutant._asdict() | bench.judge(mutant, tests)
        if stopped.is_set():
            return
        idle.put(bench)
        with results.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        place = f"{mutant.module}:{mutant.line}"
        print(
            f"{next(number)}/{len(chosen)} {row['outcome']} {row['seconds']:.0f} s {place} {_change(row)}", flush=True
        )

    with ThreadPoolExecutor(workers) as pool:
        try:
            list(pool.map(judge, chosen))
        except BaseException:
            stopped.set()
            pool.shutdown(wait=False, cancel_futures=True)
            for bench in benches:
                bench.stop()
            raise


def report(rows: list[dict[str, Any]], explained: dict[str, str]) -> str:
    """How many were caught, by package, and every survivor.

    Args:
        rows: The last result of each error; `first` is the outcome when it was planted for the first time.
        explained: Why no fast test can notice errors, by their key.
    """
    alive = [row for row in rows if row["outcome"] != "caught"]
    lines = []
    for package in (*PACKAGES, "all"):
        of = [row for row in rows if package in ("all", row["module"].partition("/")[0])]
        tally = Counter("explained" if row["key"] in explained else row["outcome"] for row in of)
        due = len(of) - tally["explained"]
        words = [str(tally[name]) for name in ("caught", "time-out", "explained", "survived")]
        at_first = sum(row["first"] == "caught" for row in of if row["key"] not in explained)
        shares = [share_interval(caught, due) if due else "-" for caught in (at_first, tally["caught"])]
        lines.append([package, str(len(of)), *words, *shares])
    head = ["package", "errors", "caught", "time-out", "explained", "survived", "caught at first", "caught now"]
    survivors = [
        [f"`{row['module']}`", f"`{row['scope']}`", _change(row), explained.get(row["key"], row["outcome"])]
        for row in sorted(alive, key=lambda row: (row["module"], row["line"]))
    ]
    return (
        table(head, lines)
        + "\n\n"
        + table(["file", "in", "error", "why no fast test notices it, or what came of it"], survivors)
    )


def _change(row: dict[str, Any]) -> str:
    old, new = (" ".join(row[name].split()).replace("|", "\\|") for name in ("old", "new"))
    return f"{row['kind']}: `{old[:90]}` → `{new[:90]}`"


def _dotted(file: Path) -> str:
    return ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def _write(file: Path, text: str) -> None:
    """Writes a source file and removes its byte code, which is told from newer one by whole seconds only."""
    file.write_text(text, encoding="utf-8")
    for code in file.parent.glob(f"__pycache__/{file.stem}.*"):
        code.unlink(missing_ok=True)


def main() -> None:
    """Runs the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--number", type=int, default=200, help="errors to plant")
    parser.add_argument("--only", default="", help="only in modules whose path contains this text")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--limit", type=float, default=90.0, help="time limit of one test, s")
    parser.add_argument("--results", type=Path, default=ROOT / "build" / "mutants.jsonl", help="file of results")
    parser.add_argument("--retry", action="store_true", help="judge survivors again, e.g. after adding tests")
    parser.add_argument("--document", type=Path, help="page to update")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    check_block(options.document, "mutants")
    options.results.parent.mkdir(parents=True, exist_ok=True)
    with Path(__file__).with_name("explained.toml").open("rb") as file:
        explained = tomllib.load(file)
    chosen, known = sample(options.number, options.only), _known(options.results)
    again = {key for key, row in known.items() if options.retry and row["outcome"] != "caught"} - set(explained)
    todo = [mutant for mutant in chosen if mutant.key not in known or mutant.key in again]
    judge_all(todo, options.results, options.workers, options.limit)
    known = _known(options.results)
    text = report([known[m.key] | {"line": m.line} for m in chosen], explained)
    print(text)
    if options.document:
        write_block(options.document, "mutants", text)


def _known(results: Path) -> dict[str, dict[str, Any]]:
    """The last result of each error, with the outcome of its first."""
    known: dict[str, dict[str, Any]] = {}
    for line in results.read_text(encoding="utf-8").splitlines() if results.exists() else []:
        row = json.loads(line)
        known[row["key"]] = row | {"first": known.get(row["key"], {"first": row["outcome"]})["first"]}
    return known


if __name__ == "__main__":
    main()
