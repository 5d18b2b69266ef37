"""Markdown tables of the measurements."""

from collections.abc import Iterable, Sequence

import numpy as np

from benchmarks.page import table
from benchmarks.speed.rows import LIMIT, Machine, Row
from benchmarks.speed.scaling import Curve, exponent

_SCALES = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns"))


def duration(seconds: float) -> str:
    """A time with three digits in the unit that fits."""
    scale, unit = next(((scale, unit) for scale, unit in _SCALES if seconds >= scale), _SCALES[-1])
    return f"{_digits(seconds / scale)} {unit}"


def ratio(of: Sequence[float], to: Sequence[float]) -> str:
    """Median of the ratios of the rounds with the smallest and largest, or of the medians where rounds differ."""
    if not of or not to:
        return ""
    if len(of) != len(to):
        return _digits(np.median(of) / np.median(to))
    ratios = np.array(of) / np.array(to)
    return f"{_digits(np.median(ratios))} ({_digits(ratios.min())}–{_digits(ratios.max())})"


def _digits(value: float) -> str:
    """Three digits, or all before the point."""
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def work_table(rows: Sequence[Row]) -> str:
    """The rows of one work: time, how many times sooner than its first row, how far from the limit."""
    baseline = rows[0].seconds
    limit = next((row.seconds for row in rows if row.method.startswith(LIMIT) and row.seconds), [])
    head = [
        "method",
        f"time per {rows[0].unit}",
        "speed-up",
        *(["times the limit"] if limit else []),
        "note",
    ]
    lines = []
    for row in rows:
        time_ = duration(float(np.median(row.seconds))) if row.seconds else "–"
        limits = [ratio(row.seconds, limit)] if limit else []
        lines.append([row.method, time_, ratio(baseline, row.seconds), *limits, row.note])
    return table(head, lines)


def works(rows: Iterable[Row]) -> dict[str, list[Row]]:
    """Rows by their work, in the order of their first row."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(row.work, []).append(row)
    return found


def all_works(rows: Iterable[Row]) -> str:
    """A heading and a table for every work."""
    return "\n\n".join(f"### {work[0].upper() + work[1:]}\n\n{work_table(of)}" for work, of in works(rows).items())


def exponents(curves: Sequence[Curve]) -> str:
    """The exponent of each curve, over all its sizes and over the three largest."""
    lines = []
    for curve in curves:
        medians = curve.medians()
        fits = [exponent(curve.size[-n:], medians[-n:]) for n in (len(medians), 3)]
        sizes = f"{curve.size[0]:,} to {curve.size[-1]:,}"
        times = f"{duration(medians[0])} to {duration(medians[-1])}"
        slopes = ["–" if np.isnan(slope) else f"{slope:.2f} ± {error:.2f}" for slope, error in fits]
        lines.append([curve.axis, curve.method, sizes, f"{times} per {curve.unit}", *slopes])
    return table(["size", "method", "range", "time", "exponent", "exponent, three largest"], lines)


def memory_table(peaks: dict[int, float]) -> str:
    """Peak memory by number of trials."""
    return table(["trials", "peak memory (MiB)"], [[f"{trials:,}", f"{peak:.0f}"] for trials, peak in peaks.items()])


def machine_list(machine: Machine) -> str:
    """The machine and the versions, one line each."""
    packages = ", ".join(f"{name} {version}" for name, version in machine.packages.items())
    caches = ", ".join(f"{name} {size}" for name, size in machine.caches.items())
    lines = {
        "processor": f"{machine.cpu}, {machine.cores} cores, {caches}",
        "vector instructions": ", ".join(machine.vectors) or "unknown",
        "system": f"{machine.system}, Python {machine.python}",
        "C compiler": machine.compiler or "none",
        "packages": packages,
    }
    return "\n".join(f"- {name}: {value}" for name, value in lines.items())
