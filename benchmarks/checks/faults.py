"""Taps an emulated rig under random faults, damages its commands, and reports the outcome; `make faults`.

Before about every other tap a random fault with random parameters is switched on. Errors that the drivers report are
handled as at a real bench: the run records them, the fault is removed, and the rig is reopened and homed. Every
accepted tap is compared with the true readings of the emulated finger.

The run fails unless every call ends within its deadline, no accepted tap is wrong, no move leaves the limits, and every
fault either leaves the taps unchanged or is reported. Then every byte of every command is damaged, as described in
`damage`.
"""

import argparse
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from solidtouch.hardware.emulator.emulated_bench import EmulatedBench, emulated_bench
from solidtouch.hardware.errors import RigError
from solidtouch.hardware.journal import NoJournal
from solidtouch.hardware.rig.open_rig import build_rig, connected
from solidtouch.hardware.rig.rig import Rig
from solidtouch.models import seeds

from . import damage

_OPERATOR_S = 1.0
_SETTLED_S = 1.0
_IN_FLIGHT = 1

Draw = Callable[[np.random.Generator], dict[str, Any]]


def _once(**parameters: Any) -> Draw:
    return lambda _: {"times": 1, **parameters}


def _for_taps(**parameters: Any) -> Draw:
    return lambda _: parameters


MENU: dict[str, Draw] = {
    "split": lambda g: {"delay_s": float(g.uniform(0.0005, 0.004))},
    "drop_bytes": lambda g: {"rate": 0.02, "count": int(g.integers(1, 4))},
    "merge": _for_taps(rate=0.02),
    "flip_bits": lambda g: {"rate": 0.02, "count": int(g.integers(1, 4))},
    "garbage": lambda g: {"port": str(g.choice(["stage", "sensor"]))},
    "torn_status": _for_taps(rate=0.5),
    "unplug": lambda g: {"times": 1, "seconds": 2.0, "port": str(g.choice(["stage", "sensor"]))},
    "renumber": lambda g: {"times": 1, "port": str(g.choice(["stage", "sensor"]))},
    "brown_out": _once(),
    "second_reader": lambda g: {"rate": 0.05, "port": str(g.choice(["stage", "sensor"]))},
    "lost_ok": _once(),
    "extra_ok": _for_taps(rate=0.5),
    "refuse_move": lambda g: {"times": 1, "code": int(g.choice([9, 15, 16]))},
    "limit_alarm": _once(),
    "silent_status": lambda g: {"times": int(g.integers(1, 8))},
    "false_idle": lambda g: {"times": 1, "seconds": float(g.uniform(0.05, 0.4))},
    "deaf": lambda g: {"times": 1, "port": "stage", "seconds": float(g.uniform(0.2, 3.0))},
    "lost_frames": lambda g: {"rate": 0.02, "count": int(g.integers(1, 4))},
    "lost_half": _for_taps(rate=0.02),
    "swapped_halves": _for_taps(rate=0.3),
    "silent_sensor": _for_taps(),
    "stuck": _for_taps(rate=1.0),  # one reading twice is no fault: the chip scans more slowly than the board sends
    "taxel_error": lambda g: {"mask": int(g.integers(1, 1 << 12))},
    "recalibrate": _once(),
    "drift": lambda g: {"counts_per_s": float(g.uniform(-3, 3))},
    "old_class": _for_taps(),
    "foreign": _for_taps(),
    "late": lambda g: {"rate": 0.05, "delay_s": float(g.uniform(0.002, 0.08))},
    "overload": lambda g: {"mask": int(g.integers(1, 1 << 12))},
}
"""Faults that can strike in the middle of a run, and their numbers. The others belong to opening a port; each has a
test of its own."""


@dataclass
class Outcome:
    """What came of a run.

    Attributes:
        accepted: Taps that the rig accepted.
        rejected: Taps that it made again.
        wrong: Accepted taps with a reading that the finger did not have.
        altered: Accepted taps with a value off by less than what the plausibility check of a tap sees, by fault.
        misplaced: Accepted taps made elsewhere than asked for.
        outside: Times at which the finger was outside the limits.
        lost: Readings that the sensor made and the driver did not get, up to the last accepted tap before a reopening.
        uncounted: Of these, those that the driver did not count as lost.
        reported: For each fault, how often it struck and something was reported or counted.
        silent: For each fault, how often it struck without either; the tap was accepted and compared.
        errors: Errors by kind.
        longest_s: Longest call in rig time.
        rig_s: Rig time altogether.
        host_s: Host time altogether.
    """

    accepted: int = 0
    rejected: int = 0
    wrong: int = 0
    misplaced: int = 0
    outside: int = 0
    lost: int = 0
    uncounted: int = 0
    reported: Counter[str] = field(default_factory=Counter)
    silent: Counter[str] = field(default_factory=Counter)
    altered: Counter[str] = field(default_factory=Counter)
    errors: Counter[str] = field(default_factory=Counter)
    longest_s: float = 0.0
    rig_s: float = 0.0
    host_s: float = 0.0


class Reports(NoJournal):
    """Counts what the drivers report."""

    def __init__(self) -> None:
        self.number = 0

    def heard(self, rig: Rig) -> int:
        """Reports so far, and whatever the drivers counted."""
        counts = {**vars(rig.skin.counts), "frames": 0}
        return self.number + sum(counts.values()) + sum(vars(rig.stage.counts).values())

    def tap(self, time_s: float, accepted: bool, reason: str) -> None:  # noqa: ARG002
        """A rejected tap is a report."""
        self.number += not accepted

    def event(self, time_s: float, kind: str, text: str, **details: Any) -> None:  # noqa: ARG002
        """Every event is a report, but those of a run without faults."""
        self.number += kind not in {"stream", "rest", "connected"}


class Truth:
    """What the finger felt and where it was, whatever the devices say.

    Args:
        bench: Its finger is listened to.
    """

    def __init__(self, bench: EmulatedBench) -> None:
        self.counts: list[NDArray[np.float64]] = []
        self.homing = True
        self.outside = 0
        self._bench = bench
        finger = bench.emulation.finger
        read, last_s = finger.read, -np.inf

        def listened(time_s: float) -> NDArray[np.float64]:
            nonlocal last_s
            counts = read(time_s)
            if time_s == last_s:  # the board calibrated in between
                self.counts.pop()
            last_s = time_s
            self.counts.append(np.array(counts))
            self._watch()
            return counts

        finger.read = listened

    def place_mm(self) -> tuple[float, float]:
        """Where the finger truly stands."""
        x_mm, y_mm = self._bench.emulation.state()["place_mm"]
        return x_mm, y_mm

    def deviation(self, samples: NDArray[np.float64]) -> float:
        """The largest difference of a tap from the readings in a row that are most like it, up to each taxel's zero."""
        J = len(samples)
        recent = np.array(self.counts[-J - 60 :])
        best = np.inf
        for start in range(len(recent) - J + 1):
            difference = samples - recent[start : start + J]
            difference -= np.median(difference, axis=0)
            best = min(best, float(np.abs(difference).max()))
        return best

    def _watch(self) -> None:
        stage = self._bench.rig.stage
        x_mm, y_mm = self.place_mm()
        inside = stage.x.low_mm - 0.01 <= x_mm <= stage.x.high_mm + 0.01
        inside &= stage.y.low_mm - 0.01 <= y_mm <= stage.y.high_mm + 0.01
        self.outside += not (self.homing or inside)


def run(seed: int, taps: int, folder: Path) -> Outcome:
    """That many accepted taps under random faults."""
    generator = seeds.generator(seed, seeds.Purpose.STUDY)
    outcome, reports = Outcome(), Reports()
    started_s = time.monotonic()
    with (
        emulated_bench(folder, seed=seed) as bench,
        Progress(*Progress.get_default_columns(), console=Console(stderr=True)) as progress,
    ):
        task = progress.add_task(f"seed {seed}", total=taps)
        truth = Truth(bench)
        bench.emulation.control({"object": 2})
        while outcome.accepted < taps:
            with ExitStack() as stack:
                rig = _opened(stack, bench, truth, reports, outcome)
                if rig is not None:
                    _tap_until_trouble(rig, bench, truth, reports, outcome, generator, taps)
                    progress.update(task, completed=outcome.accepted)
            bench.emulation.switches.clear()
        outcome.outside = truth.outside
        outcome.rig_s = bench.emulation.bench.now_s
    outcome.host_s = time.monotonic() - started_s
    return outcome


def _opened(stack: ExitStack, bench: EmulatedBench, truth: Truth, reports: Reports, outcome: Outcome) -> Rig | None:
    """The rig, opened and homed by an operator after whatever came before, or None if that failed."""
    truth.homing = True
    rig = build_rig(bench.rig, bench.clock, reports)
    try:
        stack.enter_context(connected(rig, home=True))
    except RigError as error:
        outcome.errors[f"opening: {type(error).__name__}"] += 1
        bench.clock.wait([], bench.clock.now() + _OPERATOR_S)
        return None
    truth.homing = False
    return rig


def _tap_until_trouble(
    rig: Rig,
    bench: EmulatedBench,
    truth: Truth,
    reports: Reports,
    outcome: Outcome,
    generator: np.random.Generator,
    taps: int,
) -> None:
    """Taps at random places, with a fault before every other, until a device fails or there are taps enough."""
    switches = bench.emulation.switches
    made = len(truth.counts) - rig.skin.counts.frames - rig.skin.counts.lost
    lost = uncounted = 0
    while outcome.accepted < taps:
        fault = str(generator.choice(list(MENU))) if generator.random() < 0.5 else None
        struck, heard, rejected = switches.tally(), reports.heard(rig), rig.tally.rejected
        before_s, failed = bench.clock.now(), True
        if fault is not None:
            switches.on(fault, **_numbers(fault, generator))
        try:
            rig.go(float(generator.uniform(bench.rig.range.start_mm, bench.rig.range.end_mm)))
            samples = rig.tap()
            outcome.accepted += 1
            _judge(samples, rig, truth, outcome, fault)
            if fault is not None:
                switches.clear()
                rig.loop.sleep(_SETTLED_S)
            counts = rig.skin.counts
            lost, uncounted = counts.lost, len(truth.counts) - made - counts.frames - counts.lost
            failed = False
        except RigError as error:
            outcome.errors[type(error).__name__] += 1
        truth.homing = failed
        outcome.rejected += rig.tally.rejected - rejected
        outcome.longest_s = max(outcome.longest_s, bench.clock.now() - before_s)
        switches.clear()
        if fault is not None and switches.tally()[fault] > struck[fault]:
            (outcome.reported if failed or reports.heard(rig) > heard else outcome.silent)[fault] += 1
        if failed:
            break
    outcome.lost += lost
    outcome.uncounted += max(0, uncounted - _IN_FLIGHT)


def _numbers(fault: str, generator: np.random.Generator) -> dict[str, Any]:
    """A fault's numbers; every other time it strikes at some chance only, so in the middle of a press too."""
    numbers = MENU[fault](generator)
    return numbers if "rate" in numbers or generator.random() < 0.5 else {**numbers, "rate": 0.02}


def _judge(samples: NDArray[np.float64], rig: Rig, truth: Truth, outcome: Outcome, fault: str | None) -> None:
    limit = 3 * rig.settings.sensor.noise_limit  # what the plausibility check of a tap sees
    deviation = truth.deviation(samples)
    outcome.wrong += deviation > limit
    outcome.altered[fault or "none"] += 1e-6 < deviation <= limit
    outcome.misplaced += abs(truth.place_mm()[0] - rig.place_mm) > 0.01


def show(outcomes: dict[int, Outcome], console: Console) -> None:
    """Prints what must hold and what came of each fault."""
    table = Table(title="Random faults", title_justify="left")
    table.add_column("seed")
    for seed in outcomes:
        table.add_column(str(seed), justify="right")
    for name, words in _ROWS.items():
        values = [getattr(outcome, name) for outcome in outcomes.values()]
        table.add_row(words, *(f"{value:.1f}" if isinstance(value, float) else str(value) for value in values))
    console.print(table)
    faults = Table(title="Effects of each fault", title_justify="left")
    for name in ("fault", "reported", "not reported", "tap altered within the noise"):
        faults.add_column(name, justify="left" if name == "fault" else "right")
    reported, silent, altered, errors = (
        sum((getattr(outcome, name) for outcome in outcomes.values()), Counter[str]())
        for name in ("reported", "silent", "altered", "errors")
    )
    for name in MENU:
        faults.add_row(name, str(reported[name]), str(silent[name]), str(altered[name]))
    console.print(faults)
    console.print("Errors: " + ", ".join(f"{name} {n}" for name, n in errors.most_common()))


_ROWS = {
    "accepted": "taps accepted",
    "rejected": "taps rejected and repeated",
    "wrong": "accepted taps with a wrong reading",
    "misplaced": "accepted taps at a wrong position",
    "outside": "readings outside the limits",
    "lost": "readings lost",
    "uncounted": "lost readings not reported",
    "longest_s": "longest move and tap (rig time, s)",
    "rig_s": "rig time (s)",
    "host_s": "host time (s)",
}


def main() -> None:
    """Runs some seeds and prints what came of them; exit code 1 if something is that must not be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--taps", type=int, default=200, help="accepted taps per seed")
    parser.add_argument("--seeds", type=int, default=3, help="number of seeds")
    parser.add_argument("--positions", type=int, default=12, help="positions of the collection with damaged commands")
    parser.add_argument("--stride", type=int, default=1, help="run every n-th damaged command only")
    arguments = parser.parse_args()
    outcomes = {}
    for seed in range(arguments.seeds):
        with tempfile.TemporaryDirectory() as folder:
            outcomes[seed] = run(seed, arguments.taps, Path(folder))
    show(outcomes, Console())
    with Progress(*Progress.get_default_columns(), console=Console(stderr=True)) as progress:
        task = progress.add_task("damaged commands", total=damage.count(arguments.positions, arguments.stride))
        tally = damage.run(arguments.positions, arguments.stride, lambda n: progress.advance(task, n))
    Console().print(damage.table(tally))
    Console().print(damage.sentence(tally))
    if tally.failed or any(
        outcome.wrong or outcome.misplaced or outcome.outside or outcome.uncounted for outcome in outcomes.values()
    ):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
