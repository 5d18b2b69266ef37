"""A command that is disturbed: sent signals, given a disk without room, started twice; and what it leaves.

"Whole" means every file of an undisturbed run, with the same bytes where two undisturbed runs agree, else with about as
many.
"""

import hashlib
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
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
PROGRAM = ("-m", "solidtouch.cli")
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
_CODES = {signal.SIGINT: {130, -2}, signal.SIGTERM: {143, -15}, signal.SIGKILL: {-9}}
_LIMIT_S = 300.0
_SOON_S = 10.0
_ALIKE = 0.1
_FRAME = re.compile(r'File "(.*?)", line \d+, in (\S+)')
JUMP = """
import random, time
_time, _jump = time.time, random.Random(0)
_offset = [_jump.uniform(-1e6, 1e6)]
def jumping():
    if _jump.random() < 0.01:
        _offset[0] = _jump.uniform(-1e6, 1e6)
    return _time() + _offset[0]
time.time = jumping
time.time_ns = lambda: round(1e9 * jumping())
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
        name: What messages call it.
        tried: The command.
        data: Folder of its inputs.
        generator: Of every random moment.
    """

    def __init__(self, name: str, tried: Tried, data: Path, generator: random.Random) -> None:
        self.name, self.outcome = name, Outcome()
        self._tried = tried
        self._data, self._generator = data, generator
        self._whole, again = self._undisturbed(), self._undisturbed()
        self._stable = {path for path, file in self._whole.items() if again.get(path) == file}
        self._bytes = sum(file.size for file in self._whole.values())

    def _undisturbed(self) -> "dict[str, File]":
        """The output of a run that nothing disturbs; notes how long it takes."""
        began = time.monotonic()
        with self._folder() as folder:
            code, said = self._end(self._start(folder))
            if code:
                raise RuntimeError(f"{self.name} failed: {said}")
            self._seconds = time.monotonic() - began
            return contents(folder / self._tried.out)

    def interrupt(self, number: signal.Signals) -> None:
        """One run that is sent a signal at a random moment before its end; one that resumes is ended and compared."""
        while not self._interrupt(number):
            self._seconds *= 0.95

    def _interrupt(self, number: signal.Signals) -> bool:
        """Whether the moment came before the end."""
        kind = number.name
        with self._folder() as folder:
            process = self._start(folder)
            time.sleep(self._generator.uniform(0.0, self._seconds))
            if process.poll() is not None:
                process.communicate()
                return False
            sent = time.monotonic()
            process.send_signal(number)
            code, said = self._end(process)
            took = time.monotonic() - sent
            self.outcome.runs[kind] += 1
            if code == 0:
                self._note(kind, "ended before")
            elif code in _CODES[number]:
                self.outcome.slowest_s = max(self.outcome.slowest_s, took)
            elif not _loading(said):
                self._object(kind, f"exit code {code}: {said[-300:]}")
            if took > _SOON_S:
                self._object(kind, f"ended only after {took:.1f} s")
            if "Traceback" in said and not _loading(said):
                self._object(kind, f"a traceback: {said[-500:]}")
            self._judge(folder, kind, killed=number == signal.SIGKILL, code=code)
            while (left := _at_work(folder)) and time.monotonic() - sent < _SOON_S:
                time.sleep(0.05)
            if left:
                self._object(kind, f"child processes are left: {', '.join(left)}")
        return True

    def fill(self, share: float) -> None:
        """One run on a disk with room for a share of its output; 0 is a read-only one."""
        kind = "read-only" if share == 0 else "full disk"
        size = "64k,ro" if share == 0 else f"{max(16, int(share * self._bytes / 1024))}k"
        with self._folder() as folder:
            out = f"disk/{self._tried.out}"
            words = " ".join(map(_quoted, self._words(out)))
            script = (
                f"mkdir disk && mount -t tmpfs -o size={size} none disk && {words}; code=$?; "
                f"echo LEFT $(ls -A disk | wc -l); test ! -e {out} || cp -r {out} .; exit $code"
            )
            words = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", script]
            try:
                done = subprocess.run(  # noqa: S603 - this program itself
                    words, cwd=folder, capture_output=True, text=True, timeout=_LIMIT_S, check=False
                )
            except subprocess.TimeoutExpired:
                self._object(kind, "it did not end")
                return
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
            if done.returncode == 0 or self._tried.resumes:
                self._judge(folder, kind, code=done.returncode)

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
            if codes == [0, 0] and not self._tried.resumes:
                self._object("twice", "both ended, so one output replaced the other")
            self._judge(folder, "twice", code=codes[0])

    def jump(self) -> None:
        """One run whose wall clock jumps by days, back and forth."""
        with self._folder() as folder:
            (folder / "clock").mkdir()
            (folder / "clock" / "sitecustomize.py").write_text(JUMP)
            code, said = self._end(self._start(folder, {"PYTHONPATH": str(folder / "clock")}))
            self.outcome.runs["clock"] += 1
            if code or "Traceback" in said:
                self._object("clock", f"exit code {code}: {said[-300:]}")
            self._judge(folder, "clock", code=code)

    def _judge(self, folder: Path, kind: str, *, killed: bool = False, code: int | None = None) -> None:
        """Looks at what a run left: its output whole or not at all, and nothing else."""
        out = folder / self._tried.out
        if self._tried.resumes and out.exists() and code != 0:
            self._note(kind, "resumed")
            code, said = self._end(self._start(folder))
            if code:
                self._object(kind, f"could not be resumed: {said[-300:]}")
        if not out.exists():
            self._note(kind, "no output")
        elif odd := self._odd(contents(out)):
            self._object(
                kind, f"{len(odd)} of {len(self._whole)} files are not as they should be: {', '.join(odd[:9])}"
            )
        else:
            self._note(kind, "whole output")
        known = {path.name for path in self._data.iterdir()} | {self._tried.out, "clock", "disk"}
        left = [path.name for path in folder.iterdir() if path.name not in known]
        if left and killed:
            self._note(kind, "temporary files")
        elif left:
            self._object(kind, f"left behind: {', '.join(left)}")

    def _odd(self, found: "Mapping[str, File]") -> list[str]:
        """Files that an undisturbed run does not write, or otherwise."""

        def alike(path: str) -> bool:
            if path not in found or path not in self._whole:
                return False
            whole, file = self._whole[path], found[path]
            return whole == file if path in self._stable else abs(file.size - whole.size) <= _ALIKE * whole.size

        return [path for path in sorted(self._whole.keys() | found) if not alike(path)]

    def _note(self, kind: str, word: str) -> None:
        self.outcome.counts[kind, word] += 1

    def _object(self, kind: str, sentence: str) -> None:
        self.outcome.counts[kind, "wrong"] += 1
        self.outcome.wrong.append(f"{self.name}, {kind}: {sentence}")

    def _folder(self) -> "_Folder":
        return _Folder(self._data)

    def _words(self, out: str) -> list[str]:
        return [sys.executable, *PROGRAM, *(out if word == self._tried.out else word for word in self._tried.words)]

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
            said = process.communicate(timeout=_LIMIT_S)[1]
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


class File(NamedTuple):
    """Size in bytes and digest of a file."""

    size: int
    digest: str


def contents(out: Path) -> dict[str, File]:
    """The files of an output, by name below it."""
    files = [out] if out.is_file() else [path for path in out.rglob("*") if path.is_file()]
    read = {str(path.relative_to(out.parent)): path.read_bytes() for path in files}
    return {name: File(len(content), hashlib.sha256(content).hexdigest()) for name, content in read.items()}


def _at_work(folder: Path) -> list[str]:
    """Processes that work in a folder, by number and name."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if (process / "cwd").readlink() == folder:
                found.append(f"{process.name} {(process / 'comm').read_text().strip()}")
        except OSError:  # ended, or not ours
            continue
    return found


def _loading(said: str) -> bool:
    """Whether Python itself was still being loaded: nothing of this project but imports appears in a traceback."""
    return "KeyboardInterrupt" in said and not any(
        Path(path).is_relative_to(ROOT / package) and name != "<module>"
        for path, name in _FRAME.findall(said)
        for package in ("models", "hardware", "inference", "analysis", "cli")
    )


def _quoted(word: str) -> str:
    return "'" + word.replace("'", "'\\''") + "'"
