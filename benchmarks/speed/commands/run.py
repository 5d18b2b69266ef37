"""Measures the commands that users wait for; a part of `make bench`.

Every run is a fresh process of the installed program, after one that fills the caches of compiled code. With an older
installation, both run in turn in each round. Where the time goes is sampled in one more run.
"""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from benchmarks.page import check_block, write_block
from benchmarks.speed.commands.process import Spent, spent
from benchmarks.speed.commands.stages import functions, shares, stacks
from benchmarks.speed.commands.table import Stored, Timed, commands_table, load, stored
from benchmarks.speed.commands.works import ROUNDS, WORKS, Work, called, installed, prepare
from benchmarks.speed.report import machine_list
from benchmarks.speed.rows import machine
from benchmarks.study import write_json

BLOCK = "commands"
MOST_FUNCTIONS = 200


def main() -> None:
    """Runs the benchmarks as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="tiny sizes and one round, to test that everything runs")
    parser.add_argument("--out", type=Path, default=Path("runs/benchmarks"), help="output folder")
    parser.add_argument("--document", type=Path, help="page to update")
    parser.add_argument("--before", type=Path, help="folder of an older state of this repository with its .venv")
    parser.add_argument("--only", action="append", metavar="TEXT", help="only commands with this in their name")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="rounds of every command")
    options = parser.parse_args()
    check_block(options.document, BLOCK)
    works = [work for work in WORKS if any(text in work.name for text in options.only or [""])]
    if not works:
        parser.error(f"--only: no command has {' or '.join(options.only)} in its name.")
    if options.quick:
        options.rounds = 1
        works = [work._replace(words=(*work.words, *work.quick)) for work in works if work.quick is not None]
    kept = stored(options.document, BLOCK)
    where = machine_list(machine())
    if len(works) < len(WORKS) and kept.rows and kept.head.splitlines()[0] != where.splitlines()[0]:
        parser.error("--only: the other rows of the page are of another machine; measure all.")
    timed = measured(works, options.rounds, options.quick, options.before, options.out)
    text = page(timed, where, "" if options.before is None else revision(options.before), kept)
    print(text)
    write_block(options.document, BLOCK, text)


def page(timed: Sequence[Timed], where: str, older: str, kept: Stored) -> str:
    """The machine, its load and the table."""
    head = "\n".join([*where.splitlines()[:3], load(timed)])
    return f"{head}\n\n{commands_table(timed, WORKS, older, kept)}"


def measured(works: Sequence[Work], rounds: int, quick: bool, before: Path | None, out: Path) -> list[Timed]:
    """Measures commands, each round of both installations in turn, and writes the rounds and functions as JSON."""
    venvs = {"now": Path(sys.prefix), **({} if before is None else {"before": before.resolve() / ".venv"})}
    programs = {name: installed(venv) for name, venv in venvs.items()}
    timed = []
    with tempfile.TemporaryDirectory() as folder:
        folders = {name: Path(folder) / name for name in programs}
        for name, path in folders.items():
            path.mkdir()
            prepare(programs[name], path, quick, works, None if name == "now" else folders["now"])
        for work in works:
            print(f"Measuring {work.name} ...", file=sys.stderr)
            one, named = _timed(work, rounds, programs, folders)
            timed.append(one)
            write_json(BLOCK, {"works": [each._asdict() for each in timed]}, out)
            write_json(f"functions-{_file_name(work)}", named, out / "functions")
    return timed


def _timed(
    work: Work, rounds: int, programs: dict[str, dict[str, str]], folders: dict[str, Path]
) -> tuple[Timed, dict[str, float]]:
    runs: dict[str, list[Spent]] = {"now": [], "before": []}
    words = {name: called(work, paths) for name, paths in programs.items()}
    most = {"now": rounds, "before": min(rounds, work.older)}
    for turn in range(rounds + 1):
        for name in list(words)[:: 1 if turn % 2 else -1]:
            # The first fills caches, which hardly matter to a command measured once.
            if len(runs[name]) == most[name] or (turn == 0 and most[name] == 1):
                continue
            try:
                took = spent(words[name], folders[name], inside=bool(work.inside))
            except RuntimeError as error:
                if name == "now":
                    raise
                print(f"Left out, the older state fails: {error}", file=sys.stderr)
                del words[name]
                runs[name].clear()
                continue
            if turn:
                runs[name].append(took)
    counted = stacks(words["now"], folders["now"], work.inside)
    named = dict(list(functions(counted).items())[:MOST_FUNCTIONS])
    return Timed(work, runs["now"], runs["before"], shares(counted)), named


def revision(folder: Path) -> str:
    """The commit of a checkout."""
    words = ["git", "-C", str(folder), "rev-parse", "--short", "HEAD"]
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip()  # noqa: S603


def _file_name(work: Work) -> str:
    return "-".join("".join(letter if letter.isalnum() else " " for letter in work.name).split()[:6])


if __name__ == "__main__":
    main()
