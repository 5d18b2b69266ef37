"""What a stopping rule promises when the measurement model is right, and by what factor the promise is broken.

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

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ..inference.control import check_fixation
from ..inference.episode import DEADLINE
from ..inference.reference import Border
from ..inference.trial_plan import TapTable, plan_trials
from ..models.classes import ClassGrid
from ..models.errors import InputError
from .metrics import CONFIDENCE
from .reliability import (
    EVERYTHING,
    RESAMPLES,
    TRIALS,
    Decisions,
    Subject,
    Units,
    decided_about,
    independent_decisions,
    plain,
    play,
    resampled_interval,
    resampling,
    widened,
)

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
    border: Border = "uniform",
    trials: int = TRIALS,
    deadline: int = DEADLINE,
    fixation: int | None = None,
    theta_x: float = 0.0,
    resamples: int = RESAMPLES,
) -> xr.Dataset:
    """How often decisions are wrong, beside what the stopping rule would promise were the model right.

    Args:
        correct: Test taps as the model at power none sees them; played with the border `clamp`.
        used: The same taps at the power in use; played with the border in use.
        grid: The classes.
        thresholds: theta_W, shape (H,), between 0 and 1.
        seed: Of the trials and the resamples.
        border: The one in use.
        trials: Of each setup and policy; the same ones.
        deadline: Taps after which a trial ends without a decision of its own.
        fixation: Where class that active trials aim for; `None` for the middle.
        theta_x: Threshold for a move of active trials.
        resamples: For the intervals.

    Returns:
        Over (setup, policy, theta, what), setup being `PROMISED` or `USED` and what `EVERYTHING` or an object: `wrong`,
        `limit`, and `factor`, which is their ratio and at most 1 where the promise is kept. Overall, wrong is counted
        among the trials that stopped; of an object, those that stopped for another among all of its trials. `wrong` and
        `factor` have `_low` and `_high`; `holds` is whether the interval reaches down to the limit, `doubt` the mean of
        1 - belief of the trials that stopped, `stopped` their fraction, and `taps` the mean number of taps of all.

    Raises:
        InputError: The tables hold different taps, there is nothing to decide, or a setting is out of range.
        ZeroEvidenceError: A tap was impossible under every class that was still believed in.
    """
    thresholds = np.unique(np.asarray(thresholds, dtype=np.float64))
    if not len(thresholds) or not ((thresholds > 0) & (thresholds < 1)).all():
        raise InputError(f"Guarantees need thresholds between 0 and 1, got {thresholds.tolist()}.")
    if not all(np.array_equal(a, b) for a, b in zip(correct.pool, used.pool, strict=True)):
        raise InputError("The tables at power none and at the power in use hold different taps.")
    subjects = [decided_about(table, grid) for table in (correct, used)]
    first = subjects[0]
    M = len(first.names)
    plan = plan_trials(first.table.pool, trials, seed, check_fixation(fixation, grid.L) if grid.M > 1 else 0)
    units = resampling(plan, first.table.pool, resamples, seed)
    limit = np.array([1 - thresholds, *[(M - 1) * (1 - thresholds) / thresholds] * M]).T
    shape = 2, len(first.policies), len(thresholds), 1 + M
    found = {name: np.full(shape, np.nan) for name in _COUNTED}
    for i, (subject, edge) in enumerate(zip(subjects, ("clamp", border), strict=True)):
        for j, policy in enumerate(first.policies):
            moves = 1.0 if policy == "passive" else theta_x
            played = play(subject.table, plan, thresholds, moves, border=edge, deadline=deadline, seed=seed)
            for h, decisions in enumerate(played):
                for name, values in _counted(decisions, units, subject).items():
                    found[name][i, j, h] = values
    data = {name: (_DIMS, values) for name, values in found.items()}
    result = xr.Dataset(
        {**data, "limit": (("theta", "what"), limit)},
        {
            "setup": np.array((PROMISED, USED)),
            "policy": np.array(first.policies, dtype=np.str_),
            "theta": thresholds,
            "what": np.array([EVERYTHING, *first.names], dtype=np.str_),
        },
        {"trials": trials, "seed": seed, "deadline": deadline, "border": border, "decides": first.kind},
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
    at = data.sel(policy=policy).sel(theta=theta, method="nearest")
    return {
        str(setup): {
            str(what): [plain(float(at[f"factor{end}"].sel(setup=setup, what=what))) for end in ("", "_low", "_high")]
            for what in at["what"].values
        }
        for setup in at["setup"].values
    }


def guarantee_sentence(data: xr.Dataset) -> str:
    """What is promised and what the intervals mean, in two sentences."""
    return (
        "With a right model, power none and border clamp at most 1 - theta of the stopped trials are wrong, and of "
        f"each {data.attrs['decides']} at most (M - 1) (1 - theta) / theta stop for another. Intervals are "
        f"{CONFIDENCE:.0%} bootstrap intervals over the starts of trials on these test taps."
    )


def _counted(decisions: Decisions, units: Units, subject: Subject) -> dict[str, NDArray[np.float64]]:
    """`_COUNTED` of all objects together and of each, shape (1 + M,)."""
    stopped = decisions.stopped
    missed = stopped & (decisions.decided != decisions.true)
    doubt = np.clip(1 - decisions.belief, 0.0, 1.0)
    columns = []
    for m in (None, *range(len(subject.names))):
        own = np.ones_like(stopped) if m is None else decisions.true == m
        among = stopped if m is None else own
        n, ended = int(among.sum()), own & stopped
        if not n:
            columns.append([np.nan] * (len(_COUNTED) - 1) + [0.0 if own.any() else np.nan])
            continue
        U = len(units.true)
        size = units.weights @ np.bincount(units.unit[among], minlength=U)
        with np.errstate(invalid="ignore", divide="ignore"):
            share = units.weights @ np.bincount(units.unit[own & missed], minlength=U) / size
        independent = independent_decisions(subject.table.pool, m, n, float(decisions.taps[among].mean()))
        low, high = widened(*resampled_interval(share, units, n, independent), independent)
        uncertain = doubt[ended].mean() if ended.any() else np.nan
        columns.append([share[0], low, high, uncertain, decisions.taps[own].mean(), ended.sum() / own.sum()])
    return dict(zip(_COUNTED, np.array(columns).T, strict=True))
