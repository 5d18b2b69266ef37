"""Calls commands with damaged command lines; a part of `make fuzz`.

Valid command lines over small files, and an emulated bench, are changed at random: words are lost, repeated, exchanged,
or replaced by extreme ones, and options of the command are added. A command must do its work or refuse it: no
traceback, no crash, not more than 1 GB, and a refusal within 10 s. Lines that begin real work are stopped after these
10 s.
"""

import argparse
import io
import math
import multiprocessing
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import track

from benchmarks.page import check_block, table, write_rows

ENDS = ("done", "refused", "stopped", "traceback", "crash", "memory")
_SECONDS, _BYTES = 10.0, 1 << 30
_LOADED = (
    "__main__",
    "solidtouch.cli.main",
    "h5netcdf",
    "matplotlib.figure",
    "numba",
    "pandas",
    "scipy.stats",
    "xarray",
)
"""What lines begin with, but for JAX, which must not be forked."""
_CODES = {1, 2, 3, 130}
_WORDS = (
    *("", "-1", "0", "1e308", "nan", "inf", "9" * 400, "-", "--", "--help", ".", "no/such/file.nc", "a" * 10_000),
    *("\N{PILE OF POO}", "\x1b[31m", "%s{0}", "$(x)", "1,2,3", "true", "*", "none"),
)  # no path outside the folder, which a line may overwrite
_GIVEN = (
    "1",
    "2",
    "0.5",
    "0.9",
    "1mm",
    "what:0.9",
    "taps.nc",
    "model.nc",
    "setting.json",
    "targets.json",
    "all",
    "thin",
)
LINES = (
    "inspect taps.nc",
    "convert taps.npz out.nc --force",
    "convert taps.csv out.nc --force --where-unit mm",
    "fit taps.nc --out out.nc --force --split parity --model gaussian --bins 20",
    "fit taps.nc other.nc --out out.nc --force --power J --pseudocount 0.5",
    "trials model.nc other.nc --trials 50 --thresholds 0.5,0.9",
    "perceive ideal.nc --rig simulated:ideal --episodes 2 --seed 1 --deadline 5",
    "perceive model.nc --rig replay:other.nc --object thin --start 0 --stop what:0.9",
    "export-model model.nc --format json --out out.json --force",
    "simulate --preset ideal --sessions 1 --seed 3 --out out --force",
    "tune taps.nc other.nc --out out.json --force --trials 100",
    "crosscheck taps.nc --split parity --episodes 1",
    "audit taps.nc other.nc --quick --out out --force",
    "compare taps.nc other.nc --quick --models gaussian --out out --force --draws 100 --trials 100",
    "reproduce --data taps.nc other.nc --quick --trials 20 --out out --force",
    "sweep swept.toml --out out.zarr --workers 1",
    "sensitivity --data-sets 1 --trials 50 --out out --force",
    "strategies --presets ideal --data-sets 2 --trials 50 --no-regret --out out --force",
    "validate --seed 1",
    "conformance list",
    "conformance check --answers answers --case root-j",
    "conformance check --command true --case shift-uniform --timeout 1",
    "conformance export out --case root-j --force",
    "rig check bench/rig.toml --seconds 1 --home --yes",
    "rig approach bench/rig.toml --at 3",
    "collect bench/rig.toml small.toml --out out.mcap --session 1 --home --yes",
    "emulate --out another --preset ideal --seed 1",
    "emulate fault bench jump:times=1 --off",
    "emulate object bench 2",
)  # fmt: skip


def options() -> dict[str, list[str]]:
    """Options of each command."""
    from solidtouch.cli.main import app  # noqa: PLC0415
    from typer.main import get_command  # noqa: PLC0415

    found: dict[str, list[str]] = {}

    def visit(command: Any, *names: str) -> None:
        known = [name for each in command.params for name in (*each.opts, *each.secondary_opts)]
        found[" ".join(names)] = ["--help", *(name for name in known if name.startswith("-"))]
        for name, part in getattr(command, "commands", {}).items():
            visit(part, *names, name)

    visit(get_command(app))
    return found


def mutated(words: Sequence[str], generator: random.Random, known: Mapping[str, Sequence[str]]) -> list[str]:
    """The words with one to three changes; options are from those known of each command."""
    changed = list(words)
    own = known.get(" ".join(words[:2])) or known[words[0]]
    for _ in range(generator.choice((1, 1, 2, 3))):
        at = generator.randrange(len(changed)) if changed else 0
        other = generator.choice(generator.choice(LINES).split())
        match generator.randrange(8):
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
            case 5 | 6:
                given = generator.choice((*_WORDS, *_GIVEN, other))
                changed += generator.choice(([generator.choice(own)], [generator.choice(own), given]))
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


@contextmanager
def emulated_bench(folder: Path) -> Iterator[Callable[[], None]]:
    """What starts an emulated bench in a folder if it does not run; it ends with the block."""
    running: list[subprocess.Popen[bytes]] = []

    def start() -> None:
        if running and running[-1].poll() is None:
            return
        shutil.rmtree(folder, ignore_errors=True)
        words = [sys.executable, "-m", "solidtouch.cli", "emulate", "--out", str(folder), "--preset", "ideal"]
        running.append(subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))  # noqa: S603
        while running[-1].poll() is None and not (folder / "control").exists():
            time.sleep(0.05)

    try:
        yield start
    finally:
        for process in running:
            process.kill()
            process.wait()


def run(number: int, seed: int, minutes: float = math.inf) -> tuple[dict[str, Counter[str]], list[str]]:
    """How so many changed lines of each valid one ended, in these minutes, and what must not be, one sentence each."""
    end_s = time.monotonic() + 60 * minutes
    multiprocessing.get_context("forkserver").set_forkserver_preload(list(_LOADED))
    generator = random.Random(seed)  # noqa: S311 - no secret
    counts: dict[str, Counter[str]] = {}
    wrong = []
    with tempfile.TemporaryDirectory() as whole, tempfile.TemporaryDirectory() as place:
        write_inputs(Path(whole))
        known, bench = options(), Path(place, "bench")
        todo = [line for _ in range(number) for line in LINES]
        with emulated_bench(bench) as start:
            for line in track(todo, description="Calling", console=Console(stderr=True)):
                if time.monotonic() > end_s:
                    break
                words = mutated(line.split(), generator, known)
                if "bench" in line:
                    start()
                with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
                    shutil.copytree(whole, folder, dirs_exist_ok=True)
                    Path(folder, "bench").symlink_to(bench)
                    end, said = ended(words, Path(folder))
                counts.setdefault(line.split()[0], Counter())[end] += 1
                if end in ("traceback", "crash", "memory"):
                    wrong.append(f"{end}: {words!r}: {said[-600:]}")
                    print(wrong[-1], file=sys.stderr, flush=True)
    return counts, wrong


def write_inputs(folder: Path) -> None:
    """Writes the files of the lines."""
    import solidtouch as st  # noqa: PLC0415
    from benchmarks.checks.fuzz_sources import write_files  # noqa: PLC0415 - each command would import it

    write_files(folder)
    taps = st.load_taps(folder / "taps.nc")
    st.TapSet(taps.dataset.assign(taps=taps.dataset["taps"] + 0.25)).save(folder / "other.nc")
    st.fit(st.simulate("ideal", sessions=1, seed=3)[0]).save(folder / "ideal.nc")
    plan = 'positions = [1.5, 2.5]\nsettle_taps = 0\nobjects = [{ name = "8 mm rod", size_mm = 8 }]\n'
    (folder / "small.toml").write_text(plan, encoding="utf-8")


def main() -> None:
    """Calls, and prints what came of it; exit code 1 if something is that must not be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lines", type=int, default=10, help="changed lines of each valid one")
    parser.add_argument("--minutes", type=float, default=math.inf, help="end after this time")
    parser.add_argument("--seed", type=int, default=0, help="random seed")
    parser.add_argument("--document", type=Path, help="page whose table to update")
    arguments = parser.parse_args()
    check_block(arguments.document, "commands")
    counts, wrong = run(arguments.lines, arguments.seed, arguments.minutes)
    rows = [[name, *(str(count[end]) for end in ENDS)] for name, count in counts.items()]
    print(table(["command", *ENDS], rows))
    write_rows(arguments.document, "commands", ["command", *ENDS], rows)
    for sentence in wrong:
        print(f"! {sentence}")
    if wrong:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
