"""Growth of time and memory with every size of a problem, as slopes on logarithmic axes.

`python -m benchmarks.speed.growth --document docs/reference/performance.md` measures each curve on one core in a
process of its own, writes a table and draws a figure. Memory is the peak of a work above what the process held before,
its input included.
"""

import argparse
import ctypes
import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.speed.run import ONE_THREAD

METHODS = {
    "tap-update": {
        "trials, passive": ("L x M", "trials"),
        "trials, active": ("L x M", "trials"),
        "reproduce": ("trials",),
        "Filter, from samples": ("L x M", "K", "J"),
    },
    "fit": {"histogram": ("L x M", "K", "J", "N"), "gaussian": ("L x M", "K", "J", "N")},
}
"""Sizes that each method is measured over, by its work."""
SIZES = {
    "L x M": ((16, 5), (20, 8), (20, 16), (32, 20), (40, 32), (64, 40), (80, 64), (128, 80), (200, 100)),
    "K": (1, 4, 12, 40, 125, 400, 1250, 4000),
    "J": (1, 4, 15, 50, 150, 600, 2500, 10_000),
    "N": (160, 500, 1600, 5000, 16_000, 50_000, 160_000, 500_000),
    "trials": (1000, 3000, 10_000, 30_000, 100_000, 300_000, 1_000_000, 3_000_000, 10_000_000),
}
LONGEST_S = 60.0
"""A size is left out if a power law through the two before has it take longer."""
_ROUNDS, _ENOUGH_S, _SECOND_S = 5, 2.0, 20.0  # of each size: so many, or so long; a second one after at most so long


class Growth(NamedTuple):
    """Cost of one method over one size.

    Attributes:
        work: What is counted, a key of `METHODS`.
        method: Who does it.
        axis: What grows, a key of `SIZES`.
        size: The sizes, shape (P,).
        seconds: Processor time of one tap-update or one fit, in each round, shape (P, rounds).
        mebibytes: Peak above what was held before, shape (P,).
    """

    work: str
    method: str
    axis: str
    size: list[int]
    seconds: list[list[float]]
    mebibytes: list[float]

    def fastest(self) -> list[float]:
        """Time of the fastest round at each size, to which other work on the machine added least."""
        return [min(rounds) for rounds in self.seconds]


class Slope(NamedTuple):
    """Slope of log cost over log size, with its 95% interval."""

    value: float
    low: float
    high: float


def slope(size: list[int], cost: list[float]) -> Slope | None:
    """Slope over the larger half of the sizes, at least four, with the t-interval of a straight line.

    Returns:
        `None` where there are fewer, or some without a cost.
    """
    from scipy.stats import t  # noqa: PLC0415

    from benchmarks.speed.scaling import exponent  # noqa: PLC0415

    n = max(4, (len(size) + 1) // 2)
    if len(size) < n or min(cost[-n:]) <= 0:
        return None
    value, error = exponent(size[-n:], cost[-n:])
    half = float(t.ppf(0.975, n - 2)) * error
    return Slope(value, value - half, value + half)


def curves(quick: bool, only: str | None = None) -> list[Growth]:
    """Every method, or one, over every size, each in a process of its own."""
    environment = os.environ | dict.fromkeys(ONE_THREAD, "1")
    found = []
    for work, methods in METHODS.items():
        for method, axis in [(method, axis) for method, axes in methods.items() for axis in axes]:
            if only not in (None, method):
                continue
            print(f"Measuring {work}, {method}, against {axis} ...", file=sys.stderr)
            words = [sys.executable, "-m", "benchmarks.speed.growth", "--curve", work, method, axis]
            words += ["--quick"] * quick
            done = subprocess.run(words, stdout=subprocess.PIPE, text=True, check=True, env=environment)  # noqa: S603
            found.append(Growth(**json.loads(done.stdout)))
    return found


def measured(work: str, method: str, axis: str, quick: bool) -> Growth:
    """One curve, in this process."""
    from benchmarks.speed.growth_works import prepared  # noqa: PLC0415
    from benchmarks.speed.rows import on_cores  # noqa: PLC0415

    found, totals = Growth(work, method, axis, [], [], []), []
    with on_cores(1):
        prepared(method, axis, SIZES[axis][0])[1]()()  # compiles
        for step in SIZES[axis][: 4 if quick else None]:
            size, prepare = prepared(method, axis, step)
            if len(totals) > 1:
                (x, y), (u, v) = np.log(found.size[-2:]), np.log(totals[-2:])
                if v + max(1.0, (v - u) / (y - x)) * (np.log(size) - y) > np.log(LONGEST_S):
                    break
            before = _reset_peak()
            run, seconds = prepare(), []
            while not seconds or (not quick and _goes_on(seconds)):
                began = time.process_time()
                units = run()
                seconds.append(time.process_time() - began)
                if len(seconds) == 1:
                    found.mebibytes.append(max(0.0, _peak() - before))
            totals.append(min(seconds))
            found.size.append(size)
            found.seconds.append([one / units for one in seconds])
            del prepare, run  # and with them the input, which must not be freed during the next size
    return found


def _goes_on(seconds: list[float]) -> bool:
    """Whether one more round is worth its time; the first one also makes what later ones find."""
    return sum(seconds) < (_ENOUGH_S if len(seconds) > 1 else _SECOND_S) and len(seconds) < _ROUNDS


def growth_table(found: list[Growth]) -> str:
    """Cost at the ends of each curve, and its slopes."""
    from benchmarks.page import table  # noqa: PLC0415
    from benchmarks.speed.report import duration  # noqa: PLC0415

    lines = []
    for curve in found:
        times = curve.fastest()
        lines.append(
            [
                curve.axis,
                f"{curve.work}, {curve.method}",
                f"{curve.size[0]:,} to {curve.size[-1]:,}",
                f"{duration(times[0])} to {duration(times[-1])}",
                slope_text(slope(curve.size, times)),
                f"{_mebibytes(curve.mebibytes[0])} to {_mebibytes(curve.mebibytes[-1])} MiB",
                slope_text(slope(curve.size, curve.mebibytes)),
            ]
        )
    return table(["size", "work", "range", "time", "slope", "memory", "slope"], lines)


def _mebibytes(number: float) -> str:
    return f"{number:,.0f}" if number >= 100 else f"{number:.2g}"


def slope_text(found: Slope | None) -> str:
    """A slope with its interval."""
    if found is None:
        return "–"
    value, low, high = (f"{round(number, 2) + 0.0:.2f}".replace("-", "−") for number in found)  # + 0.0 has no sign
    return f"{value} [{low}, {high}]"


def _reset_peak() -> float:
    """Resident memory in MiB, from which on peaks count; free memory is given back, or peaks would hide in it."""
    ctypes.CDLL(None).malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    return _peak()


def _peak() -> float:
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return int(re.search(r"VmHWM:\s+(\d+) kB", status)[1]) / 1024


def main() -> None:
    """Measures as the command line says."""
    if "--curve" in sys.argv:
        place = sys.argv.index("--curve")
        found = measured(*sys.argv[place + 1 : place + 4], quick="--quick" in sys.argv)
        print(json.dumps(found._asdict()))
        return
    from benchmarks.page import parsed, publish, write_block  # noqa: PLC0415
    from benchmarks.speed.growth_figure import growth_figure  # noqa: PLC0415
    from benchmarks.speed.report import machine_list  # noqa: PLC0415
    from benchmarks.speed.rows import machine  # noqa: PLC0415
    from benchmarks.study import OUT  # noqa: PLC0415

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few and small sizes, to test that everything runs")
    parser.add_argument("--redraw", action="store_true", help="draw what was measured before")
    parser.add_argument("--only", metavar="METHOD", help="measure one method again and keep the others")
    options = parsed(parser, "growth")
    file = OUT / ("growth-quick.json" if options.quick else "growth.json")
    if not options.redraw:
        kept = {"loads": [], "curves": []} if options.only is None else json.loads(file.read_text(encoding="utf-8"))
        before, loads = kept["curves"], [*kept["loads"], os.getloadavg()[0]]
        new = {curve[:3]: curve for curve in curves(options.quick, options.only)}
        loads.append(os.getloadavg()[0])
        found = [new.pop(tuple(curve.values())[:3], Growth(**curve)) for curve in before] + list(new.values())
        OUT.mkdir(parents=True, exist_ok=True)
        kept = {"machine": machine_list(machine()), "loads": loads, "curves": [curve._asdict() for curve in found]}
        file.write_text(json.dumps(kept, indent=1), encoding="utf-8")
    kept = json.loads(file.read_text(encoding="utf-8"))
    found = [Growth(**curve) for curve in kept["curves"]]
    where = "\n".join(kept["machine"].splitlines()[:3])
    load = f"- load average: {min(kept['loads']):.1f} to {max(kept['loads']):.1f}, of which this program is 1"
    text = f"{growth_table(found)}\n\n{where}\n{load}"
    print(text)
    write_block(options.document, "growth", text)
    if options.document is not None:
        publish(growth_figure(found), options.document, "growth")


if __name__ == "__main__":
    main()
