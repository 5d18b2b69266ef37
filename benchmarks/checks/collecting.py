"""Data collections on disks that are full or read-only, two at a time, and with a clock that jumps; in `make kills`.

`solidtouch collect` runs on an emulated bench until something disturbs it, and is resumed without the disturbance. Taps
that it reported as kept must not change, the finger must be off the object, the error must be one sentence, and the
resumed file must hold every trial once.
"""

import argparse
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from solidtouch.hardware.recording.plan import load_plan
from solidtouch.models.io.rig import read_rig

from benchmarks.page import parsed, table, write_block

from .disturbed import JUMP, PROGRAM
from .kills import PLAN, ROUNDING_MM, Known, Witness, is_ended, recorded, served

BLOCK = "collections"
_LIMIT_S = 120.0
_LOOK_S = 0.0005
_ROOM = 1 << 22
"""Bytes of a disk that holds a whole recording."""
_LARGEST_LEFT = 20_000
_LIFTED_S = 3.0
_APART_S = 0.5
_KEPT = re.compile(r"(\d+) of \d+ taps recorded; continue with --resume")


@dataclass
class Ends:
    """How the runs of one kind ended.

    Attributes:
        runs: Number of runs.
        codes: Exit codes.
        kept: Taps reported as kept.
        lost: Taps reported as kept that disappeared or changed.
        completed: Files that were whole in the end, with every trial once.
        wrong: What must not be, one sentence each.
    """

    runs: int = 0
    codes: Counter[int] = field(default_factory=Counter)
    kept: int = 0
    lost: int = 0
    completed: int = 0
    wrong: list[str] = field(default_factory=list)


class Disturber:
    """Disturbs collections of one plan.

    Args:
        folder: Folder with rig.toml and plan.toml.
        witness: Sees the finger.
        generator: Of every random moment.

    Attributes:
        ends: How the runs ended, by kind.
    """

    def __init__(self, folder: Path, witness: Witness, generator: random.Random) -> None:
        self.ends = {kind: Ends() for kind in KINDS}
        self._folder, self._witness, self._generator = folder, witness, generator
        self._trials = [tap.trial for tap in load_plan(folder / "plan.toml").taps()]
        self._disk = folder / "disk"
        self._disk.mkdir()
        self._kind = ""
        self._files = 0

    def disturb(self, kind: str) -> None:
        """One run of a kind, a key of `KINDS`, and what follows it."""
        self._kind, self._files = kind, self._files + 1
        self.ends[kind].runs += 1
        KINDS[kind](self)

    def too_small(self) -> None:
        """The disk has no room for the whole recording from the beginning."""
        size = self._generator.randint(16, 512)
        self._judge(self._end(self._start(f"size={size}k")), {2}, Known())

    def fills(self) -> None:
        """Another program fills the disk while taps are made."""
        process = self._start(f"size={_ROOM}")
        self._fill(process, self._generator.randint(1, len(self._trials)))
        self._judge(self._end(process), {2}, Known())

    def fills_resumed(self) -> None:
        """The disk has no room for the copy that `--resume` makes, or fills while it goes on."""
        before = self._part()
        process = self._start(f"size={_ROOM}", "--resume", copied=True)
        self._fill(process, self._generator.randint(0, 3))
        self._judge(self._end(process), {2}, before)

    def read_only(self) -> None:
        """The folder of a new file is read-only."""
        self._judge(self._end(self._start("size=64k,ro")), {2}, Known())

    def read_only_resumed(self) -> None:
        """The folder of a file to be resumed became read-only."""
        before = self._part()
        process = self._start(f"size={_ROOM}", "--resume", copied=True, remount="ro")
        self._judge(self._end(process), {2}, before)

    def one_file(self) -> None:
        """Two programs record to one new file."""
        self._both([self._start(), self._start()])

    def one_file_resumed(self) -> None:
        """Two programs resume one file."""
        before = self._part()
        self._both([self._start(None, "--resume"), self._start(None, "--resume")], before)

    def one_rig(self) -> None:
        """Two programs record to two files with one rig."""
        other = self._path.with_name(f"other-{self._path.name}")
        processes = [self._start()]
        time.sleep(self._generator.uniform(0.0, _APART_S))
        processes.append(self._start(out=other.name))
        self._both(processes, other=other)

    def clock(self) -> None:
        """The wall clock jumps by days, the program is killed and resumed."""
        process = self._start(jumps=True)
        self._reaches(process, self._generator.randint(1, len(self._trials)))
        process.send_signal(signal.SIGKILL)
        self._end(process)
        self._witness.let_pass(_LIFTED_S)
        self._judge(self._end(self._start(None, "--resume", jumps=True)), {0}, recorded(self._path))

    @property
    def _path(self) -> Path:
        return self._folder / f"{self._files}.mcap"

    def _part(self) -> Known:
        """What a new file holds whose program was stopped at a random tap."""
        process = self._start()
        self._reaches(process, self._generator.randint(4, len(self._trials)))
        process.send_signal(signal.SIGINT)
        self._end(process)
        return recorded(self._path)

    def _start(
        self,
        disk: str | None = None,
        *more: str,
        out: str | None = None,
        copied: bool = False,
        remount: str = "",
        jumps: bool = False,
    ) -> subprocess.Popen[str]:
        """Starts the program.

        Args:
            disk: Options of a small disk for the file; without them it is where the others are.
            more: Further arguments.
            out: Name of the file.
            copied: Whether the file is there already.
            remount: Options of the disk once the file is there.
            jumps: Whether the wall clock jumps.
        """
        name = out or self._path.name
        place = name if disk is None else f"{self._disk.name}/{name}"
        words = [sys.executable, *PROGRAM, "collect", "rig.toml", "plan.toml", "--out", place, "--home", *more]
        if disk is not None:
            script = f"mount -t tmpfs -o {disk} none disk"
            script += f" && cp {name} disk/" if copied else ""
            script += f" && mount -o remount,{remount} disk" if remount else ""
            script += f' && "$@"; code=$?; test ! -e {place} || cp {place} {name}; ls -A disk >{name}.left; exit $code'
            words = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", script, "sh", *words]
        clock = self._folder / "clock"
        if jumps:
            clock.mkdir(exist_ok=True)
            (clock / "sitecustomize.py").write_text(JUMP.replace("Random(0)", f"Random({self._files})"))
        return subprocess.Popen(  # noqa: S603 - this program itself
            words,
            cwd=self._folder,
            env=os.environ | ({"PYTHONPATH": str(clock)} if jumps else {}),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def _reaches(self, process: subprocess.Popen[str], presses: int) -> None:
        """Waits until the finger has pressed that often, or the process has ended."""
        before, start_s = self._witness.presses, time.monotonic()
        while self._witness.presses - before < presses and process.poll() is None:
            if time.monotonic() - start_s > _LIMIT_S:
                return
            time.sleep(_LOOK_S)

    def _fill(self, process: subprocess.Popen[str], presses: int) -> None:
        """Fills the disk of a process but for a few bytes, once the finger has pressed that often."""
        disk = Path(f"/proc/{process.pid}/root{self._disk}")
        size = self._path.stat().st_size if self._path.exists() else 0  # of what is copied there first

        def ready() -> bool:
            file = disk / self._path.name
            copied = not size or (file.exists() and file.stat().st_size >= size)
            return copied and shutil.disk_usage(disk).total == _ROOM

        left = self._generator.choice([0, self._generator.randint(0, _LARGEST_LEFT)])
        self._reaches(process, presses)
        try:
            while not ready():
                if process.poll() is not None:
                    return
                time.sleep(_LOOK_S)
            with (disk / "filler").open("wb", buffering=0) as file:
                file.write(bytes(max(0, shutil.disk_usage(disk).free - left)))
        except OSError:  # full already, or the process has ended
            return

    def _end(self, process: subprocess.Popen[str]) -> tuple[int, str]:
        try:
            said = process.communicate(timeout=_LIMIT_S)[0]
        except subprocess.TimeoutExpired:
            process.kill()
            said = process.communicate()[0] + " It did not end."
        return process.returncode, said

    def _both(
        self, processes: Sequence[subprocess.Popen[str]], before: Known | None = None, other: Path | None = None
    ) -> None:
        """Judges two programs of which one is refused; the second may have a file of its own."""
        done = [self._end(process) for process in processes]
        if other is not None and other.exists():
            if self._path.exists() and done[0][0] + done[1][0]:
                self.ends[self._kind].wrong.append(f"{self._kind}: both left a file.")
            other.replace(self._path)
        (won, lost) = done if done[0][0] == 0 else done[::-1]
        self._check_said(*lost, {0, 3} if other else {2})
        self.ends[self._kind].codes[lost[0]] += 1
        self._judge(won, {0}, before or Known())

    def _judge(self, ended: tuple[int, str], codes: set[int], before: Known) -> None:
        """Looks at what a run left, resumes it, and looks again."""
        code, said = ended
        ends = self.ends[self._kind]
        ends.codes[code] += 1
        self._check_said(code, said, codes)
        self._check_finger()
        now = recorded(self._path)
        told = _KEPT.search(said)
        if told is not None and int(told[1]) != len(now.taps):
            ends.wrong.append(f"{self._kind}: {told[1]} taps are said to be kept, the file has {len(now.taps)}.")
        ends.kept += int(told[1]) if told is not None else len(now.taps)
        self._compare(before, now)
        if told is None and not before.taps and code and self._path.exists():
            ends.wrong.append(f"{self._kind}: a file is left without a word of it.")
        if code:
            again, said = self._end(self._start(None, *(["--resume"] if self._path.exists() else [])))
            if again:
                ends.wrong.append(f"{self._kind}: could not go on: {said.strip()[-300:]}")
                return
        self._compare(now, recorded(self._path))
        self._check_finger()
        if [tap.label.trial for tap in read_rig(self._path).taps] == self._trials and is_ended(self._path):
            ends.completed += 1
        else:
            ends.wrong.append(f"{self._kind}: the file is not whole in the end.")
        self._clean()

    def _compare(self, before: Known, now: Known) -> None:
        for trial, samples in before.taps.items():
            kept = now.taps.get(trial)
            self.ends[self._kind].lost += kept is None or not np.array_equal(kept, samples)

    def _check_said(self, code: int, said: str, codes: set[int]) -> None:
        wrong = self.ends[self._kind].wrong
        errors = [line for line in said.splitlines() if line.startswith("solidtouch: ")]
        if code not in codes or "Traceback" in said or (code and len(errors) != 1):
            wrong.append(f"{self._kind}: exit code {code}: {said.strip()[-500:]}")

    def _check_finger(self) -> None:
        if (above_mm := self._witness.above_mm()) > ROUNDING_MM:
            self.ends[self._kind].wrong.append(f"{self._kind}: the finger is {above_mm:.2f} mm deep.")

    def _clean(self) -> None:
        """Removes the file; what else is there must not be."""
        left = self._path.with_name(f"{self._path.name}.left")
        names = set(left.read_text().split()) - {self._path.name, "filler"} if left.exists() else set[str]()
        left.unlink(missing_ok=True)
        self._path.unlink(missing_ok=True)
        ours = {"rig.toml", "plan.toml", "bench", "disk", "clock"}
        names |= {path.name for path in self._folder.iterdir()} - ours
        if names:
            self.ends[self._kind].wrong.append(f"{self._kind}: left behind: {', '.join(sorted(names))}.")


KINDS: Mapping[str, Callable[[Disturber], None]] = {
    "disk too small": Disturber.too_small,
    "disk becomes full": Disturber.fills,
    "disk becomes full, `--resume`": Disturber.fills_resumed,
    "folder read-only": Disturber.read_only,
    "folder read-only, `--resume`": Disturber.read_only_resumed,
    "two into one file": Disturber.one_file,
    "two into one file, `--resume`": Disturber.one_file_resumed,
    "two with one rig": Disturber.one_rig,
    "clock jumps, killed and resumed": Disturber.clock,
}
"""What disturbs a collection."""


def run(moments: int, spacing_mm: float, seed: int, folder: Path) -> dict[str, Ends]:
    """Each kind that many times, in random order."""
    generator = random.Random(seed)  # noqa: S311 - no secret
    (folder / "plan.toml").write_text(PLAN.format(spacing_mm=spacing_mm))
    todo = list(KINDS) * moments
    generator.shuffle(todo)
    with served(folder, seed) as bench:
        disturber = Disturber(folder, Witness(bench), generator)
        for kind in track(todo, description="Disturbing", console=Console(stderr=True)):
            disturber.disturb(kind)
    return disturber.ends


def rows(ends: Mapping[str, Ends]) -> str:
    """A table with a row for each kind."""
    head = ("disturbance", "runs", "exit codes", "taps kept", "lost", "complete in the end", "wrong")
    return table(
        head,
        [
            (
                kind,
                str(each.runs),
                ", ".join(f"{n} × {code}" for code, n in sorted(each.codes.items())),
                *(str(number) for number in (each.kept, each.lost)),
                f"{each.completed} of {each.runs}",
                str(len(each.wrong)),
            )
            for kind, each in ends.items()
        ],
    )


def main() -> None:
    """Disturbs, and prints what came of it; exit code 1 if something is that must not be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moments", type=int, default=10, help="number of runs of each kind")
    parser.add_argument("--spacing", type=float, default=4.0, metavar="MM", help="spacing of the plan's positions")
    parser.add_argument("--seed", type=int, default=0, help="random seed")
    options = parsed(parser, BLOCK)
    with tempfile.TemporaryDirectory() as folder:
        ends = run(options.moments, options.spacing, options.seed, Path(folder))
    write_block(options.document, BLOCK, rows(ends))
    print(rows(ends))
    wrong = [sentence for each in ends.values() for sentence in each.wrong]
    for sentence in wrong:
        print(f"! {sentence}")
    if wrong or any(each.lost for each in ends.values()):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
