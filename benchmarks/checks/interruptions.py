"""Interrupts commands at random moments, fills their disks, and starts them twice; a part of `make kills`.

Each command runs in a process of its own on small data, once to its end, then again and again. It must leave its
output whole or not at all, no temporary file unless it was killed, no child process and no traceback, and it must end
soon. `benchmarks.checks.kills` does the same to data collections.
"""

import argparse
import random
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from benchmarks.page import block_of, check_block, table, table_rows, write_block

from .disturbed import SIGNALS, Outcome, Trial, Tried

BLOCK = "interruptions"
_STUDY = """
name = "small"
trials = 200
thresholds = [0.5, 0.9]
[[data]]
name = "ideal"
preset = "ideal"
seeds = [0]
[grid]
pseudocount = [0.01, 0.1, 1.0]
policy = ["passive", "active"]
fixation = [4, 8]
"""
COMMANDS = {
    "reproduce": Tried(("reproduce", "--data", "a.nc", "b.nc", "--quick", "--trials", "20", "--out", "out"), "out"),
    "audit": Tried(("audit", "a.nc", "b.nc", "c.nc", "--quick", "--trials", "100", "--out", "out"), "out"),
    "compare": Tried(
        ("compare", "a.nc", "b.nc", "--models", "histogram,gaussian", "--quick", "--trials", "100", "--out", "out"),
        "out",
    ),
    "strategies": Tried(
        ("strategies", "--presets", "ideal", "--data-sets", "2", "--trials", "50", "--no-regret", "--out", "out"), "out"
    ),
    "sweep": Tried(("sweep", "study.toml", "--out", "out.zarr"), "out.zarr", resumes=True),
    "convert": Tried(("convert", "large.npz", "out.nc"), "out.nc"),
    "export-model": Tried(("export-model", "model.nc", "--format", "json", "--out", "out.json"), "out.json"),
}


def prepare(folder: Path) -> None:
    """Writes the inputs of all commands."""
    program = [sys.executable, "-m", "solidtouch.cli"]

    def call(*words: str) -> None:
        subprocess.run([*program, *words], cwd=folder, check=True, stdout=subprocess.DEVNULL)  # noqa: S603

    call("simulate", "--preset", "ideal", "--sessions", "3", "--out", ".")
    for number, name in enumerate("abc"):
        (folder / f"session-{number}.nc").rename(folder / f"{name}.nc")
    call("fit", "a.nc", "b.nc", "--out", "model.nc")
    (folder / "study.toml").write_text(_STUDY)
    rng = np.random.default_rng(0)
    np.savez(
        folder / "large.npz",
        taps=rng.normal(size=(4000, 100, 12)).astype(np.float32),
        what=np.arange(4000) % 4,
        what_names=np.array(["a", "b", "c", "d"]),
    )


def run(names: Sequence[str], moments: int, seed: int) -> Iterator[tuple[str, Outcome]]:
    """Each command and its outcome; `moments` of each signal, and a tenth as many of the others, at least two."""
    with tempfile.TemporaryDirectory() as folder:
        prepare(Path(folder))
        for name in names:
            generator = random.Random(f"{seed} {name}")  # noqa: S311 - no secret
            trial = Trial(name, COMMANDS[name], Path(folder), generator)
            few = max(2, moments // 10)
            shares = [0.0, *(generator.uniform(0.05, 0.95) for _ in range(few))]
            todo = [partial(trial.interrupt, number) for number in SIGNALS for _ in range(moments)]
            todo += [*(partial(trial.fill, share) for share in shares), *[trial.twice, trial.jump] * few]
            for act in track(todo, description=name, console=Console(stderr=True)):
                _while_not_held(trial, act)
            yield name, trial.outcome


def _while_not_held(trial: Trial, act: Callable[[], None]) -> None:
    """Tries something again if this program was itself stopped meanwhile, which would look like slowness."""
    held = True
    while held:
        held, before = False, deepcopy(trial.outcome)

        def note(*_: object) -> None:
            nonlocal held
            held = True

        signal.signal(signal.SIGCONT, note)
        act()
        if held:
            trial.outcome = before


_COLUMNS = (
    *("command", "interrupted", "nothing left", "whole output", "temporary files", "slowest end"),
    *("disk full or read-only", "started twice", "clock jumps", "wrong"),
)


def outcome_table(outcomes: Mapping[str, Outcome], kept: Mapping[str, Sequence[str]]) -> str:
    """A row for each command: how often its runs ended how. Commands that were not tried keep their row."""
    names = {f"`{name}`": name for name in COMMANDS}
    rows = [
        _cells(head, outcomes[name]) if name in outcomes else kept[head]
        for head, name in names.items()
        if name in outcomes or head in kept
    ]
    return table(_COLUMNS, rows)


def _cells(head: str, outcome: Outcome) -> list[str]:
    numbers = [number.name for number in SIGNALS]

    def total(word: str, *kinds: str) -> int:
        return sum(outcome.counts[kind, word] for kind in kinds)

    resumed = total("resumed", *numbers)
    disks = "full disk", "read-only"
    twice = [f"{n} {word}" for word in ("one refused", "both ended", "both refused") if (n := total(word, "twice"))]
    return [
        head,
        " + ".join(str(outcome.runs[number]) for number in numbers),
        str(total("no output", *numbers)),
        str(total("whole output", *numbers)) + (f", {resumed} of them resumed" if resumed else ""),
        str(total("temporary files", *numbers)),
        f"{outcome.slowest_s:.1f} s",
        f"{total('refused', *disks)} of {sum(outcome.runs[kind] for kind in disks)} refused",
        ", ".join(twice),
        f"{outcome.runs['clock']}",
        f"{len(outcome.wrong)}",
    ]


def main() -> None:
    """Interrupts, and prints what came of it; exit code 1 if something is that must not be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moments", type=int, default=30, help="number of each signal to each command")
    parser.add_argument("--only", action="append", choices=COMMANDS, help="only this command; repeatable")
    parser.add_argument("--seed", type=int, default=0, help="random seed")
    parser.add_argument("--document", type=Path, help="page to update")
    options = parser.parse_args()
    check_block(options.document, BLOCK)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a script may have started this with Ctrl-C ignored
    outcomes, text = dict[str, Outcome](), ""
    for name, outcome in run(options.only or list(COMMANDS), options.moments, options.seed):
        outcomes[name] = outcome
        for sentence in outcome.wrong:
            print(f"! {sentence}", flush=True)
        text = outcome_table(outcomes, table_rows(block_of(options.document, BLOCK)))
        write_block(options.document, BLOCK, text)
    print(text)
    if any(outcome.wrong for outcome in outcomes.values()):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
