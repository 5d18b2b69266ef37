"""The paper's complete Monte Carlo: 16 positions x 1000 trials x 20 thresholds, passive and active.

Loops are timed on a sample of the trials and extrapolated.
"""

from collections.abc import Callable, Iterable

from benchmarks.speed.c_code import NO_COMPILER
from benchmarks.speed.rows import Row, interleaved
from benchmarks.speed.trials.decisions import limits
from benchmarks.speed.trials.job import POLICIES, make_job, ours, paper_table
from benchmarks.speed.trials.loops import loop
from benchmarks.speed.trials.vectorised import vectorised

WORK = "the paper's Monte Carlo: 16 x 1000 trials x 20 thresholds, passive and active"
UNIT = "Monte Carlo"
TRIALS = 16000
THRESHOLDS = (
    *(0.1, 0.2, 0.3, 0.4, 0.5, 0.55, 0.6, 0.65, 0.7, 0.75),
    *(0.8, 0.85, 0.9, 0.925, 0.95, 0.96, 0.97, 0.98, 0.99, 0.995),
)


def rows(quick: bool = False) -> list[Row]:
    """Seconds of the whole; compiling is not among them."""
    few, many = (2, 40) if quick else (100, TRIALS)
    jobs = [make_job(paper_table(), many, policy, THRESHOLDS) for policy in POLICIES]
    samples = [job.first(few) for job in jobs]
    split = [job._replace(thresholds=job.thresholds[[h]]) for job in samples for h in range(len(THRESHOLDS))]
    ways = {
        "NumPy loop, thresholds one by one": (_over(split, loop), few),
        "NumPy loop, one trajectory for all thresholds": (_over(samples, loop), few),
        "NumPy, batches of 1600 trials": (_over(jobs, vectorised), many),
        "solidtouch": (_over(jobs, ours), many),
    }
    absent = []
    for (method, passive), (_, active) in zip(*(limits(job) for job in jobs), strict=True):
        if passive is None or active is None:
            absent.append(Row(WORK, method, [], UNIT, NO_COMPILER))
        else:
            ways[method] = _over((passive, active), lambda yardstick: yardstick.play()), many
    for play, _ in ways.values():
        play()  # compiles
    seconds = interleaved({method: play for method, (play, _) in ways.items()}, 2 if quick else 5)
    return [
        Row(WORK, method, [time_ * TRIALS / n for time_ in seconds[method]], UNIT, _sample(n))
        for method, (_, n) in ways.items()
    ] + absent


def _over[T](jobs: Iterable[T], play: Callable[[T], object]) -> Callable[[], None]:
    def all_of_them() -> None:
        for job in jobs:
            play(job)

    return all_of_them


def _sample(trials: int) -> str:
    return "" if trials == TRIALS else f"extrapolated from {trials} trials of each policy"
