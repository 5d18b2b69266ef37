"""Calls commands with damaged command lines; a part of `make fuzz`.

Valid command lines over small files are changed at random: words are lost, repeated, exchanged, or replaced by extreme
ones. A command must do its work or refuse it: no traceback, no crash, not more than 1 GB, and a refusal within 10 s.
Lines that begin real work are stopped after these 10 s.
"""

import argparse
import io
import multiprocessing
import os
import random
import resource
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from multiprocessing.connection import Connection
from pathlib import Path

from rich.console import Console
from rich.progress import track

from benchmarks.page import table

ENDS = ("done", "refused", "stopped", "traceback", "crash", "memory")
_SECONDS, _BYTES = 10.0, 1 << 30
_CODES = {1, 2, 3, 130}
_WORDS = (
    *("", "-1", "0", "1e308", "nan", "inf", "9" * 400, "-", "--", "--help", ".", "no/such/file.nc", "a" * 10_000),
    *("\N{PILE OF POO}", "\x1b[31m", "%s{0}", "$(x)", "1,2,3", "true", "*", "none"),
)  # no path outside the folder, which a line may overwrite
LINES = (
    "inspect taps.nc",
    "convert taps.npz out.nc --force",
    "convert taps.csv out.nc --force --where-cell 1mm",
    "fit taps.nc --out out.nc --force --split parity --model gaussian --bins 20",
    "fit taps.nc taps.npz --out out.nc --force --power J --pseudocount 0.5",
    "trials model.nc taps.nc --trials 50 --thresholds 0.5,0.9 --training-taps",
    "perceive model.nc --rig simulated --episodes 2 --seed 1 --deadline 5",
    "perceive model.nc --rig replay:taps.nc --training-taps --object thin --start 0 --stop what:0.9",
    "export-model model.nc --format json --out out.json --force",
    "simulate --preset ideal --sessions 1 --seed 3 --out out --force",
    "tune taps.nc taps.npz --out out.json --force --trials 100",
    "crosscheck taps.nc --episodes 1 --deadline 3",
    "audit taps.nc taps.npz taps.csv --quick --out out --force --pre 1",
    "compare taps.nc --quick --models gaussian --out out --force --draws 10 --trials 100",
    "reproduce --data taps.nc taps.npz --quick --trials 20 --out out --force",
    "sweep study.toml --out out.zarr --workers 1",
    "sensitivity --data-sets 1 --trials 20 --out out --force",
    "strategies --presets ideal --data-sets 1 --trials 10 --no-regret --out out --force",
    "conformance list",
    "conformance check --command true --case shift-uniform --timeout 1",
    "conformance export --out out",
    "rig check rig.toml --seconds 1 --home --yes",
    "rig approach rig.toml --at 3",
    "collect rig.toml plan.toml --out out.mcap --session 1 --home --yes",
    "emulate fault bench unplug:times=1 --off",
)  # fmt: skip


def mutated(words: Sequence[str], generator: random.Random) -> list[str]:
    """The words with one to three changes."""
    changed = list(words)
    for _ in range(generator.choice((1, 1, 2, 3))):
        at = generator.randrange(len(changed)) if changed else 0
        other = generator.choice(generator.choice(LINES).split())
        match generator.randrange(6):
            case 0:
                del changed[at : at + 1]
            case 1:
                changed[at:at] = changed[at : at + 1]
            case 2:
                changed[at : at + 1] = [generator.choice(_WORDS)]
            case 3:
                changed[at:at] = [other]
            case 4:
                changed[at : at + 1] = [other]
            case _:
                word = changed[at] if changed else ""
                cut = generator.randrange(len(word) + 1)
                changed[at : at + 1] = [word[:cut] + generator.choice(_WORDS)[:20] + word[cut:]]
    return [word.replace("\0", "") for word in changed]


def call(words: Sequence[str], folder: str, told: Connection) -> None:
    """One command in this process, which ends with it; tells the exit code, what was said, and the peak memory."""
    os.chdir(folder)
    sys.argv = ["solidtouch", *words]
    from solidtouch.cli.main import run  # noqa: PLC0415

    said, code = io.StringIO(), 0
    sys.stdin = io.StringIO()
    try:
        with redirect_stdout(said), redirect_stderr(said):
            run()
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else 0 if stop.code is None else 1
    except BaseException:  # what no command may raise
        code = -1
        said.write(traceback.format_exc())
    told.send((code, said.getvalue(), 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss))
    told.close()
    os._exit(0)


def ended(words: Sequence[str], folder: Path) -> tuple[str, str]:
    """How a command ended, one of `ENDS`, and what it said."""
    context = multiprocessing.get_context("forkserver")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=call, args=(list(words), str(folder), sender))
    process.start()
    sender.close()
    try:
        if not receiver.poll(_SECONDS):
            process.kill()
            return "stopped", ""
        code, said, peak = receiver.recv()
    except EOFError:
        process.join()
        return "crash", f"exit code {process.exitcode}"
    finally:
        process.join()
    if code not in {0, *_CODES} or "Traceback (most recent call last)" in said:
        return "traceback", said
    if peak > _BYTES:
        return "memory", f"{peak >> 20} MiB"
    return ("done" if code == 0 else "refused"), said


def run(number: int, seed: int) -> tuple[dict[str, Counter[str]], list[str]]:
    """How so many changed lines of each command ended, and what must not be, one sentence each."""
    from benchmarks.checks.fuzz_sources import write_files  # noqa: PLC0415 - each command would import it

    multiprocessing.get_context("forkserver").set_forkserver_preload(["solidtouch.cli.main"])
    generator = random.Random(seed)  # noqa: S311 - no secret
    counts: dict[str, Counter[str]] = {}
    wrong = []
    with tempfile.TemporaryDirectory() as folder:
        write_files(Path(folder))
        todo = [line for line in LINES for _ in range(number)]
        for line in track(todo, description="Calling", console=Console(stderr=True)):
            words = mutated(line.split(), generator)
            end, said = ended(words, Path(folder))
            counts.setdefault(line.split()[0], Counter())[end] += 1
            if end in ("traceback", "crash", "memory"):
                wrong.append(f"{end}: {words!r}: {said[-600:]}")
    return counts, wrong


def main() -> None:
    """Calls, and prints what came of it; exit code 1 if something is that must not be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lines", type=int, default=40, help="changed lines of each valid one")
    parser.add_argument("--seed", type=int, default=0, help="random seed")
    options = parser.parse_args()
    counts, wrong = run(options.lines, options.seed)
    print(table(["command", *ENDS], [[name, *(str(count[end]) for end in ENDS)] for name, count in counts.items()]))
    for sentence in wrong:
        print(f"! {sentence}")
    if wrong:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
