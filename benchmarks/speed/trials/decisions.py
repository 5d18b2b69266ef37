"""Trials that stop at one threshold: time per useful tap, and whether all methods decide alike.

A useful tap comes before the last threshold is crossed; times are divided by the number of useful taps.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.speed.c_code import NO_COMPILER
from benchmarks.speed.rows import ALL_CORES, LIMIT, Row, interleaved, on_cores, per_unit
from benchmarks.speed.trials.agreement import by_reference, differing
from benchmarks.speed.trials.job import POLICIES, Decisions, Job, make_job, ours, paper_table
from benchmarks.speed.trials.limit import Limit, limit
from benchmarks.speed.trials.loops import loop, tuned_loop
from benchmarks.speed.trials.older_processor import older_processors
from benchmarks.speed.trials.vectorised import vectorised

THRESHOLD = 0.995
UNIT = "tap-update"


class Way(NamedTuple):
    """One way of playing the first `trials` trials of a job."""

    method: str
    play: Callable[[], object]
    trials: int
    note: str = ""
    decisions: Callable[[], Decisions] | None = None


def rows(quick: bool = False) -> list[Row]:
    """Passive and active trials, on one core and on two."""
    found = []
    for policy in POLICIES:
        job = make_job(paper_table(), 60 if quick else 256000, policy, (THRESHOLD,))
        found += _one_core(job.first(16000), policy, quick) + _two_cores(job, policy, quick)
    return found


def limits(job: Job) -> list[tuple[str, Limit | None]]:
    """The yardsticks in C by name: the best for these sizes, and plain loops where that is another; the best last."""
    best = limit(job)
    if best is None or not best.vectors:
        return [(f"{LIMIT}C, plain loops", best)]
    return [("C, plain loops", limit(job, plain=True)), (f"{LIMIT}C, AVX-512", best)]


def _one_core(job: Job, policy: str, quick: bool) -> list[Row]:
    with older_processors(job) as older:
        return _compared(job, policy, quick, older)


def _compared(job: Job, policy: str, quick: bool, older: dict[str, Callable[[bool], Any]]) -> list[Row]:
    few, many = (5 if quick else 400), len(job.number)
    ways = [
        Way("NumPy loop over trials and taps", lambda: loop(job.first(few)), few),
        Way("NumPy loop, tuned", lambda: tuned_loop(job.first(few)), few),
        Way("NumPy, batches of 1600 trials", lambda: vectorised(job), many, "single precision"),
        Way("solidtouch", lambda: ours(job), many, "includes drawing the taps"),
        *(
            Way(f"solidtouch, {name} alone", partial(play, False), many, "", partial(play, True))
            for name, play in older.items()
        ),
        Way("solidtouch, arrays by XLA", lambda: ours(job, device="xla-cpu"), many, "the code that a GPU runs"),
    ]
    absent = []
    for method, yardstick in limits(job):
        if yardstick is None:
            absent.append(method)
        else:
            ways.append(Way(method, yardstick.play, many, "single precision, draws precomputed"))
    work = f"trials to {THRESHOLD}, {policy}"
    expected, near = by_reference(job)
    played: dict[str, Any] = {way.method: (way.decisions or way.play)() for way in ways}  # compiles
    seconds = interleaved({way.method: way.play for way in ways}, 2 if quick else 9)
    found = []
    for way in ways:
        time_ = per_unit(seconds[way.method], played[way.method].taps.max(axis=1).sum())
        facts = [_speed(time_, job, played["solidtouch"]), _agreement(played[way.method], expected, near), way.note]
        found.append(Row(work, way.method, time_, UNIT, "; ".join(filter(None, facts))))
    return found + [Row(work, method, [], UNIT, NO_COMPILER) for method in absent]


def _two_cores(job: Job, policy: str, quick: bool) -> list[Row]:
    work = f"trials to {THRESHOLD}, {policy}, on two cores"
    players: dict[str, Callable[[int], Decisions]] = {"solidtouch": lambda cores: ours(job, cores)}
    _, yardstick = limits(job)[-1]
    if yardstick is not None:
        players["C"] = yardstick.play
    ways = {
        f"{name}, {count}": partial(_on, cores, play)
        for name, play in players.items()
        for cores, count in ((1, "one core"), (2, "two cores"))
    }
    if len(ALL_CORES) < 2:
        return [Row(work, method, [], UNIT, "this machine has one core") for method in ways]
    taps = ours(job).taps.sum()
    seconds = interleaved(ways, 2 if quick else 9)
    found = []
    for name in players:
        one, two = (seconds[f"{name}, {count}"] for count in ("one core", "two cores"))
        gain = np.median(np.array(one) / np.array(two))
        found.append(Row(work, f"{name}, one core", per_unit(one, taps), UNIT))
        found.append(Row(work, f"{name}, two cores", per_unit(two, taps), UNIT, f"{gain:.2f} times as fast as on one"))
    return found


def _on(cores: int, play: Callable[[int], Decisions]) -> Decisions:
    with on_cores(cores):
        return play(cores)


def _speed(seconds: list[float], job: Job, played: Decisions) -> str:
    """Trials per second, at the taps that a trial of the whole job takes."""
    return f"{1 / (np.median(seconds) * played.taps.sum() / len(job.number)):,.0f} trials/s"


def _agreement(found: Decisions, expected: Decisions, near: NDArray[np.bool_]) -> str:
    n = len(found.taps)
    other = differing(found, Decisions(*(values[:n] for values in expected)))
    return f"{other.sum()} of {n} trials decided differently, {(other & near[:n]).sum()} of them near ties"
