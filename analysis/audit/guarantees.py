"""Error bounds of a stopping rule for a correct model, and the factor by which they are exceeded.

With a correct model and prior, the likelihood at power 1 and the border `clamp`, which is what a finger that stops at
the end of its range does to the belief, two things hold for any moves, because these depend on past taps only:

- **overall**, by Bayes' rule: of the trials that stop, at most 1 - theta are wrong. The chance of a wrong decision is
  the mean of 1 - belief at stopping, and that is below 1 - theta in each of them.
- **for each object**, by Ville's inequality: the chance to stop for a wrong one is at most (M - 1) (1 - theta) / theta,
  the start being drawn from its prior. For a wrong object to be believed at theta, its evidence must exceed that of the
  true one theta / (1 - theta) times, and evidence ratios are martingales.

Trials start in classes with a test tap, alike, and the prior must say so: it does where every class has one. The
paper's root and the border `uniform` are outside the proofs, and no recorded tap was drawn from a fitted model.
"""

from functools import partial
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ...inference.moves.control import check_fixation
from ...inference.trials.records import TapTable, TrialPlan, Trials
from ...inference.trials.resampling import CONFIDENCE, RESAMPLES, play_resamples, spread, trial_noise, widened
from ...models.compiled import compiled
from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.measurement.model import TapModel
from ...models.settings import PlaySettings
from ..stats.decided import Subject, decided_about, independent_decisions
from ..stats.detection import LEVEL
from ..stats.reliability import EVERYTHING, TRIALS, plain
from ..stats.right_model import SIMULATIONS, Beside, compare, simulate
from ..stats.uniformity import rejected
from .dependence.permutation import permutation_test

FEWEST_OF_LARGEST = round(1 / LEVEL) - 1
"""Data sets with which `of_largest` can reject at `LEVEL`."""
PROMISED = "power none, border clamp"
USED = "as used"
_DIMS = ("setup", "policy", "theta", "what")
_COUNTED = ("wrong", "wrong_low", "wrong_high", "doubt", "taps", "stopped")


def guarantees(
    correct: TapTable,
    used: TapTable,
    grid: ClassGrid,
    thresholds: ArrayLike,
    seed: int,
    *,
    play: PlaySettings = PlaySettings(),
    trials: int = TRIALS,
    resamples: int = RESAMPLES,
) -> xr.Dataset:
    """Error rates, and the bounds that the stopping rule guarantees for a correct model.

    Args:
        correct: Test taps as the model at power none sees them; played with the border `clamp`.
        used: The same taps at the power in use; played with the border in use.
        grid: The classes.
        thresholds: theta_W, shape (H,), between 0 and 1.
        seed: Of the trials and the resamples.
        play: How trials are played, those of the active policy whether or not it is passive.
        trials: Of each setup and policy; the same ones.
        resamples: For the intervals.

    Returns:
        Over (setup, policy, theta, what), setup being `PROMISED` or `USED` and what `EVERYTHING` or an object: `wrong`,
        `limit`, and `factor`, which is their ratio and at most 1 where the promise is kept. Overall, wrong is counted
        among the trials that stopped; of an object, those that stopped for another among all of its trials. `wrong` and
        `factor` have `_low` and `_high`; `holds` is whether the interval reaches down to the limit, `doubt` the mean of
        1 - belief of the trials that stopped, `stopped` their fraction, and `taps` the mean number of taps of all.

    Raises:
        InputError: The tables hold different taps, there is nothing to decide, or a setting is out of range.
    """
    thresholds = np.unique(np.asarray(thresholds, dtype=np.float64))
    if not len(thresholds) or not ((thresholds > 0) & (thresholds < 1)).all():
        raise InputError(f"Guarantees need thresholds between 0 and 1, got {thresholds.tolist()}.")
    if not all(np.array_equal(a, b) for a, b in zip(correct.pool, used.pool, strict=True)):
        raise InputError("The tables at power none and at the power in use hold different taps.")
    if resamples < 1:
        raise InputError(f"Intervals need at least one resample, got {resamples}.")
    subjects = [decided_about(table, grid) for table in (correct, used)]
    first = subjects[0]
    M = len(first.names)
    limit = np.array([1 - thresholds, *[(M - 1) * (1 - thresholds) / thresholds] * M]).T
    shape = 2, len(first.policies), len(thresholds), 1 + M
    found = {name: np.full(shape, np.nan) for name in _COUNTED}
    for i, (subject, edge) in enumerate(zip(subjects, ("clamp", play.border), strict=True)):
        for j, policy in enumerate(first.policies):
            kept = play_resamples(
                subject.table,
                thresholds,
                partial(_counts, M),
                trials=trials,
                play=play.changed(border=edge, passive=policy == "passive"),
                fixation=check_fixation(play.fixation, grid.L) if grid.M > 1 else 0,
                seed=seed,
                resamples=resamples,
            )
            for name, values in _described(kept.samples["counts"], subject, trials).items():
                found[name][i, j] = values
    data = {name: (_DIMS, values) for name, values in found.items()}
    result = xr.Dataset(
        {**data, "limit": (("theta", "what"), limit)},
        {
            "setup": np.array((PROMISED, USED)),
            "policy": np.array(first.policies, dtype=np.str_),
            "theta": thresholds,
            "what": np.array([EVERYTHING, *first.names], dtype=np.str_),
        },
        {"trials": trials, "seed": seed, "deadline": play.deadline, "border": play.border, "decides": first.kind},
    )
    for end in ("", "_low", "_high"):
        result[f"factor{end}"] = (result[f"wrong{end}"] / result["limit"]).transpose(*_DIMS)
    result["holds"] = (result["wrong_low"] <= result["limit"]).transpose(*_DIMS)
    return result


def broken(data: xr.Dataset, policy: str, theta: float) -> dict[str, dict[str, list[float | None]]]:
    """By what factors the promises are exceeded at the threshold next to one, as plain numbers for JSON.

    Args:
        data: From `guarantees`.
        policy: Which.
        theta: The threshold.

    Returns:
        By setup and object: the factor and the ends of its interval, `None` where no trial counts.
    """
    at = data.sel(policy=policy).sel(theta=theta, method="nearest").transpose("setup", "what", ...)
    ends = np.stack([at[f"factor{end}"].values for end in ("", "_low", "_high")], axis=-1).tolist()
    return {
        str(setup): {
            str(what): [plain(value) for value in factor] for what, factor in zip(at["what"].values, row, strict=True)
        }
        for setup, row in zip(at["setup"].values, ends, strict=True)
    }


class PromiseTest(NamedTuple):
    """Test whether a bound is exceeded by more than the number of taps explains.

    Attributes:
        exceeded: Whether it is.
        beside: The factor beside what a right model gives; `None` where nothing had to be simulated, as no interval
            lies above its limit.
    """

    exceeded: bool
    beside: Beside | None = None


def exceeded(
    data: xr.Dataset,
    model: TapModel,
    table: TapTable,
    policy: str,
    theta: float,
    *,
    play: PlaySettings = PlaySettings(),
    trials: int = TRIALS // 2,
    simulations: int = SIMULATIONS,
) -> dict[str, PromiseTest]:
    """Which promises at the threshold next to one are exceeded, with power none and border clamp.

    The interval of the factor must lie above 1, and a Monte Carlo test against a right model on as many taps must
    reject, at `detection.LEVEL` for all objects together and each: by Holm's method or, with fewer data sets than
    `SIMULATIONS` and than that method takes, by `of_largest`. Only where an interval does is simulated.

    Args:
        data: From `guarantees`.
        model: At power none.
        table: The test taps as it sees them.
        policy: `"passive"` or `"active"`.
        theta: The threshold.
        play: As in `guarantees`.
        trials: In each simulated data set.
        simulations: Data sets; from `SIMULATIONS` on, and below `FEWEST_OF_LARGEST`, as many as Holm's method takes.

    Returns:
        By object, `EVERYTHING` first.
    """
    at = data.sel(setup=PROMISED, policy=policy).sel(theta=theta, method="nearest")
    names, above = [str(name) for name in at["what"].values], ~at["holds"].values & np.isfinite(at["wrong_low"].values)
    if not above.any():
        return dict.fromkeys(names, PromiseTest(exceeded=False))
    needed = int(np.ceil(len(names) / LEVEL)) - 1
    few = FEWEST_OF_LARGEST <= simulations < min(needed, SIMULATIONS)
    reference = simulate(
        model,
        table,
        [float(at["theta"])],
        play=play.changed(passive=policy == "passive", border="clamp", deadline=int(data.attrs["deadline"])),
        trials=trials,
        seed=int(data.attrs["seed"]),
        simulations=simulations if few else max(simulations, needed),
    ).missed[:, 0]
    factor, limit = at["factor"].values, at["limit"].values
    beside = [compare(value, missed / most) for value, missed, most in zip(factor, reference.T, limit, strict=True)]
    excess = of_largest(factor, reference / limit, LEVEL) if few else rejected([one.above for one in beside], LEVEL)
    sure = above & excess
    return {name: PromiseTest(bool(yes), one) for name, yes, one in zip(names, sure, beside, strict=True)}


def of_largest(observed: ArrayLike, reference: ArrayLike, level: float) -> NDArray[np.bool_]:
    """Which of several values are above those of a right model, by their largest, step by step.

    Under a right model the observed values and those of each data set are exchangeable. They are treated alike, in
    units of the standard deviation of all of them, so however values depend on each other, one that is not above is
    rejected with probability `level` at most (Westfall and Young, "Resampling-Based Multiple Testing", 1993). It
    takes 1 / level - 1 data sets, whatever the number of values.

    Args:
        observed: Shape (V,).
        reference: Of S data sets, shape (S, V).
        level: Of all tests together.

    Returns:
        Shape (V,). Values that are NaN count as 0, as in `right_model.compare`.
    """
    values = np.nan_to_num(np.vstack([observed, reference])).T
    order = np.argsort(-permutation_test(values, two_sided=False).z, kind="stable")
    found = np.zeros(len(values), dtype=bool)
    for step in range(len(values)):
        if permutation_test(values[order[step:]], two_sided=False).family_p > level:
            break
        found[order[step]] = True
    return found


def guarantee_sentence(data: xr.Dataset) -> str:
    """What is promised, what the intervals mean and what counts as exceeded, in three sentences."""
    return (
        "For a correct model with power none and border clamp, at most 1 − theta of the stopped trials are wrong, and "
        f"for each {data.attrs['decides']} at most (M − 1) (1 − theta) / theta of the trials stop for another one. "
        f"Intervals are {CONFIDENCE:.0%} jackknife intervals, leaving out a quarter of the test taps of each class, "
        "or one test session at a time if there are several. A bound counts as exceeded if the interval lies above 1 "
        f"and a correct model on as many taps exceeds it by as much in less than {LEVEL:.0%} of its data sets "
        "(adjusted over all objects: in Holm's way or, with few simulated data sets, by the largest excess)."
    )


def _counts(M: int, trials: Trials, plan: TrialPlan) -> dict[str, NDArray[np.float64]]:
    """Trials with each object: all, stopped, stopped for another, doubt of the stopped, taps of all; (H, M, 5)."""
    counts = np.zeros((trials.taps.shape[1], M, 5))
    _add(trials, plan.what, counts)
    return {"counts": counts}


@compiled
def _add(trials: Trials, true: NDArray[np.intp], counts: NDArray[np.float64]) -> None:
    """Adds trials up as `_counts`."""
    for i in range(len(true)):
        for h in range(len(counts)):
            cell = counts[h, true[i]]
            cell[0] += 1
            if trials.stopped[i, h]:
                cell[1] += 1
                cell[2] += trials.what[i, h] != true[i]
                cell[3] += min(max(1.0 - trials.belief[i, h], 0.0), 1.0)
            cell[4] += trials.taps[i, h]


def _described(counts: NDArray[np.float64], subject: Subject, trials: int) -> dict[str, NDArray[np.float64]]:
    """`_COUNTED` of all objects together and of each, shape (H, 1 + M), from counts (H, M, 5, 1 + 3 R)."""
    how, pool = spread(subject.table, noise=trial_noise(trials), thinned=True), subject.table.pool
    every = np.concatenate([counts.sum(axis=1, keepdims=True), counts], axis=1)
    all_, stopped, missed, doubt, taps = np.moveaxis(every, 2, 0)
    among = all_.copy()
    among[:, 0] = stopped[:, 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        share, per_trial = missed / among, taps[..., 0] / all_[..., 0]
        uncertain, ended = doubt[..., 0] / stopped[..., 0], stopped[..., 0] / all_[..., 0]
    objects = (None, *range(len(subject.names)))
    independent = np.array(
        [
            [
                independent_decisions(pool, m, n, np.nan_to_num(t, nan=1.0))
                for m, n, t in zip(objects, *row, strict=True)
            ]
            for row in zip(among[..., 0], per_trial, strict=True)
        ]
    )
    ends = how.interval(share, 0.0, 1.0)
    low, high = widened(*ends, share[..., 0], how.center(share), independent, opened=how.tells)
    nothing = np.isnan(share[..., 0])
    low, high = np.where(nothing, np.nan, low), np.where(nothing, np.nan, high)
    return dict(zip(_COUNTED, (share[..., 0], low, high, uncertain, per_trial, ended), strict=True))
