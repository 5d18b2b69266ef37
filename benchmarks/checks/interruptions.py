"""Interrupts commands at random moments, fills their disks, and starts them twice; a part of `make kills`.

Each command runs in a process of its own on small data, once to its end, then again and again. It must leave its
output whole or not at all, no temporary file unless it was killed, no child process and no traceback, and it must end
soon. `benchmarks.checks.kills` does the same to data collections.
"""

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import track

from benchmarks.page import check_block, table, write_block

BLOCK = "interruptions"
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
_CODES = {signal.SIGINT: {130, -2}, signal.SIGTERM: {143, -15}, signal.SIGKILL: {-9}}
_END_S = 30.0
_SOON_S = 10.0
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
_JUMP = """
import random, time
_time, _jump = time.time, random.Random(0)
_offset = [0.0]
def jumping():
    if _jump.random() < 0.01:
        _offset[0] = _jump.uniform(-1e6, 1e6)
    return _time() + _offset[0]
time.time = jumping
"""


class Tried(NamedTuple):
    """A command.

    Attributes:
        words: Its words after `solidtouch`.
        out: Its output, a file or a folder.
        resumes: Whether a second run continues the first one's output.
    """

    words: tuple[str, ...]
    out: str
    resumes: bool = False


COMMANDS = {
    "reproduce": Tried(("reproduce", "--data", "a.nc", "b.nc", "--quick", "--trials", "20", "--out", "out"), "out"),
    "audit": Tried(("audit", "a.nc", "b.nc", "c.nc", "--quick", "--trials", "100", "--out", "out"), "out"),
    "compare": Tried(
        ("compare", "a.nc", "b.nc", "--models", "histogram,gaussian", "--quick", "--trials", "100", "--out", "out"),
        "out",
    ),
    "strategies": Tried(
        ("strategies", "--presets", "ideal", "--data-sets", "1", "--trials", "20", "--no-regret", "--out", "out"), "out"
    ),
    "sweep": Tried(("sweep", "study.toml", "--out", "out.zarr"), "out.zarr", resumes=True),
    "convert": Tried(("convert", "large.npz", "out.nc"), "out.nc"),
    "export-model": Tried(("export-model", "model.nc", "--format", "json", "--out", "out.json"), "out.json"),
}


@dataclass
class Outcome:
    """What came of the runs of a command.

    Attributes:
        runs: Runs by kind: `"SIGINT"` and so on, `"full disk"`, `"read-only"`, `"twice"`, `"clock"`.
        counts: How they ended, by kind and word.
        slowest_s: Longest time from a signal to the end.
        wrong: What must not be, one sentence each.
    """

    runs: Counter[str] = field(default_factory=Counter)
    counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    slowest_s: float = 0.0
    wrong: list[str] = field(default_factory=list)


class Trial:
    """Runs one command over and over in a folder of its own.

    Args:
        name: A key of `COMMANDS`.
        data: Folder of its inputs.
        generator: Of every random moment.
    """

    def __init__(self, name: str, data: Path, generator: random.Random) -> None:
        self.name, self.outcome = name, Outcome()
        self._tried = COMMANDS[name]
        self._data, self._generator = data, generator
        self._whole: dict[str, int] = {}
        began = time.monotonic()
        with self._folder() as folder:
            done = self._end(self._start(folder))
            if done[0]:
                raise RuntimeError(f"{name} failed: {done[1]}")
            self._seconds = time.monotonic() - began
            self._whole = contents(folder / self._tried.out)
            self._bytes = sum(self._whole.values())

    def interrupt(self, number: signal.Signals) -> None:
        """One run that is sent a signal at a random moment; one that resumes is then ended and compared."""
        kind = number.name
        with self._folder() as folder:
            process = self._start(folder)
            time.sleep(self._generator.uniform(0.0, 1.05 * self._seconds))
            children = _family(process)
            sent = time.monotonic()
            process.send_signal(number)
            code, said = self._end(process)
            took = time.monotonic() - sent
            self.outcome.runs[kind] += 1
            if code == 0:
                self._note(kind, "ended before")
            elif code in _CODES[number]:
                self.outcome.slowest_s = max(self.outcome.slowest_s, took)
            else:
                self._object(kind, f"exit code {code}: {said[-300:]}")
            if took > _SOON_S:
                self._object(kind, f"ended only after {took:.1f} s")
            if "Traceback" in said and not _loading(said):
                self._object(kind, f"a traceback: {said[-500:]}")
            self._judge(folder, kind, killed=number == signal.SIGKILL, code=code)
            left = [child for child in children if Path(f"/proc/{child}/exe").exists()]
            if left and number != signal.SIGKILL:
                self._object(kind, f"{len(left)} child processes are left")

    def fill(self, share: float) -> None:
        """One run on a disk with room for a share of its output; 0 is a read-only one."""
        kind = "read-only" if share == 0 else "full disk"
        size = "64k,ro" if share == 0 else f"{max(16, int(share * self._bytes / 1024))}k"
        with self._folder() as folder:
            words = " ".join(map(_quoted, self._words(str(Path("disk") / self._tried.out))))
            script = (
                f"mkdir disk && mount -t tmpfs -o size={size} none disk && {words}; code=$?; "
                "echo LEFT $(ls -A disk | wc -l); exit $code"
            )
            words = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", script]
            done = subprocess.run(  # noqa: S603 - this program itself
                words, cwd=folder, capture_output=True, text=True, timeout=20 * self._seconds + _END_S, check=False
            )
            if "LEFT" not in done.stdout:
                self._note(kind, "not possible here")
                return
            self.outcome.runs[kind] += 1
            if done.returncode not in (0, 2) or "Traceback" in done.stderr:
                self._object(kind, f"exit code {done.returncode}: {done.stderr[-300:]}")
            elif done.returncode == 2:
                self._note(kind, "refused")
                if not done.stdout.rstrip().endswith("LEFT 0") and not self._tried.resumes:
                    self._object(kind, "files are left on the full disk")
            else:
                self._note(kind, "ended before")

    def twice(self) -> None:
        """Two runs at a time into one output: one at most succeeds, and the output is whole."""
        with self._folder() as folder:
            both = [self._end(process) for process in [self._start(folder), self._start(folder)]]
            self.outcome.runs["twice"] += 1
            codes = sorted(code for code, _ in both)
            if not set(codes) <= {0, 2} or any("Traceback" in said for _, said in both):
                self._object("twice", f"exit codes {codes}: {both[0][1][-200:]} {both[1][1][-200:]}")
            self._note(
                "twice", "one refused" if codes == [0, 2] else "both ended" if codes == [0, 0] else "both refused"
            )
            self._judge(folder, "twice", code=codes[0])

    def jump(self) -> None:
        """One run whose wall clock jumps by days, back and forth."""
        with self._folder() as folder:
            (folder / "clock").mkdir()
            (folder / "clock" / "sitecustomize.py").write_text(_JUMP)
            code, said = self._end(self._start(folder, {"PYTHONPATH": str(folder / "clock")}))
            self.outcome.runs["clock"] += 1
            if code or "Traceback" in said:
                self._object("clock", f"exit code {code}: {said[-300:]}")
            self._judge(folder, "clock", code=code)

    def _judge(self, folder: Path, kind: str, *, killed: bool = False, code: int | None = None) -> None:
        """Looks at what a run left: its output whole or not at all, and nothing else."""
        out = folder / self._tried.out
        if self._tried.resumes and out.exists() and code != 0:
            code, said = self._end(self._start(folder))
            if code:
                self._object(kind, f"could not be resumed: {said[-300:]}")
        if not out.exists():
            self._note(kind, "no output")
        elif set(contents(out)) == set(self._whole):
            self._note(kind, "whole output")
        else:
            self._object(kind, f"half an output: {len(contents(out))} of {len(self._whole)} files")
        known = {path.name for path in self._data.iterdir()} | {self._tried.out, "clock", "disk"}
        left = [path.name for path in folder.iterdir() if path.name not in known]
        if left and killed:
            self._note(kind, "temporary files")
        elif left:
            self._object(kind, f"left behind: {', '.join(left)}")

    def _note(self, kind: str, word: str) -> None:
        self.outcome.counts[kind, word] += 1

    def _object(self, kind: str, sentence: str) -> None:
        self.outcome.counts[kind, "wrong"] += 1
        self.outcome.wrong.append(f"{self.name}, {kind}: {sentence}")

    def _folder(self) -> "_Folder":
        return _Folder(self._data)

    def _words(self, out: str) -> list[str]:
        return [
            sys.executable,
            "-m",
            "solidtouch.cli",
            *(out if w == self._tried.out else w for w in self._tried.words),
        ]

    def _start(self, folder: Path, environment: Mapping[str, str] | None = None) -> subprocess.Popen[str]:
        return subprocess.Popen(  # noqa: S603 - this program itself
            self._words(self._tried.out),
            cwd=folder,
            env=os.environ | (environment or {}),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )

    def _end(self, process: subprocess.Popen[str]) -> tuple[int, str]:
        try:
            said = process.communicate(timeout=300.0)[1]
        except subprocess.TimeoutExpired:
            process.kill()
            said = process.communicate()[1] + " It did not end."
        return process.returncode, said


class _Folder:
    """A new folder with links to the inputs, gone at the end of the block."""

    def __init__(self, data: Path) -> None:
        self._data = data

    def __enter__(self) -> Path:
        self._path = Path(tempfile.mkdtemp())
        for path in self._data.iterdir():
            (self._path / path.name).symlink_to(path)
        return self._path

    def __exit__(self, *_: object) -> None:
        shutil.rmtree(self._path, ignore_errors=True)


def contents(out: Path) -> dict[str, int]:
    """Sizes of the files of an output, by name below it."""
    files = [out] if out.is_file() else [path for path in out.rglob("*") if path.is_file()]
    return {str(path.relative_to(out.parent)): path.stat().st_size for path in files}


def _family(process: subprocess.Popen[str]) -> list[int]:
    """Numbers of the processes that a process started."""
    with suppress(OSError):
        return [int(word) for word in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()]
    return []


def _loading(said: str) -> bool:
    """Whether Python itself was still being loaded."""
    return "KeyboardInterrupt" in said and "solidtouch/cli" not in said and "in run\n" not in said


def _quoted(word: str) -> str:
    return "'" + word.replace("'", "'\\''") + "'"


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


def run(names: Sequence[str], moments: int, seed: int) -> dict[str, Outcome]:
    """Outcome of each command; `moments` of each signal, and a tenth as many of the others, at least two."""
    generator = random.Random(seed)  # noqa: S311 - no secret
    outcomes = {}
    with tempfile.TemporaryDirectory() as folder:
        prepare(Path(folder))
        for name in names:
            trial = Trial(name, Path(folder), generator)
            todo = [(trial.interrupt, number) for number in SIGNALS for _ in range(moments)]
            for act, number in track(todo, description=name, console=Console(stderr=True)):
                act(number)
            few = max(2, moments // 10)
            for share in (0.0, *(generator.uniform(0.05, 0.95) for _ in range(few))):
                trial.fill(share)
            for _ in range(few):
                trial.twice()
                trial.jump()
            outcomes[name] = trial.outcome
    return outcomes


def outcome_table(outcomes: Mapping[str, Outcome]) -> str:
    """A row for each command: how often its runs ended how."""
    kinds = [*(number.name for number in SIGNALS), "full disk", "read-only", "twice", "clock"]
    rows = []
    for name, outcome in outcomes.items():
        cells = []
        for kind in kinds:
            words = {word: n for (which, word), n in outcome.counts.items() if which == kind and word != "wrong"}
            cells.append(f"{outcome.runs[kind]}: " + ", ".join(f"{n} {word}" for word, n in sorted(words.items())))
        rows.append([f"`{name}`", *cells, f"{outcome.slowest_s:.1f} s", str(len(outcome.wrong))])
    return table(["command", *kinds, "slowest end", "wrong"], rows)


def main() -> None:
    """Interrupts, and prints what came of it; exit code 1 if something is that must not be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moments", type=int, default=30, help="number of each signal to each command")
    parser.add_argument("--only", action="append", choices=COMMANDS, help="only this command; repeatable")
    parser.add_argument("--seed", type=int, default=0, help="random seed")
    parser.add_argument("--document", type=Path, help="page to update")
    options = parser.parse_args()
    check_block(options.document, BLOCK)
    outcomes = run(options.only or list(COMMANDS), options.moments, options.seed)
    text = outcome_table(outcomes)
    print(text)
    for outcome in outcomes.values():
        for sentence in outcome.wrong:
            print(f"! {sentence}")
    write_block(options.document, BLOCK, text)
    if any(outcome.wrong for outcome in outcomes.values()):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
