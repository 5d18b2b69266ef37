"""Running time against problem size, and the exponents of fitted power laws.

Trials have a fixed number of taps and random likelihood tables, so the work does not depend on decisions.
"""

import time
from collections.abc import Callable, Iterable, Sequence
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np
from solidtouch.models.grid import ClassGrid
from solidtouch.models.measurement.histogram import HistogramModel
from solidtouch.models.preprocessing import Preprocessing

from benchmarks.speed.memory import stream
from benchmarks.speed.rows import LIMIT, interleaved, per_unit
from benchmarks.speed.trials.decisions import limits
from benchmarks.speed.trials.job import POLICIES, SEED, make_job, ours, prepared, random_table
from benchmarks.speed.trials.loops import loop
from benchmarks.speed.trials.peers import NEVER, dynamax_filter, tap_sequences
from benchmarks.speed.trials.vectorised import vectorised

TAPS = 40
MOST_CLASSES_OF_A_MATRIX = 512  # dynamax multiplies by a matrix of classes x classes at every tap


class Curve(NamedTuple):
    """Cost over one size.

    Attributes:
        axis: What grows.
        method: Whose cost it is.
        unit: What the times are of.
        size: The sizes, shape (P,).
        seconds: Times of each round at each size, shape (P, rounds).
    """

    axis: str
    method: str
    unit: str
    size: list[int]
    seconds: list[list[float]]

    def medians(self) -> list[float]:
        """Median time at each size."""
        return [float(np.median(rounds)) for rounds in self.seconds]


def exponent(size: Sequence[float], seconds: Sequence[float]) -> tuple[float, float]:
    """Slope of log time over log size, and its standard error; NaN where there are too few sizes for it."""
    if len(size) < 3:
        return np.nan, np.nan
    x, y = np.log(size), np.log(seconds)
    x -= x.mean()
    slope = (x * y).sum() / (x * x).sum()
    residual = y - y.mean() - slope * x
    return float(slope), float(np.sqrt((residual**2).sum() / (len(x) - 2) / (x * x).sum()))


def curves(quick: bool = False) -> list[Curve]:
    """Every study."""
    return [*classes(quick), *separately(quick), *taps(quick), *batches(quick), *trials(quick), *likelihoods(quick)]


def classes(quick: bool) -> list[Curve]:
    """Cost of a tap-update against the number of classes, all ways."""
    sizes = [(1, 5), (4, 5), (16, 5)] if quick else [(1, 5), (4, 5), (16, 5), (40, 8), (50, 20), (100, 25), (200, 25)]
    points = []
    for L, M in sizes:
        ways = _ways(L, M, 4 if quick else 400, quick)
        points.append((L * M, ways | _ours_only((L, M), 4 if quick else 400, TAPS)))
    return _measured("classes", points, quick)


def separately(quick: bool) -> list[Curve]:
    """Cost of this project's tap-update against L and M."""
    found = []
    sizes = (2, 4, 8) if quick else (2, 8, 32, 128, 512)
    for axis, shapes in (("L (M = 5)", [(n, 5) for n in sizes]), ("M (L = 16)", [(16, n) for n in sizes])):
        points = [(n, _ours_only(shape, 4 if quick else 400, TAPS)) for n, shape in zip(sizes, shapes, strict=True)]
        found += _measured(axis, points, quick)
    return found


def taps(quick: bool) -> list[Curve]:
    """Cost of this project's tap-update against the deadline T."""
    sizes = (4, 16, 64) if quick else (10, 100, 1000, 10000)
    return _measured("T", [(T, _ours_only((16, 5), max(4, (100 if quick else 20000) // T), T)) for T in sizes], quick)


def batches(quick: bool) -> list[Curve]:
    """Cost of a tap-update against the number of trials of a call."""
    sizes = (4,) if quick else (1, 10, 100, 1000, 10000)
    return _measured("trials in a call", [(n, _ways(16, 5, n, quick)) for n in sizes], quick)


def trials(quick: bool) -> list[Curve]:
    """Cost of this project's useful tap against the number of trials that are played and counted."""
    found = []
    sizes = [10, 100] if quick else [10**3, 10**4, 10**5, 10**6, 10**7]
    for policy in POLICIES:
        stream(10, policy)  # compiles
        seconds = [[_of_a_tap(n, policy) for _ in range(1 if quick else 3)] for n in sizes]
        found.append(Curve("trials", f"solidtouch, {policy}", "useful tap", sizes, seconds))
    return found


def _of_a_tap(trials: int, policy: str) -> float:
    began = time.perf_counter()
    taps = stream(trials, policy)
    return (time.perf_counter() - began) / taps


def likelihoods(quick: bool) -> list[Curve]:
    """Cost of the log-likelihood of one tap against classes, samples, taxels and bins."""
    start = {"classes": 80, "J": 50, "K": 12, "B": 100}
    found = []
    for axis in start:
        sizes = (4, 8, 16) if quick else (8, 32, 128, 512)
        points = []
        for n in sizes:
            run = _table(10 if quick else 400, **start | {axis: n})
            points.append((n, {"likelihood of a tap": (run, 10 if quick else 400)}))
        found += _measured(f"{axis}, likelihood table", points, quick, "tap")
    return found


type _Ways = dict[str, tuple[Callable[[], object], int]]
"""What to run by method, and how many units that is."""


def _ways(L: int, M: int, trials: int, quick: bool) -> _Ways:
    found: _Ways = {}
    for policy in POLICIES:
        job = make_job(random_table(L, M), trials, policy, NEVER, TAPS)
        few = job.first(2 if quick else 20)
        found |= {
            f"solidtouch, {policy}": (lambda job=job: ours(job), trials * TAPS),
            f"NumPy loop, {policy}": (lambda few=few: loop(few), len(few.number) * TAPS),
            f"NumPy batches, {policy}": (lambda job=job: vectorised(job), trials * TAPS),
        }
        method, yardstick = limits(job)[-1]
        if yardstick is not None:
            found[f"{method.removeprefix(LIMIT).split(',')[0]}, {policy}"] = yardstick.play, trials * TAPS
        if policy == "passive" and find_spec("dynamax") is not None and L * M <= MOST_CLASSES_OF_A_MATRIX:
            found["dynamax, passive"] = dynamax_filter(job, tap_sequences(job)), trials * TAPS
    return found


def _ours_only(shape: tuple[int, int], trials: int, deadline: int) -> _Ways:
    found: _Ways = {}
    for policy in POLICIES:
        job = make_job(random_table(*shape), trials, policy, NEVER, deadline)
        found[f"solidtouch, {policy}"] = prepared(job), trials * deadline
    return found


def _table(taps: int, classes: int, J: int, K: int, B: int) -> Callable[[], object]:
    """Makes the likelihood table of random taps under a random model of these sizes."""
    rng = np.random.default_rng(SEED)
    grid = ClassGrid(1.5 * np.arange(classes), "mm", None, (("object",),))
    counts = rng.multinomial(20 * J, rng.dirichlet(np.ones(B), size=(classes, 1, K)))
    model = HistogramModel(grid, np.linspace(-3, 3, B + 1), "J", Preprocessing(samples=J), counts, 0.01)
    samples = rng.normal(size=(taps, J, K)).astype(np.float32)
    return lambda: model.log_likelihood(samples)


def _measured(axis: str, points: Iterable[tuple[int, _Ways]], quick: bool, unit: str = "tap-update") -> list[Curve]:
    found: dict[str, Curve] = {}
    for size, ways in points:
        for run, _ in ways.values():
            run()  # compiles
        seconds = interleaved({method: run for method, (run, _) in ways.items()}, 1 if quick else 5)
        for method, (_, units) in ways.items():
            curve = found.setdefault(method, Curve(axis, method, unit, [], []))
            curve.size.append(size)
            curve.seconds.append(per_unit(seconds[method], units))
    return list(found.values())
