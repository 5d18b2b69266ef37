"""Kills data collections at random moments and counts lost taps; `make kills`.

`solidtouch collect` runs on an emulated bench, is killed or stopped, and is restarted with `--resume` until the plan is
complete; then a new file is begun. A counter at the emulated finger records every press independently of the recording,
which must contain every press except the one in progress. Recorded taps must not change, and a stopped (not killed)
process must retract the finger and close the file.
"""

import argparse
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table
from solidtouch.hardware.emulator.emulated_bench import EmulatedBench, emulated_bench
from solidtouch.hardware.emulator.rig_file import write_rig
from solidtouch.hardware.emulator.service import Service
from solidtouch.hardware.emulator.shared_clock import SocketConnection
from solidtouch.hardware.recording.plan import load_plan
from solidtouch.models.io.rig import read_rig
from solidtouch.models.io.rig_reader import RecordingReader
from solidtouch.models.io.rig_recording import Tap
from solidtouch.models.taps import TapSet

_LIMIT_S = 120.0
_LOOK_S = 0.0002
_TAP_S = 3.0
ROUNDING_MM = 0.01
_CODES = {signal.SIGKILL: {-9}, signal.SIGINT: {130, -2}, signal.SIGTERM: {143, -15}}
"""Exit codes; the second is for when the program has not taken the signal over yet, or has given it back at its end."""

MOMENTS = {"starting": 1.0, "copying": 0.03, "homing": 0.2, "tapping": 0.03, "ending": 0.05}
"""What the program is at, and for how many seconds of host time the signal may be late."""

PLAN = """
settle_taps = 1
positions = {{ start_mm = 0.0, end_mm = 16.0, spacing_mm = {spacing_mm} }}
objects = [{{ name = "4 mm rod", size_mm = 4 }}, {{ name = "12 mm rod", size_mm = 12 }}]
"""


class Witness:
    """Stands beside the emulated finger.

    Args:
        bench: Whose finger is watched; a `Service` answers for it.
    """

    def __init__(self, bench: EmulatedBench) -> None:
        self.presses = 0
        self._rig = bench.rig
        self._emulation = bench.emulation
        self._down = False
        finger = bench.emulation.finger
        read = finger.read

        def watched(time_s: float) -> NDArray[np.float64]:
            down = self._emulation.state()["place_mm"][1] > (self._rig.tap.clear_mm + self._rig.tap.depth_mm) / 2
            self.presses += down and not self._down
            self._down = down
            return read(time_s)

        finger.read = watched

    @property
    def is_connected(self) -> bool:
        """Whether a program has the port of the stage open."""
        return self._emulation.bench.links[0].is_open

    def above_mm(self) -> float:
        """How far the finger truly is from where it touches nothing, once all that was asked before is done."""
        with SocketConnection(self._rig.emulator.control) as connection:
            return connection.control({})["place_mm"][1] - self._rig.tap.clear_mm

    def let_pass(self, seconds: float) -> None:
        """Lets rig time go on, as it would at a bench: what a killed program had sent is done now and not later."""
        with SocketConnection(self._rig.emulator.control) as connection:
            now_s = connection.control({})["now_s"]
            until_s = now_s + seconds
            while now_s < until_s:
                now_s = connection.advance(until_s, {}).now_s


@dataclass
class Known:
    """What a recording held when it was last looked at."""

    ended: int = 0
    taps: dict[int, NDArray[np.float64]] = field(default_factory=dict)


@dataclass
class Outcome:
    """What came of it.

    Attributes:
        stops: Kills and other signals by signal and by what the program was at.
        completed: Runs that came to the end of the plan.
        presses: Presses that the witness saw.
        in_progress: Presses that no recording tells of because they were not over.
        unbegun: Files without a single message, killed when they had just been made.
        lost: Further presses that no recording tells of, and taps that disappeared or changed.
        wrong: Everything else that must not be, one sentence each.
        host_s: Host time altogether.
    """

    stops: Counter[tuple[str, str]] = field(default_factory=Counter)
    completed: int = 0
    unbegun: int = 0
    presses: int = 0
    in_progress: int = 0
    lost: int = 0
    wrong: list[str] = field(default_factory=list)
    host_s: float = 0.0


class Collection:
    """A plan, collected into one file after the other.

    Args:
        folder: Where all files are.
        witness: Sees the finger.
        generator: Of every random moment.
    """

    def __init__(self, folder: Path, witness: Witness, generator: random.Random) -> None:
        self.outcome = Outcome()
        self._folder, self._witness, self._generator = folder, witness, generator
        self._plan = load_plan(folder / "plan.toml")
        self._taps = list(self._plan.taps())
        self._files = 0
        self._begin()

    def run(self, number: signal.Signals | None = None, moment: str = "") -> None:
        """One run of the program, as a person would go on after what came before.

        Args:
            number: The signal that ends it, if it lasts so long.
            moment: One of `MOMENTS`, when the signal is sent.
        """
        before, was_mm, was_left = self._witness.presses, self._witness.above_mm(), self._temporary.exists()
        process = self._start()
        try:
            if number is not None and self._comes(moment, process, before):
                process.send_signal(number)
            said, _ = process.communicate(timeout=_LIMIT_S)
        finally:
            process.kill()
            process.communicate()
        above_mm = self._witness.above_mm()
        self._witness.let_pass(_TAP_S)
        pressed = self._witness.presses - before
        self._compare(pressed)
        if process.returncode == 0:
            self._check_complete()
        elif number is None:
            self.outcome.wrong.append(f"A run that nobody stopped ended with {process.returncode}. {said.strip()}")
        else:
            self.outcome.stops[number.name, moment] += 1
            for trouble in self._troubles(number, process.returncode, said, pressed, max(was_mm, 0.0), above_mm):
                self.outcome.wrong.append(f"{number.name} while {moment}: {trouble}")
            if number != signal.SIGKILL and self._temporary.exists() and not was_left:
                self.outcome.wrong.append(f"{number.name} while {moment}: the temporary file is left.")

    def _begin(self) -> None:
        """A new file."""
        self._files += 1
        self._path = self._folder / f"{self._files}.mcap"
        self._known = Known()

    @property
    def _temporary(self) -> Path:
        return self._path.with_name(f".{self._path.name}.resumed")

    def _start(self) -> subprocess.Popen[str]:
        words = ["collect", "rig.toml", "plan.toml", "--out", self._path.name, "--home"]
        if self._path.exists() and not _begins(self._path):
            self.outcome.unbegun += 1
            self._path.unlink()  # as `collect --resume` asks for
        if self._path.exists():
            words.append("--resume")
        return subprocess.Popen(  # noqa: S603 - this program itself
            [sys.executable, "-m", "solidtouch.cli", *words],
            cwd=self._folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def _comes(self, moment: str, process: subprocess.Popen[str], before: int) -> bool:
        """Whether the moment, and a random time after it, comes before the end of the process."""
        left = [tap for tap in self._taps if tap.trial not in self._known.taps]
        presses = len(left) + self._plan.settle_taps * len({tap.what for tap in left})
        wanted = self._generator.randint(1, max(1, presses)) if moment == "tapping" else presses
        start_s = time.monotonic()
        while not self._is_now(moment, self._witness.presses - before >= wanted):
            if process.poll() is not None or time.monotonic() - start_s > _LIMIT_S:
                return False
            time.sleep(_LOOK_S)
        time.sleep(self._generator.uniform(0.0, MOMENTS[moment]))
        return process.poll() is None

    def _is_now(self, moment: str, pressed: bool) -> bool:
        match moment:
            case "starting":
                return True
            case "copying":
                return self._temporary.exists()
            case "homing":
                return self._witness.is_connected
        return pressed

    def _compare(self, pressed: int) -> None:
        """Compares the recording with what it held before and with what the witness saw since."""
        known = recorded(self._path)
        missing = max(0, pressed - (known.ended - self._known.ended))
        self.outcome.presses += pressed
        self.outcome.in_progress += min(1, missing)
        self.outcome.lost += max(0, missing - 1)
        for trial, samples in self._known.taps.items():
            self.outcome.lost += not np.array_equal(known.taps.get(trial), samples)
        self._known = known
        ours = {"rig.toml", "plan.toml", "bench", self._temporary.name, *(f"{n + 1}.mcap" for n in range(self._files))}
        if strange := {path.name for path in self._folder.iterdir()} - ours:
            self.outcome.wrong.append(f"Files are left behind: {', '.join(sorted(strange))}.")

    def _troubles(
        self, number: signal.Signals, code: int, said: str, pressed: int, was_mm: float, above_mm: float
    ) -> Iterator[str]:
        """What is wrong after a stop, one sentence each."""
        if "KeyboardInterrupt" in said and "in collect\n" not in said:
            return  # Python itself was still being loaded
        if code not in _CODES[number]:
            yield f"exit code {code}. {said.strip()}"
        if number == signal.SIGKILL:
            return
        if "Traceback" in said:
            yield f"a traceback. {said.strip()}"
        if above_mm > (0.0 if pressed else was_mm) + ROUNDING_MM:
            yield f"the finger is {above_mm:.2f} mm deep."
        if pressed and not is_ended(self._path):
            yield "the file was not ended."

    def _check_complete(self) -> None:
        """Every trial once, an index, no temporary file, and a tap set of the very same taps; then a new file."""
        self.outcome.completed += 1
        path, known, wrong = self._path, self._known, self.outcome.wrong
        if [tap.label.trial for tap in read_rig(path).taps] != [tap.trial for tap in self._taps]:
            wrong.append(f"{path.name} holds the trials {sorted(known.taps)}.")
        if self._temporary.exists() or not is_ended(path):
            wrong.append(f"{path.name} was not ended, or its temporary file is left.")
        with tempfile.TemporaryDirectory() as folder:
            words = [sys.executable, "-m", "solidtouch.cli", "convert", str(path), f"{folder}/taps.nc"]
            subprocess.run(words, check=True, stdout=subprocess.DEVNULL)  # noqa: S603 - this program itself
            taps = TapSet.load(f"{folder}/taps.nc")
        for samples, trial in zip(taps.taps, taps.trial.tolist(), strict=True):
            self.outcome.lost += not np.array_equal(samples, known.taps[trial].astype(samples.dtype))
        self._begin()


def _begins(path: Path) -> bool:
    """Whether the first message of a file was written before its program was killed."""
    return next(iter(RecordingReader(path)), None) is not None


def is_ended(path: Path) -> bool:
    """Whether a file has an index, with as many messages as there are."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        messages = sum(1 for _ in reader.iter_messages())
    return summary is not None and summary.statistics is not None and summary.statistics.message_count == messages


def recorded(path: Path) -> Known:
    """What a recording holds; nothing if there is none, or none that was begun."""
    if not path.exists() or not _begins(path):
        return Known()
    ended = sum(isinstance(entry.content, Tap) and entry.intact for entry in RecordingReader(path))
    return Known(ended, {tap.label.trial: tap.samples for tap in read_rig(path).taps})


@contextmanager
def served(folder: Path, seed: int) -> Iterator[EmulatedBench]:
    """An emulated bench that other processes drive, with its rig.toml in a folder."""
    with emulated_bench(folder / "bench", seed=seed) as bench:
        write_rig(folder / "rig.toml", bench.rig, list(bench.emulation.objects))
        stopping = threading.Event()
        with Service(bench.emulation, Path(bench.rig.emulator.control)) as service:
            thread = threading.Thread(target=service.run, args=(stopping.is_set,))
            thread.start()
            try:
                yield bench
            finally:
                stopping.set()
                thread.join()


def run(moments: int, spacing_mm: float, seed: int, folder: Path) -> Outcome:
    """Each signal at that many random moments, in random order; then the rest of the taps."""
    generator = random.Random(seed)  # noqa: S311 - no secret
    (folder / "plan.toml").write_text(PLAN.format(spacing_mm=spacing_mm))
    numbers = list(_CODES) * moments
    generator.shuffle(numbers)
    start_s = time.monotonic()
    with served(folder, seed) as bench:
        collection = Collection(folder, Witness(bench), generator)
        for number in track(numbers, description="Killing", console=Console(stderr=True)):
            stopped = collection.outcome.stops.total()
            while collection.outcome.stops.total() == stopped and not collection.outcome.wrong:
                collection.run(number, generator.choice(list(MOMENTS)))
        collection.run()
    collection.outcome.host_s = time.monotonic() - start_s
    return collection.outcome


def show(outcome: Outcome, console: Console) -> None:
    """Prints what must hold, when the program was stopped, and what is wrong."""
    table = Table(title="Signals by what the program was doing", title_justify="left")
    table.add_column("signal")
    for moment in MOMENTS:
        table.add_column(moment, justify="right")
    for number in _CODES:
        table.add_row(number.name, *(str(outcome.stops[number.name, moment]) for moment in MOMENTS))
    console.print(table)
    rows = {
        "kills and stops": outcome.stops.total(),
        "completed runs": outcome.completed,
        "files killed before their first message": outcome.unbegun,
        "presses of the finger": outcome.presses,
        "taps lost in progress": outcome.in_progress,
        "other taps lost": outcome.lost,
        "host time (s)": round(outcome.host_s, 1),
    }
    for words, value in rows.items():
        console.print(f"{words}: {value}", highlight=False)
    for sentence in outcome.wrong:
        console.print(f"! {sentence}", markup=False, highlight=False)


def main() -> None:
    """Kills, and prints what came of it; exit code 1 if something is that must not be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moments", type=int, default=30, help="number of each signal")
    parser.add_argument("--spacing", type=float, default=1.0, metavar="MM", help="spacing of the plan's positions")
    parser.add_argument("--seed", type=int, default=0, help="random seed")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        outcome = run(arguments.moments, arguments.spacing, arguments.seed, Path(folder))
    show(outcome, Console())
    if outcome.lost or outcome.wrong:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
