"""Runs every known implementation that this machine can through the conformance kit, into the table of its page.

    python -m benchmarks.checks.implementations --document docs/reference/conformance/README.md

Rows of programs whose compiler or interpreter is not here stay as they are, with the version of the kit that they
passed.
"""

import os
import platform
import re
import shutil
import subprocess
import sys
from argparse import ArgumentParser
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from solidtouch.analysis.conformance.case import LEVELS
from solidtouch.analysis.conformance.engines import ROUTES
from solidtouch.analysis.conformance.front import cases, expected, run_engine, run_program
from solidtouch.analysis.conformance.report import ConformanceReport

from benchmarks.page import parsed, write_rows
from benchmarks.study import until_interrupted

SOURCES = Path("docs/reference/conformance")
HEAD = ["implementation", "run by", "kit", "passes", "cases", "processor seconds"]


class Implementation(NamedTuple):
    """One implementation.

    Attributes:
        name: What the table calls it.
        run: Checks it.
        how: What runs it, with its version.
    """

    name: str
    run: Callable[[], ConformanceReport]
    how: str


def implementations(folder: Path) -> Iterator[Implementation]:
    """All that this machine can run; programs are compiled into a folder."""
    for engine in ROUTES:
        yield Implementation(
            f"engine `{engine}` of this software", partial(run_engine, engine), f"Python {platform.python_version()}"
        )
    if compiler := shutil.which("cc"):
        for precision, options in (("double", []), ("single", ["-DSOLIDTOUCH_REAL=float"])):
            program = folder / precision
            _build(compiler, "-O2", "-std=c99", *options, "-o", program, SOURCES / "solid.c", "-lm")
            run = partial(run_program, [str(program)], precision=precision)
            yield Implementation(f"[solid.c](solid.c), {precision} precision", run, _version(compiler))
    if node := shutil.which("node"):
        yield Implementation(
            "[solid.js](solid.js)", partial(run_program, [node, str(SOURCES / "solid.js")]), f"Node.js {_version(node)}"
        )
    if compiler := shutil.which("rustc"):
        _build(compiler, "-O", "-o", folder / "rust", SOURCES / "solid.rs")
        yield Implementation("[solid.rs](solid.rs)", partial(run_program, [str(folder / "rust")]), _version(compiler))
    words = [sys.executable, str(SOURCES / "solid.py")]
    run = partial(run_program, words, levels=tuple(LEVELS), together=True)
    yield Implementation("[solid.py](solid.py)", run, f"Python {platform.python_version()}")
    if octave := shutil.which("octave-cli"):
        words = [octave, "--quiet", "--path", str(SOURCES), "--eval", "solid"]
        yield Implementation("[solid.m](solid.m)", partial(run_program, words, together=True), _version(octave))


def _build(*words: str | Path) -> None:
    subprocess.run([*map(str, words)], check=True)  # noqa: S603 - a compiler and a source of this repository


def _version(tool: str) -> str:
    """What a tool says of itself in its first line."""
    said = subprocess.run([tool, "--version"], capture_output=True, text=True, check=True)  # noqa: S603 - as above
    return re.sub(r" \(.*?\)|^v", "", said.stdout.splitlines()[0])


def row(one: Implementation) -> list[str]:
    """The row of an implementation in the table; its time is that of processors, also of the comparison."""
    start = sum(os.times()[:4])
    report = one.run()
    seconds = sum(os.times()[:4]) - start
    passed = [level.level for level in report.levels.values() if level.passes]
    statuses = [verdict.status for verdict in report.found.values()]
    numbers = {word: statuses.count(word) for word in ("pass", "differs", "failed", "left out")}
    cases = ", ".join(f"{number} {word}" for word, number in numbers.items() if number)
    levels, taken = ", ".join(passed) or "none", f"{seconds:.0f}" if seconds >= 1 else "<1"
    return [one.name, one.how, report.kit.version, levels, cases, taken]


def main() -> None:
    """Runs them, prints a row for each and updates the table."""
    options = parsed(ArgumentParser(description=__doc__), "implementations")
    for case in cases():
        expected(case.name)  # its exact answers are computed once, and would count for the first one
    rows = []
    with TemporaryDirectory() as folder:
        found = [*implementations(Path(folder))]
        for line in until_interrupted("Implementations", [partial(row, one) for one in found]):
            print(*line, sep=" | ", flush=True)
            rows.append(line)
    write_rows(options.document, "implementations", HEAD, rows)
    sys.exit(any("differs" in line[4] or "failed" in line[4] for line in rows))


if __name__ == "__main__":
    main()
