"""The commands that are measured, with the most seconds and memory that each may take."""

import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from benchmarks.speed.rows import c_compiler

ROOT = Path(__file__).parents[3]
GIB = 2.0**30
MODEL, PROGRAM, RECORDING = "model.nc", "./solid", "large.nc"
TAPS = [f"session-{session}.nc" for session in range(3)]
THREE = "histogram,gaussian,profile"
LARGE = {False: (10_000, 400, 100, 50, 10), True: (60, 40, 10, 3, 2)}
"""Taps, samples, taxels, positions and objects of the large recording; True is the quick one."""


ROUNDS = 5
"""How often a command is measured."""


class Work(NamedTuple):
    """A command.

    Attributes:
        name: What the table calls it.
        words: Arguments; the first is `solidtouch` or `python` of an installation.
        most_s: The most seconds it may take; `None` without a limit.
        older: How often the older state is measured, of `ROUNDS`; fewer times where that takes minutes.
        quick: Further arguments that make it short; `None` if nothing does.
        most_bytes: The most memory it may take.
        inside: The function of which the program tells the seconds, as `file:name`; empty for the whole program.
    """

    name: str
    words: tuple[str, ...]
    most_s: float | None
    older: int = ROUNDS
    quick: tuple[str, ...] | None = ()
    most_bytes: float | None = None
    inside: str = ""


def _command(*words: str) -> tuple[str, ...]:
    return ("solidtouch", *words, "--out", "out", "--force")


_FEW = ("--draws", "100", "--trials", "100")
GAUSSIAN = ("profile", "profile-ar", "profile-mvn", "matrix-normal")
_TABLE = str(ROOT / "benchmarks" / "speed" / "commands" / "gaussian_table.py")
WORKS = (
    Work("`reproduce`", _command("reproduce"), 20, 3, ("--data-sets", "1", "--trials", "20")),
    Work("`reproduce --quick`", _command("reproduce", "--quick"), 8, 3, ("--data-sets", "1", "--trials", "20")),
    Work(
        "`audit`, three files of 1600 taps",
        _command("audit", *TAPS),
        20,
        3,
        ("--permutations", "99", "--trials", "100"),
    ),
    Work(
        "`audit --quick` of them",
        _command("audit", *TAPS, "--quick"),
        6.7,
        3,
        ("--trials", "100"),
    ),
    Work(
        "`compare` of three models, 2 x 1600 taps",
        _command("compare", *TAPS[:2], "--models", THREE),
        15,
        3,
        ("--models", "histogram", *_FEW),
    ),
    Work(
        "`compare --models all`, 2 x 1600 taps",
        _command("compare", *TAPS[:2], "--models", "all"),
        60,
        1,
        ("--models", "gaussian", *_FEW),
    ),
    Work(
        "`compare --models all --quick`",
        _command("compare", *TAPS[:2], "--models", "all", "--quick"),
        20,
        3,
        ("--models", "gaussian", "--trials", "100"),
    ),
    Work(
        "`strategies`",
        _command("strategies"),
        120,
        1,
        ("--presets", "ideal", "--data-sets", "2", "--trials", "50", "--no-regret"),
    ),
    Work(
        "`sensitivity`",
        _command("sensitivity"),
        60,
        1,
        ("--data-sets", "2", "--trials", "50", "--strongest", "0"),
    ),
    Work("`validate`", ("solidtouch", "validate"), 30, 1, None),
    Work(
        "`conformance check` of a C program",
        ("solidtouch", "conformance", "check", "--command", PROGRAM),
        5,
        quick=("--case", "shift-uniform"),
    ),
    Work(
        "`perceive` to the first tap, NumPyro",
        ("solidtouch", "perceive", MODEL, "--engine", "numpyro", "--deadline", "1"),
        2,
    ),
    *(
        Work(
            f"likelihood table of `{model}`, 1600 taps x 80 classes x 600 samples",
            ("python", "-P", _TABLE, model, *TAPS[:2]),
            0.5,
            inside="gaussian_table.py:table",
        )
        for model in GAUSSIAN
    ),
    Work(
        "`fit` of 10,000 taps of 400 samples x 100 taxels, 500 classes",
        ("solidtouch", "fit", RECORDING, "--out", "large-model.nc", "--force"),
        15,
        1,
        most_bytes=GIB,
    ),
    Work("`inspect` of it", ("solidtouch", "inspect", RECORDING), 8, most_bytes=GIB),
    Work("`import solidtouch`", ("python", "-P", "-c", "import solidtouch"), 0.1),
    Work("`solidtouch --help`", ("solidtouch", "--help"), 0.3),
)


def prepare(
    programs: Mapping[str, str], folder: Path, quick: bool, works: Sequence[Work], beside: Path | None = None
) -> None:
    """Writes what the commands need into a folder: taps, a model, a C program and the large recording.

    Args:
        programs: Paths of the programs of an installation.
        folder: The folder.
        quick: Whether the large recording is small.
        works: The commands.
        beside: Folder of another installation whose taps and C program are taken.

    Raises:
        RuntimeError: There is no C compiler, but a C program is to be checked; or a command fails.
    """
    words = {word for work in works for word in work.words}
    if beside is None and words & {*TAPS, MODEL}:
        _run([programs["solidtouch"], "simulate", "--sessions", "3", "--out", "."], folder)
    if beside is None and PROGRAM in words:
        compiler = c_compiler()
        if compiler is None:
            raise RuntimeError("There is no C compiler, neither $CC nor cc.")
        source = ROOT / "docs" / "reference" / "conformance" / "solid.c"
        _run([compiler, "-O2", "-std=c99", "-o", PROGRAM, str(source), "-lm"], folder)
    if beside is None and RECORDING in words:
        path = folder.resolve() / RECORDING
        _run([sys.executable, "-m", "benchmarks.speed.commands.large", str(path), *map(str, LARGE[quick])], ROOT)
    for path in () if beside is None else beside.iterdir():
        if path.name in {*TAPS, RECORDING, Path(PROGRAM).name}:
            (folder / path.name).hardlink_to(path)
    if MODEL in words:
        _run([programs["solidtouch"], "fit", *TAPS[:2], "--out", MODEL], folder)


def _run(words: list[str], folder: Path) -> None:
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)  # noqa: S603
    if done.returncode:
        raise RuntimeError(f"{' '.join(words)} failed:\n{done.stdout}{done.stderr}")


def called(work: Work, programs: Mapping[str, str]) -> list[str]:
    """Path of the program in an installation, and its arguments."""
    first, *others = work.words
    return [programs[first], *others]


def installed(venv: Path) -> dict[str, str]:
    """Paths of the programs in a virtual environment.

    Raises:
        ValueError: One is missing.
    """
    programs = {name: venv / "bin" / name for name in ("solidtouch", "python")}
    for path in programs.values():
        if not path.is_file():
            raise ValueError(f"{path} is missing: install the program in the virtual environment {venv}.")
    return {name: str(path) for name, path in programs.items()}
