"""The input of every method of playing trials: taps, trials and precomputed random draws."""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import preset
from solidtouch.inference.trials.records import TapTable, TrialPlan, Trials, plan_trials, tap_table
from solidtouch.inference.trials.run import empty_trials, make_player, make_rule, run_trials
from solidtouch.models import seeds
from solidtouch.models.grid import TapPool
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.settings import PlaySettings

POLICIES = {"passive": 1.0, "active": 0.0}
"""Threshold theta_X of the moves of each."""

SEED = 0


class Decisions(NamedTuple):
    """What is compared of `trials.run.Trials`: its fields of these names, of n trials at H thresholds, shape (n, H)."""

    taps: NDArray[np.integer]
    what: NDArray[np.integer]
    where: NDArray[np.integer]


class Job(NamedTuple):
    """Trials to play, n of them with at most T taps, over N taps of L x M classes.

    Attributes:
        table: Test taps.
        plan: The trials.
        thresholds: theta_W, increasing, shape (H,).
        theta_x: Threshold for a move.
        deadline: T.
        tap: Taps of each class, shape (L, M, taps per class).
        number: Which of them a trial gets at each tap, shape (n, T); the draws of `run_trials`.
        likelihood: P(z | class) over its maximum, of every tap, shape (N, L, M).
        prior: Belief before the first tap, shape (L, M).
    """

    table: TapTable
    plan: TrialPlan
    thresholds: NDArray[np.float64]
    theta_x: float
    deadline: int
    tap: NDArray[np.intp]
    number: NDArray[np.intp]
    likelihood: NDArray[np.float64]
    prior: NDArray[np.float64]

    @property
    def active(self) -> bool:
        """Whether the sensor moves."""
        return self.theta_x < 1

    @property
    def classes(self) -> int:
        """L x M."""
        return self.prior.size

    def first(self, n: int) -> "Job":
        """The same job with the first n trials only."""
        plan = TrialPlan(*(field[:n] for field in self.plan))
        return self._replace(plan=plan, number=self.number[:n])


def make_job(
    table: TapTable, trials: int, policy: str, thresholds: tuple[float, ...] = (0.995,), deadline: int = 100
) -> Job:
    """A job over a table whose classes have equally many taps, fixation in the middle."""
    L, M = table.log_prior.shape
    count = int(table.pool.count[0, 0, 0])
    plan = plan_trials(table.pool, trials, SEED, fixation=(L - 1) // 2)
    words = seeds.words(SEED, plan.stream, seeds.TAPS, 0, deadline)
    largest = table.log_likelihood.max(axis=(1, 2), keepdims=True)
    return Job(
        table=table,
        plan=plan,
        thresholds=np.array(thresholds),
        theta_x=POLICIES[policy],
        deadline=deadline,
        tap=table.pool.order.reshape(L, M, count),
        number=seeds.below(words, np.uint64(count)).astype(np.intp),
        likelihood=np.exp(table.log_likelihood - largest),
        prior=np.exp(table.log_prior),
    )


@cache
def paper_table() -> TapTable:
    """Taps of one simulated data set of the preset `paper`: 20 taps of each of 16 x 5 classes."""
    train, test = (simulate_session(preset("paper"), SEED, session) for session in (0, 1))
    return tap_table(fit(train, train.grid()), test)


def random_table(L: int, M: int, taps: int = 400) -> TapTable:
    """A table of any size with as many different taps, each of several classes; for costs, not for results.

    Likelihoods favour one class in each direction by little, as those of real taps do.
    """
    rng = np.random.default_rng(SEED)
    where, what = rng.integers(L, size=(taps, 1, 1)), rng.integers(M, size=(taps, 1, 1))
    distance = np.abs(np.arange(L)[:, np.newaxis] - where) / L + (np.arange(M) != what)
    log_likelihood = -distance + 0.3 * rng.normal(size=(taps, L, M))
    count = np.full((1, L, M), 4)
    order = rng.integers(taps, size=count.sum())
    nearest = np.broadcast_to(np.arange(L)[:, np.newaxis], (1, L, M)).copy()
    pool = TapPool(order, np.cumsum(count).reshape(1, L, M) - count, count, nearest)
    return TapTable(log_likelihood, pool, np.full((L, M), -np.log(L * M)))


def no_decisions(job: Job) -> Decisions:
    """Room for the decisions of a job."""
    return Decisions(*(np.zeros((len(job.number), len(job.thresholds)), dtype=np.intp) for _ in Decisions._fields))


def ours(job: Job, workers: int = 1, device: str = "cpu") -> Decisions:
    """This project's Monte Carlo; makes its own draws while it runs."""
    return decisions(play(job, workers, device))


def play(job: Job, workers: int = 1, device: str = "cpu") -> Trials:
    """The trials as `run_trials` gives them."""
    options = {
        "play": PlaySettings(theta_x=job.theta_x, deadline=job.deadline),
        "seed": SEED,
        "device": device,
        "workers": workers,
    }
    return run_trials(job.table, job.plan, job.thresholds, **options)


def prepared(job: Job) -> Callable[[], Trials]:
    """This project's Monte Carlo on one core with the table's likelihoods made ready beforehand."""
    player = make_player(
        job.table, make_rule(job.thresholds, PlaySettings(theta_x=job.theta_x, deadline=job.deadline), SEED)
    )

    def playing() -> Trials:
        trials = empty_trials(len(job.number), len(job.thresholds))
        player(job.plan, 0, len(job.number), trials)
        return trials

    return playing


def decisions(trials: Trials) -> Decisions:
    """What is compared of trials."""
    return Decisions(*(getattr(trials, name) for name in Decisions._fields))
