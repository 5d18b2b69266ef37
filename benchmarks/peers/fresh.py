"""`solidtouch validate` in fresh installations of the wheel, without this checkout.

    python -m benchmarks.peers.fresh --python PATH... --document docs/explanation/peers.md

For each Python: a new environment, the wheel and its dependencies, and `validate` twice in an empty folder: first with
nothing compiled, then with what the first run has left.
"""

import os
import platform
import subprocess
import sys
from argparse import ArgumentParser
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.checks.house import ROOT
from benchmarks.page import parsed, table, write_block
from benchmarks.speed.commands.process import Spent, spent

BLOCK = "fresh"
LIMIT_S = 30


def built(folder: Path) -> Path:
    """A wheel of this checkout, by way of a source distribution."""
    print("Building the wheel ...", file=sys.stderr)
    _quietly(sys.executable, "-m", "build", "--outdir", folder, ROOT)
    return next(folder.glob("*.whl"))


def environment(python: str, wheel: Path, folder: Path) -> Path:
    """A new environment in a folder with the wheel; the path of its `solidtouch`."""
    print(f"Installing it for {python} ...", file=sys.stderr)
    _quietly(python, "-m", "venv", folder)
    own = folder / "bin" / "python"
    _quietly(own, "-m", "pip", "install", "--disable-pip-version-check", "-c", ROOT / "constraints.txt", wheel)
    return own.with_name("solidtouch")


def validated(program: Path, folder: Path) -> list[Spent]:
    """What `validate` takes in an empty folder, the first time and again.

    Raises:
        RuntimeError: A check fails.
    """
    folder.mkdir()
    variables = {"XDG_CACHE_HOME": str(folder / "cache"), "PYTHONPATH": "", "NUMBA_CACHE_DIR": ""}
    print("Running validate, twice ...", file=sys.stderr)
    return [spent([str(program), "validate"], folder, variables) for _ in range(2)]


def lines(version: str, runs: list[Spent]) -> list[list[str]]:
    """Rows of the table of one Python."""
    return [
        [
            version,
            when,
            f"{run.seconds:.0f} s",
            f"{run.processor_s:.0f} s",
            f"{run.processor_s / 2:.0f} s",
            f"{run.others:.0%}",
        ]
        for when, run in zip(("first", "again"), runs, strict=True)
    ]


def _quietly(*words: object) -> None:
    """Runs a program, whose output is shown only if it fails."""
    given = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run([*map(str, words)], env=given, capture_output=True, text=True, check=False)  # noqa: S603
    if done.returncode:
        sys.exit(f"{' '.join(map(str, words))} ended with exit code {done.returncode}:\n{done.stdout}{done.stderr}")


def main() -> None:
    """Tries every Python and writes the page; ends with an error where `validate` fails."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--python", nargs="+", default=[sys.executable], help="programs to make environments with")
    options = parsed(parser, BLOCK)
    rows = []
    with TemporaryDirectory() as folder:
        wheel = built(Path(folder, "dist"))
        for number, python in enumerate(options.python):
            version = subprocess.run([python, "--version"], capture_output=True, text=True, check=True).stdout.strip()  # noqa: S603
            program = environment(python, wheel, Path(folder, f"environment-{number}"))
            rows += lines(version, validated(program, Path(folder, f"run-{number}")))
    head = ["", "run", "time", "processor time", "half of it", "others took"]
    text = f"On {platform.machine()} with {os.cpu_count()} cores; all checks passed.\n\n{table(head, rows)}"
    print(text)
    write_block(options.document, BLOCK, text)


if __name__ == "__main__":
    main()
