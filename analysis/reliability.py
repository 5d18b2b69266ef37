"""Whether the belief in a decision is as often right as it says: at stopping, and after fixed numbers of taps.

A decision is for the object of which the belief is largest. Decisions with belief b are right b of the time if the
measurement model is; the headline is the **miscalibration factor**, the fraction of wrong decisions over the mean of
1 - belief, which is 1 then. A calibrated belief overshoots its threshold, so that wrong / (1 - theta), given beside it,
is about a half when all is well.

With a single object there is nothing to tell but the place: decisions are for the place then, stop by the belief in it,
and places stand where objects stand otherwise. The finger does not move in these trials, nor where there is one place.

Errors persist: an object that is taken for another mostly always is. So everything is also told object by object, and
intervals take the trials that start in one class as a unit; objects are those that there are and are not resampled.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ..hardware.pool import TapPool
from ..inference.control import check_fixation
from ..inference.episode import DEADLINE
from ..inference.montecarlo import run_trials
from ..inference.reference import Border
from ..inference.trial_plan import TapTable, TrialPlan, plan_trials
from ..models.classes import ClassGrid
from ..models.errors import InputError
from .compare_decisions import policies
from .compare_pairing import interval
from .metrics import CONFIDENCE, confusion

CONTACTS = (1, 2, 5, 10, 20, 50)
TRIALS = 4000
RESAMPLES = 400
BINS = 10
EVERYTHING = "all"
"""Label of all objects together."""
COUNTED = ("stopped", "all")
"""Trials that crossed the threshold, and all: at the deadline the most probable is decided. After a fixed number of
taps both are the same."""
MEANS = {
    "wrong": "fraction of wrong decisions",
    "doubt": "mean of 1 - belief in what was decided",
    "log_loss": "mean log loss of 'the decision is right'",
    "brier": "mean Brier score of 'the decision is right'",
    "taps": "mean number of taps",
}
RATIOS = {
    "factor": "miscalibration factor, wrong decisions over 1 - belief",
    "over_promise": "wrong decisions over 1 - threshold",
}
CALIBRATION = {"calibration_error": "mean distance of belief and fraction right"}
_FEWEST = 5  # start places of an object below which single trials are the units of the bootstrap
_LEAST_DOUBT = np.finfo(np.float64).eps  # 1 - belief is not known better


class Subject(NamedTuple):
    """What decisions are about.

    Attributes:
        kind: `"object"`, or `"place"` where there is one object only.
        names: What can be decided for, M of them.
        table: Test taps, whose what classes these are.
        policies: Passive, and active where the finger can move.
    """

    kind: str
    names: tuple[str, ...]
    table: TapTable
    policies: tuple[str, ...]


class Decisions(NamedTuple):
    """How n trials ended at one threshold or after one number of taps; all of shape (n,).

    Attributes:
        true: What class that was there.
        decided: What class that was decided for.
        belief: In the latter.
        stopped: Whether the threshold was crossed; where there is none, always.
        taps: How many it took.
    """

    true: NDArray[np.intp]
    decided: NDArray[np.intp]
    belief: NDArray[np.float64]
    stopped: NDArray[np.bool_]
    taps: NDArray[np.int64]


class Units(NamedTuple):
    """What is resampled.

    Attributes:
        unit: Of each trial, shape (n,).
        true: Object of each unit, shape (U,).
        weights: How often the original and each resample take a unit, shape (1 + R, U).
        single: Whether units are single trials.
    """

    unit: NDArray[np.intp]
    true: NDArray[np.intp]
    weights: NDArray[np.float64]
    single: bool


def reliability(
    table: TapTable,
    grid: ClassGrid,
    thresholds: ArrayLike,
    seed: int,
    *,
    trials: int = TRIALS,
    contacts: Sequence[int] = CONTACTS,
    border: Border = "uniform",
    deadline: int = DEADLINE,
    fixation: int | None = None,
    theta_x: float = 0.0,
    resamples: int = RESAMPLES,
) -> xr.Dataset:
    """How the belief in decisions compares with how often they are right.

    Args:
        table: Test taps as the model sees them.
        grid: The classes.
        thresholds: theta_W, shape (H,), all below 1.
        seed: Of the trials and the resamples.
        trials: Of each policy.
        contacts: Numbers of taps after which passive trials are looked at besides; taps are drawn with replacement.
        border: Reading of Eq. 9.
        deadline: Taps after which the most probable is decided.
        fixation: Where class that active trials aim for; `None` for the middle.
        theta_x: Threshold for a move of active trials.
        resamples: Of the units, for the intervals.

    Returns:
        Dim `setting` with the coordinates `policy`, `theta` (NaN after fixed numbers of taps) and `contacts` (0 at
        stopping); see `at_stopping` and `after_contacts`. Over (setting, counted, what), where what is `EVERYTHING` and
        then each object: `MEANS`, `RATIOS` and `CALIBRATION`, each with `_low` and `_high`, `trials` counted, the
        `fraction` of them, and `replay`, see `replayed`. Over (..., bin), bins of about equally many trials by belief,
        equal beliefs in one bin: `curve_belief`, `curve_right` with `_low` and `_high`, and `curve_trials`. Over
        (setting, counted, true, decided): the `confusion`. NaN where nothing was counted, infinite ratios where
        decisions are wrong of which the belief is 1.

    Raises:
        InputError: There is nothing to decide, or a setting is out of range.
        ZeroEvidenceError: A tap was impossible under every class that was still believed in.
    """
    subject = decided_about(table, grid)
    thresholds = np.unique(np.asarray(thresholds, dtype=np.float64))
    if not len(thresholds) or not (thresholds < 1).all():
        raise InputError(f"Reliability at stopping needs thresholds below 1, got {thresholds.tolist()}.")
    if resamples < 1 or min(contacts, default=1) < 1:
        raise InputError(f"There must be a resample and a tap, got {resamples} and contacts {list(contacts)}.")
    plan = plan_trials(subject.table.pool, trials, seed, check_fixation(fixation, grid.L) if grid.M > 1 else 0)
    units = resampling(plan, subject.table.pool, resamples, seed)
    settings: list[tuple[str, float, int]] = []
    rows: list[dict[str, NDArray[Any]]] = []
    for policy in subject.policies:
        still = policy == "passive"
        stops = [(float("nan"), n) for n in dict.fromkeys(contacts)] if still else []
        played = play(
            subject.table, plan, thresholds, 1.0 if still else theta_x, border=border, deadline=deadline, seed=seed
        )
        for (theta, n), decisions in zip([(t, 0) for t in thresholds.tolist()], played, strict=True):
            settings.append((policy, theta, n))
            rows.append(_described(decisions, theta, units, subject))
        for theta, n in stops:
            (decisions,) = play(subject.table, plan, (1.0,), 1.0, border=border, deadline=n, seed=seed)
            settings.append((policy, theta, n))
            rows.append(_described(decisions._replace(stopped=np.ones(trials, dtype=bool)), theta, units, subject))
    return _dataset(settings, rows, subject, {"trials": trials, "seed": seed, "deadline": deadline, "border": border})


def decided_about(table: TapTable, grid: ClassGrid) -> Subject:
    """What the decisions of trials are about, and the table to play them on.

    Raises:
        InputError: The table holds other classes, or there is one object at one place.
    """
    if table.pool.nearest.shape != grid.shape:
        raise InputError(f"The table holds other classes than the grid of {grid.L} x {grid.M}.")
    if grid.shape == (1, 1):
        raise InputError("One object at one place leaves nothing to decide.")
    if grid.M > 1:
        return Subject("object", grid.what_name, table, policies(grid))
    order, first, count, _ = table.pool
    places = tuple(grid.where_label(l) for l in range(grid.L))
    pool = TapPool(order, first.T.copy(), count.T.copy(), np.where(count.T > 0, 0, -1))
    turned = TapTable(_turned(table.log_likelihood), pool, _turned(table.log_prior[np.newaxis])[0])
    return Subject("place", places, turned, ("passive",))


def play(
    table: TapTable,
    plan: TrialPlan,
    thresholds: ArrayLike,
    theta_x: float,
    *,
    border: Border,
    deadline: int,
    seed: int,
) -> list[Decisions]:
    """Plays trials and gives how they end at each threshold."""
    trials = run_trials(table, plan, thresholds, theta_x=theta_x, border=border, deadline=deadline, seed=seed)
    columns = trials.what.T, trials.belief.T, trials.stopped.T, trials.taps.T
    return [Decisions(plan.what, *column) for column in zip(*columns, strict=True)]


def resampling(plan: TrialPlan, pool: TapPool, resamples: int, seed: int) -> Units:
    """Units of trials and their resamples: each object keeps its units' number.

    Units are the classes that trials start in, or single trials where an object has taps at fewer than five places; of
    these `resampled_interval` takes no more for independent than the test taps allow.
    """
    M = pool.nearest.shape[1]
    few = (pool.count > 0).sum(axis=0)
    label = plan.where * M + plan.what
    single = bool(few[few > 0].min() < _FEWEST)
    if single:
        label = np.arange(len(plan.what))
    _, first, unit = np.unique(label, return_index=True, return_inverse=True)
    true = plan.what[first]
    generator = np.random.default_rng([seed, 2])
    weights = np.ones((1 + resamples, len(true)))
    for m in np.unique(true):
        own = np.flatnonzero(true == m)
        weights[1:, own] = generator.multinomial(len(own), np.full(len(own), 1 / len(own)), size=resamples)
    return Units(unit, true, weights, single)


def independent_decisions(pool: TapPool, m: int | None, trials: int, taps: float) -> float:
    """How many decisions the test taps make if none is used twice, at most the number of trials and at least 1.

    Args:
        pool: The test taps.
        m: Of which object; `None` for all.
        trials: That were played.
        taps: Mean number of taps of a decision.
    """
    count = pool.count.sum() if m is None else pool.count[:, m].sum()
    return float(max(1.0, min(trials, count / max(taps, 1.0))))


def resampled_interval(
    samples: NDArray[np.float64], units: Units, n: int, independent: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The percentile interval over resamples, or a wider one where the units repeat each other.

    Args:
        samples: The estimate and, behind that, R resamples, shape (..., 1 + R).
        units: That were resampled.
        n: Trials that count.
        independent: Number of independent ones: where units are single trials, deviations of resamples are enlarged to
            what so many would have.
    """
    estimate, drawn = samples[..., :1], samples[..., 1:]
    if units.single and n > independent:
        with np.errstate(invalid="ignore"):
            drawn = np.maximum(estimate + np.sqrt(n / independent) * (drawn - estimate), 0.0)
    return interval(drawn)


def replayed(pool: TapPool, m: int | None, taps: float) -> float:
    """How much the evidence of a decision varies more than that of fresh taps because stored ones are drawn again.

    The sum of n draws from N taps of a class, which are drawn from a distribution themselves, has 1 + (n - 1) / N times
    the variance of n fresh ones. A right model is too sure then: well above 1 the factor says as much of the number of
    test taps as of the model.

    Args:
        pool: The test taps.
        m: Of which object; `None` for all.
        taps: Mean number of taps of a decision.
    """
    count = pool.count if m is None else pool.count[:, m]
    return float(1 + max(taps - 1, 0.0) / count[count > 0].mean())


def share_beyond(independent: float) -> float:
    """The upper end of the interval of a proportion of which no case was seen in so many independent ones.

    Three over their number is the familiar rule for an upper end alone; this is that of a two-sided interval.
    """
    return float(1 - ((1 - CONFIDENCE) / 2) ** (1 / independent))


def widened(
    low: NDArray[np.float64], high: NDArray[np.float64], independent: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """An interval of a proportion that reaches at least so far as not a single case, or cases only, would have it.

    A bootstrap cannot know of what never occurred. Where it knows nothing, its ends NaN, the interval goes from 0 to 1.
    """
    beyond = np.vectorize(share_beyond)(independent)
    low, high = np.where(np.isnan(low), 0.0, low), np.where(np.isnan(high), 1.0, high)
    return np.minimum(low, 1 - beyond), np.minimum(np.maximum(high, beyond), 1.0)


def at_stopping(data: xr.Dataset, policy: str) -> xr.Dataset:
    """What `reliability` says of trials that stop by themselves, with the dim `theta` for `setting`."""
    chosen = (data["policy"] == policy).values & (data["contacts"] == 0).values
    return data.isel(setting=chosen).swap_dims(setting="theta").drop_vars(["setting", "contacts"], errors="ignore")


def after_contacts(data: xr.Dataset) -> xr.Dataset:
    """What `reliability` says of passive trials after fixed numbers of taps, with the dim `contacts`."""
    part = data.isel(setting=(data["contacts"] > 0).values, counted=COUNTED.index("all"))
    return part.swap_dims(setting="contacts").drop_vars(["setting", "theta"], errors="ignore")


def headline(data: xr.Dataset, policy: str, theta: float) -> dict[str, Any]:
    """The numbers to say first, at the threshold next to one: plain ones for JSON, `None` where there is none.

    Args:
        data: From `reliability`.
        policy: Which.
        theta: The threshold.
    """
    at = at_stopping(data, policy).sel(theta=theta, method="nearest")
    names = [str(name) for name in at["what"].values]

    def value(name: str, counted: str, what: str) -> list[float | None]:
        cell = at.sel(counted=counted, what=what)
        return [plain(float(cell[name + suffix])) for suffix in ("", "_low", "_high")]

    keys = ("factor", "over_promise", "wrong", "doubt", "calibration_error", "log_loss", "brier", "taps")
    return {
        "policy": policy,
        "theta": float(at["theta"]),
        "decides": str(data.attrs["decides"]),
        "stopped": plain(float(at["fraction"].sel(counted="stopped", what=EVERYTHING))),
        "replay": plain(float(at["replay"].sel(counted="stopped", what=EVERYTHING))),
        **{key: value(key, "stopped", EVERYTHING) for key in keys},
        "all trials": {key: value(key, "all", EVERYTHING) for key in keys},
        "each": {
            name: {key: value(key, "stopped", name) for key in ("factor", "over_promise", "wrong", "doubt")}
            for name in names[1:]
        },
        "confusion": at["confusion"].sel(counted="all").values.tolist(),
    }


def plain(value: float) -> float | None:
    """A number as JSON takes it: `None` for NaN and infinity."""
    return value if np.isfinite(value) else None


def interval_sentence(data: xr.Dataset) -> str:
    """What the intervals of `reliability` mean, in a sentence."""
    return (
        f"Intervals are {CONFIDENCE:.0%} bootstrap intervals that take {data.attrs['units']} as the units, and reach "
        "at least as far as the number of decisions that the test taps make without using one twice allows; they do "
        "not hold how another recording would differ."
    )


def _turned(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values over (N, L, S) of one object in S states as those of L objects at one place, (N, 1, S L)."""
    return np.ascontiguousarray(values.swapaxes(1, 2)).reshape(len(values), 1, -1)


def _described(decisions: Decisions, theta: float, units: Units, subject: Subject) -> dict[str, NDArray[Any]]:
    """Everything about the decisions of one setting, arrays over (counted, what, ...)."""
    M = len(subject.names)
    rows = []
    for stopped_only in (True, False):
        counted = decisions.stopped if stopped_only else np.ones(len(decisions.true), dtype=bool)
        rows.append([_group(decisions, counted, m, theta, units, subject.table.pool) for m in (None, *range(M))])
    joined = {key: np.array([[cell[key] for cell in row] for row in rows]) for key in rows[0][0]}
    joined["confusion"] = np.array(
        [
            confusion(decisions.true[counted], decisions.decided[counted], M)
            for counted in (decisions.stopped, np.ones(len(decisions.true), dtype=bool))
        ]
    )
    return joined


def _group(
    decisions: Decisions, counted: NDArray[np.bool_], m: int | None, theta: float, units: Units, pool: TapPool
) -> dict[str, Any]:
    """Of the decisions that count about one object, or all: means, ratios, calibration error and curve."""
    own = np.ones_like(counted) if m is None else decisions.true == m
    chosen = np.flatnonzero(counted & own)
    n = len(chosen)
    nothing = np.full(BINS, np.nan)
    found: dict[str, Any] = {"trials": n, "fraction": n / own.sum() if own.any() else np.nan, "replay": np.nan}
    if not n:
        found |= {name + end: np.nan for name in (MEANS | RATIOS | CALIBRATION) for end in ("", "_low", "_high")}
        found |= {f"curve_{name}": nothing for name in ("belief", "right", "right_low", "right_high")}
        return found | {"curve_trials": np.zeros(BINS)}

    unit, U, weights = units.unit[chosen], len(units.true), units.weights
    values = _values(decisions, chosen)
    sums = np.stack([np.bincount(unit, values[name], U) for name in MEANS], axis=1)
    count = weights @ np.bincount(unit, minlength=U)
    with np.errstate(divide="ignore", invalid="ignore"):
        samples = dict(zip(MEANS, (weights @ sums / count[:, np.newaxis]).T, strict=True))
        samples["factor"] = samples["wrong"] / samples["doubt"]
        samples["over_promise"] = samples["wrong"] / (1 - theta)
    independent = independent_decisions(pool, m, n, samples["taps"][0])
    beyond = share_beyond(independent)
    found["replay"] = replayed(pool, m, samples["taps"][0])
    for name in MEANS | RATIOS:
        estimate, (low, high) = samples[name][0], resampled_interval(samples[name], units, n, independent)
        if name == "wrong":
            low, high = widened(low, high, independent)
        elif name in RATIOS and np.isfinite(estimate):
            unit_of = samples["doubt"][0] if name == "factor" else 1 - theta
            low, high = np.where(np.isnan(low), 0.0, low), np.where(np.isnan(high), np.inf, high)
            low, high = np.minimum(low, (1 - beyond) / unit_of), np.maximum(high, beyond / unit_of)
        found |= _with_ends(name, estimate, low, high)
    return found | _curve(values, unit, units, count, independent)


def _values(decisions: Decisions, chosen: NDArray[np.intp]) -> dict[str, NDArray[np.float64]]:
    """`MEANS` of single decisions."""
    wrong = (decisions.decided != decisions.true)[chosen].astype(np.float64)
    doubt = np.clip(1 - decisions.belief[chosen], 0.0, 1.0)
    return {
        "wrong": wrong,
        "doubt": doubt,
        "log_loss": -np.where(wrong > 0, np.log(np.maximum(doubt, _LEAST_DOUBT)), np.log1p(-doubt)),
        "brier": (wrong - doubt) ** 2,
        "taps": decisions.taps[chosen].astype(np.float64),
    }


def _curve(
    values: dict[str, NDArray[np.float64]],
    unit: NDArray[np.intp],
    units: Units,
    count: NDArray[np.float64],
    independent: float,
) -> dict[str, Any]:
    """The reliability curve of some decisions, and their calibration error."""
    belief, U, weights = 1 - values["doubt"], len(units.true), units.weights
    cell = unit * BINS + equal_bins(belief)
    size, wrong, doubt = (
        np.bincount(cell, value, U * BINS).reshape(U, BINS)
        for value in (np.ones_like(belief), values["wrong"], values["doubt"])
    )
    trials = size.sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = np.abs(weights @ (wrong - doubt)).sum(axis=1) / count
        right = 1 - (weights @ wrong) / (weights @ size)
        middle = 1 - doubt.sum(axis=0) / trials
    empty = trials == 0
    low, high = widened(
        *resampled_interval(right.T, units, len(unit), independent),
        np.maximum(1.0, independent * trials / trials.sum()),
    )
    e_low, e_high = resampled_interval(errors, units, len(unit), independent)
    # Noise makes it larger, in a resample once more: see `compare_pairing.with_intervals`.
    mirrored = np.clip([2 * errors[0] - e_high, 2 * errors[0] - e_low], 0.0, 1.0)
    return {
        **_with_ends("calibration_error", errors[0], np.fmin(mirrored[0], e_low), np.fmax(mirrored[1], e_high)),
        "curve_belief": middle,
        "curve_right": right[0],
        "curve_right_low": np.where(empty, np.nan, low),
        "curve_right_high": np.where(empty, np.nan, high),
        "curve_trials": trials,
    }


def equal_bins(belief: NDArray[np.float64], bins: int = BINS) -> NDArray[np.intp]:
    """The bin of each belief, about equally many in each and equal beliefs in one, in increasing order; shape (n,)."""
    ordered = np.sort(belief)
    edges = np.unique(ordered[np.arange(bins) * len(ordered) // bins])
    return np.searchsorted(edges, belief, side="right") - 1


def _with_ends(name: str, estimate: Any, low: Any, high: Any) -> dict[str, float]:
    """An estimate and its interval, which is NaN where the estimate is."""
    if np.isnan(estimate):
        low = high = np.nan
    return {name: float(estimate), f"{name}_low": float(low), f"{name}_high": float(high)}


def _dataset(
    settings: Sequence[tuple[str, float, int]],
    rows: Sequence[dict[str, NDArray[Any]]],
    subject: Subject,
    attributes: dict[str, Any],
) -> xr.Dataset:
    meanings = MEANS | RATIOS | CALIBRATION
    dims = {"confusion": ("setting", "counted", "true", "decided")}
    data = {}
    for key in rows[0]:
        own = dims.get(key, ("setting", "counted", "what", *(("bin",) if key.startswith("curve") else ())))
        units = {"log_loss": "nat", "taps": "taps"}.get(key, "")
        data[key] = (own, np.array([row[key] for row in rows]), {"long_name": meanings.get(key, key), "units": units})
    policy, theta, contacts = zip(*settings, strict=True)
    few = (subject.table.pool.count > 0).sum(axis=0)
    units = "single trials" if few[few > 0].min() < _FEWEST else "the classes in which trials start"
    return xr.Dataset(
        data,
        {
            "policy": ("setting", np.array(policy, dtype=np.str_)),
            "theta": ("setting", np.array(theta)),
            "contacts": ("setting", np.array(contacts)),
            "counted": np.array(COUNTED, dtype=np.str_),
            "what": np.array([EVERYTHING, *subject.names], dtype=np.str_),
            "true": np.array(subject.names, dtype=np.str_),
            "decided": np.array(subject.names, dtype=np.str_),
        },
        {**attributes, "decides": subject.kind, "units": units},
    )
