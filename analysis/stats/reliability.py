"""Reliability of beliefs: fraction of correct decisions against belief, at stopping and after fixed numbers of taps.

A decision is for the object of which the belief is largest. Decisions with belief b are right b of the time if the
measurement model is; the headline is the **miscalibration factor**, the fraction of wrong decisions over the mean of
1 - belief, which is 1 then. A calibrated belief overshoots its threshold, so that wrong / (1 - theta), given beside it,
is about a half when all is well.

With a single object there is nothing to tell but the place: decisions are for the place then, stop by the belief in it,
and places stand where objects stand otherwise. The finger does not move in these trials, nor where there is one place.

Trials draw no tap twice, see `inference.trials.resampling`: drawing the same few stored taps again makes right beliefs
too sure by a factor of three and more. Errors persist: an object that is taken for another mostly always is. So
everything is also told object by object; objects are those that there are and are not resampled.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ...inference.moves.control import check_fixation
from ...inference.trials.records import Farthest, TapTable, TrialPlan, Trials, endings, plan_trials
from ...inference.trials.resampling import (
    CONFIDENCE,
    RESAMPLE_TRIALS,
    RESAMPLES,
    Spread,
    no_endings,
    play_resamples,
    resamples_in_words,
    spread,
    too_few_in,
    trial_noise,
    widened,
)
from ...inference.trials.selections import sessions_drawn, sessions_in_words
from ...models.compiled import compiled
from ...models.errors import InputError
from ...models.grid import ClassGrid, TapPool
from ...models.settings import PlaySettings
from .decided import (
    DecidedTrials,
    Subject,
    decided_about,
    decided_trials,
    decisions_of,
    independent_decisions,
)
from .metrics import SHARE, Range, confusion, of_taps

CONTACTS = (1, 2, 5, 10, 20, 50)
TRIALS = 4000
THETAS = (0.5, 0.8, 0.9, 0.95, 0.99)
"""Thresholds at which an audit compares beliefs with outcomes, beside the one in use."""
BINS = 10
EVERYTHING = "all"
"""Label of all objects together."""
COUNTED = ("stopped", "all")
"""Trials that crossed the threshold, and all: at the deadline the most probable is decided. After a fixed number of
taps both are the same."""
MEANS = {
    "wrong": "fraction of wrong decisions",
    "doubt": "mean of 1 - belief in what was decided",
    "log_loss": "mean log loss of 'the decision is correct'",
    "brier": "mean Brier score of 'the decision is correct'",
    "taps": "mean number of taps",
}
RATIOS = {
    "factor": "miscalibration factor, wrong decisions over 1 - belief",
    "over_promise": "wrong decisions over 1 - threshold",
}
CALIBRATION = {"calibration_error": "mean distance between belief and fraction correct"}
_SHARES = ("wrong", "doubt", "brier")
_SCORES = ("log_loss", "brier")
_ENOUGH = 0.9  # of the classes must have as many taps as are looked at after
_ROUNDING = 1e-9  # of beliefs
_LEAST_DOUBT = np.finfo(np.float64).eps  # 1 - belief is not known better


class Sums(NamedTuple):
    """What is kept of trials, by threshold, `COUNTED` and true object, and where joined by `play_resamples`.

    Attributes:
        sums: Of 1 and of `MEANS`, shape (H, 2, M, 6).
        curve: Of 1, wrong and doubt by bin of belief, for all objects and each, shape (H, 2, 1 + M, BINS, 3).
        used_up: Share of trials that ended because the stored taps of a class were used up, shape (H,).
    """

    sums: NDArray[np.float64]
    curve: NDArray[np.float64]
    used_up: NDArray[np.float64]


def reliability(
    table: TapTable,
    grid: ClassGrid,
    thresholds: ArrayLike,
    seed: int,
    *,
    trials: int = TRIALS,
    contacts: Sequence[int] = CONTACTS,
    play: PlaySettings = PlaySettings(),
    resamples: int = RESAMPLES,
    resample_trials: int = RESAMPLE_TRIALS,
    only: str | None = None,
) -> xr.Dataset:
    """Beliefs in decisions compared with the fraction of correct ones.

    Args:
        table: Test taps as the model sees them.
        grid: The classes.
        thresholds: theta_W, shape (H,), all below 1.
        seed: Of the trials and the resamples.
        trials: Of each policy.
        contacts: Numbers of taps after which passive trials are looked at besides, where nearly all classes have them.
        play: How trials are played, those of the active policy whether or not it is passive.
        resamples: Of the test taps, for the intervals.
        resample_trials: On each of them.
        only: The policy to play; `None` for passive, and active where the finger can move.

    Returns:
        Dim `setting` with the coordinates `policy`, `theta` (NaN after fixed numbers of taps) and `contacts` (0 at
        stopping); see `at_stopping` and `after_contacts`. Over (setting, counted, what), where what is `EVERYTHING` and
        then each object: `MEANS`, `RATIOS` and `CALIBRATION`, each with `_low` and `_high`, `trials` counted and the
        `fraction` of them. Over (..., bin), bins of about equally many trials by belief, equal beliefs in one bin:
        `curve_belief`, `curve_right` with `_low` and `_high`, and `curve_trials`. Over (setting, counted, true,
        decided): the `confusion`. Over (setting): `used_up`, the share of trials that the stored taps ended, and `few`,
        whether there are too few of them, see `resampling.spread`. NaN where nothing was counted, infinite ratios where
        decisions are wrong of which the belief is 1.

    Raises:
        InputError: There is nothing to decide, or a setting is out of range.
    """
    subject = decided_about(table, grid)
    thresholds = np.unique(np.asarray(thresholds, dtype=np.float64))
    if not len(thresholds) or not (thresholds < 1).all():
        raise InputError(f"Reliability at stopping needs thresholds below 1, got {thresholds.tolist()}.")
    if resamples < 1 or min(contacts, default=1) < 1:
        raise InputError(
            f"At least one resample and one tap are required, got {resamples} and contacts {list(contacts)}."
        )
    aim = check_fixation(play.fixation, grid.L) if grid.M > 1 else 0
    plan = plan_trials(subject.table.pool, trials, seed, aim)
    options: dict[str, Any] = {"trials": trials, "fixation": aim, "seed": seed, "resamples": resamples}
    how = spread(subject.table, noise=trial_noise(trials, resample_trials), thinned=True)
    far = Farthest.among(*subject.table.pool.shape)

    def might_be(most: int, played: Trials, plan: TrialPlan) -> list[Trials]:
        best, worst = endings(played, plan, most, far)
        return [best, worst, best._replace(belief=np.where(played.used_up, 1.0, best.belief))]

    settings: list[tuple[str, float, int]] = []
    rows: list[dict[str, NDArray[Any]]] = []
    for policy in subject.policies if only is None else (only,):
        still = policy == "passive"
        stops = [
            (thresholds, play.deadline),
            *((np.ones(1), n) for n in _answerable(subject.table.pool, contacts) if still),
        ]
        for theta, most in stops:
            fixed = bool((theta == 1).all())
            how_played = play.changed(passive=still, deadline=most)
            played = decided_trials(subject.table, plan, theta, how_played, seed, fresh=True)
            if fixed:
                played = [one._replace(stopped=np.ones(trials, dtype=bool)) for one in played]
            edges = np.array(
                [[_edges(one, counted, len(subject.names)) for counted in (True, False)] for one in played]
            )
            ends = no_endings if fixed else partial(might_be, most)
            kept = play_resamples(
                subject.table,
                theta,
                partial(_sums, edges, fixed),
                resample_trials=resample_trials,
                play=how_played,
                endings=ends,
                **options,
            )
            samples = kept.samples | {"used_up": kept.per_trial().samples["used_up"]}
            for h, decisions in enumerate(played):
                settings.append((policy, float("nan") if fixed else float(theta[h]), most if fixed else 0))
                one = Sums(**{name: values[h] for name, values in samples.items()})
                ends_of = [end["sums"][h] for end in kept.endings]
                rows.append(_described(decisions, one, ends_of, settings[-1][1], most, subject, how))
    return _dataset(
        settings, rows, subject, {"trials": trials, "seed": seed, "deadline": play.deadline, "border": play.border}
    )


def _answerable(pool: TapPool, contacts: Sequence[int]) -> list[int]:
    """The numbers of taps that nearly every class has."""
    count = pool.count[pool.count > 0]
    return [n for n in dict.fromkeys(contacts) if (count >= n).mean() >= _ENOUGH]


def at_stopping(data: xr.Dataset, policy: str) -> xr.Dataset:
    """What `reliability` says of trials that stop by themselves, with the dim `theta` for `setting`."""
    chosen = (data["policy"] == policy).values & (data["contacts"] == 0).values
    return data.isel(setting=chosen).swap_dims(setting="theta").drop_vars(["setting", "contacts"], errors="ignore")


def after_contacts(data: xr.Dataset) -> xr.Dataset:
    """What `reliability` says of passive trials after fixed numbers of taps, with the dim `contacts`."""
    part = data.isel(setting=(data["contacts"] > 0).values, counted=COUNTED.index("all"))
    return part.swap_dims(setting="contacts").drop_vars(["setting", "theta"], errors="ignore")


def headline(data: xr.Dataset, policy: str, theta: float) -> dict[str, Any]:
    """Headline numbers at the threshold nearest to a given one: plain for JSON, `None` if missing.

    Args:
        data: From `reliability`.
        policy: Which.
        theta: The threshold.

    Returns:
        Scores with the ends of their intervals: of the trials that stop, of `all trials`, and of `each` object; what
        they decide about, shares that stopped and used up the stored taps, and the confusion.
    """
    at = at_stopping(data, policy).sel(theta=theta, method="nearest").transpose("counted", "what", ...)
    names = [str(name) for name in at["what"].values]

    def value(name: str, counted: str, what: str) -> list[float | None]:
        cell = COUNTED.index(counted), names.index(what)
        return [plain(float(at[name + suffix].values[cell])) for suffix in ("", "_low", "_high")]

    keys = ("factor", "over_promise", "wrong", "doubt", "calibration_error", "log_loss", "brier", "taps")
    return {
        "policy": policy,
        "theta": float(at["theta"]),
        "decides": str(data.attrs["decides"]),
        "stopped": plain(float(at["fraction"].sel(counted="stopped", what=EVERYTHING))),
        "used_up": plain(float(at["used_up"])),
        "few": str(at["few"].values),
        **{key: value(key, "stopped", EVERYTHING) for key in keys},
        "all trials": {key: value(key, "all", EVERYTHING) for key in keys},
        "each": {name: {key: value(key, "all", name) for key in keys[:4]} for name in names[1:]},
        "confusion": at["confusion"].sel(counted="all").values.tolist(),
    }


def plain(value: float) -> float | None:
    """A number as JSON takes it: `None` for NaN and infinity."""
    return value if np.isfinite(value) else None


def interval_sentence(data: xr.Dataset) -> str:
    """Sentence that explains the intervals of `reliability`."""
    sessions = data.attrs["sessions"]
    return (
        f"Intervals are {CONFIDENCE:.0%} jackknife intervals: the trials are replayed on the test taps "
        f"{resamples_in_words(sessions)}{'' if sessions > 1 else '; another session may differ by more'}. Taps are "
        "fresh: no trial uses a tap twice. A trial that uses up the stored taps of a class decides there; intervals "
        f"cover any outcome of further taps. {data.attrs['of_sessions']}"
    ).rstrip()


def _edges(decisions: DecidedTrials, stopped_only: bool, M: int) -> NDArray[np.float64]:
    """Lower ends of the bins of belief, for all objects and each, infinite behind the last; shape (1 + M, BINS)."""
    counted = decisions.stopped if stopped_only else np.ones(len(decisions.true), dtype=bool)
    ends = np.full((1 + M, BINS), np.inf)
    for g, group in enumerate((counted, *(counted & (decisions.true == m) for m in range(M)))):
        own = bin_edges(decisions.belief[group])
        ends[g, : len(own)] = own
    return ends


def _sums(edges: NDArray[np.float64], fixed: bool, trials: Trials, plan: TrialPlan) -> dict[str, NDArray[np.float64]]:
    """`Sums` of trials by bins (H, 2, 1 + M, BINS); those of a fixed number of taps all count as stopped."""
    H, _, groups, _ = edges.shape
    sums, curve = np.zeros((H, 2, groups - 1, 1 + len(MEANS))), np.zeros((H, 2, groups, BINS, 3))
    for h, decisions in enumerate(decisions_of(trials, plan)):
        every = np.ones(len(decisions.true))
        values = np.stack([every, *_values(decisions).values()], axis=1)
        for c, counted in enumerate((fixed | decisions.stopped, every > 0)):
            _add(values, decisions.true, counted, decisions.belief, edges[h, c], sums[h, c], curve[h, c])
    return {"sums": sums, "curve": curve, "used_up": trials.used_up.sum(axis=0, dtype=float)}


@compiled
def _add(
    values: NDArray[np.float64],
    true: NDArray[np.intp],
    counted: NDArray[np.bool_],
    belief: NDArray[np.float64],
    ends: NDArray[np.float64],
    sums: NDArray[np.float64],
    curve: NDArray[np.float64],
) -> None:
    """Adds up values (n, 6) by what is true and, the first three, by bin of belief; groups without a bin have none."""
    for i in range(len(true)):
        if counted[i]:
            for v in range(sums.shape[1]):
                sums[true[i], v] += values[i, v]
            for g in (0, 1 + true[i]):
                if ends[g, 0] < np.inf:
                    place = 0
                    for end in range(1, ends.shape[1]):
                        place += ends[g, end] <= belief[i]
                    for v in range(3):
                        curve[g, place, v] += values[i, v]


def _described(
    decisions: DecidedTrials,
    joined: Sums,
    ends: Sequence[NDArray[np.float64]],
    theta: float,
    deadline: int,
    subject: Subject,
    how: Spread,
) -> dict[str, NDArray[Any]]:
    """Everything about the decisions of one setting, arrays over (counted, what, ...).

    Args:
        decisions: Of the trials.
        joined: What was kept of them and of resamples.
        ends: What the sums of the former might have been besides, each of shape (2, M, 6); the last for scores only.
        theta: The threshold.
        deadline: Taps after which a trial ends.
        subject: What decisions are about.
        how: How resamples turn into intervals.
    """
    pool, M, everyone = subject.table.pool, len(subject.names), np.ones(len(decisions.true), dtype=bool)
    samples, size = _ratios(joined.sums, theta)
    might_be = [_ratios(end, theta)[0] for end in ends]
    with np.errstate(divide="ignore", invalid="ignore"):
        fraction = size[..., 0] / size[1, :, 0]
    taps = samples["taps"][..., 0]
    independent = np.array(
        [
            [independent_decisions(pool, m, n, t) for m, n, t in zip((None, *range(M)), counts, means, strict=True)]
            for counts, means in zip(size[..., 0], np.nan_to_num(taps, nan=1.0), strict=True)
        ]
    )
    found: dict[str, Any] = {
        "trials": size[..., 0],
        "fraction": fraction,
        "used_up": float(joined.used_up[0]),
        "few": too_few_in(pool, how, joined.used_up),
    }
    limits = dict.fromkeys(_SHARES, SHARE) | {"taps": of_taps(deadline)}
    for name in MEANS | RATIOS:
        least, most, step = limits.get(name, Range())
        ends_of = might_be if name in _SCORES else might_be[:-1]
        low, high = how.interval(samples[name], least, most, [one[name] for one in ends_of])
        if name == "taps":
            center = how.center(samples[name])
            low, high = widened(low, high, taps, center, independent, step, most, least=least)
        if name in ("wrong", *RATIOS):
            unit = {"wrong": 1.0, "factor": samples["doubt"][..., 0], "over_promise": 1 - theta}[name]
            with np.errstate(divide="ignore", invalid="ignore"):
                value, center = samples[name][..., 0] * unit, how.center(samples[name]) * unit
                ends = widened(low * unit, high * unit, value, center, independent, opened=how.tells)
                low, high = (end / unit for end in ends)
        found |= _with_ends(name, samples[name][..., 0], low, high)
    found |= _curve(joined.curve, size, independent, how)
    found["confusion"] = np.array(
        [confusion(decisions.true[some], decisions.decided[some], M) for some in (decisions.stopped, everyone)]
    )
    return found


def _ratios(sums: NDArray[np.float64], theta: float) -> tuple[dict[str, NDArray[np.float64]], NDArray[np.float64]]:
    """`MEANS` and `RATIOS` of sums (2, M, 6, ...), of all objects together and of each, and how many were counted."""
    total = np.concatenate([sums.sum(axis=1, keepdims=True), sums], axis=1)
    size = total[:, :, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        means = {name: total[:, :, 1 + i] / size for i, name in enumerate(MEANS)}
        means["factor"] = means["wrong"] / means["doubt"]
    return means | {"over_promise": means["wrong"] / (1 - theta)}, size


def _values(decisions: DecidedTrials) -> dict[str, NDArray[np.float64]]:
    """`MEANS` of single decisions."""
    wrong = (decisions.decided != decisions.true).astype(np.float64)
    doubt = np.clip(1 - decisions.belief, 0.0, 1.0)
    return {
        "wrong": wrong,
        "doubt": doubt,
        "log_loss": -np.where(wrong > 0, np.log(np.maximum(doubt, _LEAST_DOUBT)), np.log1p(-doubt)),
        "brier": (wrong - doubt) ** 2,
        "taps": decisions.taps.astype(np.float64),
    }


def _curve(
    curve: NDArray[np.float64], size: NDArray[np.float64], independent: NDArray[np.float64], how: Spread
) -> dict[str, Any]:
    """Reliability curves from bins (2, 1 + M, BINS, 3, 1 + 3 R), and their calibration errors."""
    count, wrong, doubt = np.moveaxis(curve, 3, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = np.abs(wrong - doubt).sum(axis=2) / size
        right = 1 - wrong / count
        middle = (1 - doubt / count)[..., 0]
        trials = count[..., 0]
        share = trials / trials.sum(axis=2, keepdims=True)
    low, high = how.interval(right, 0.0, 1.0)
    seldom = independent[..., np.newaxis] * np.nan_to_num(share)
    low, high = widened(low, high, right[..., 0], how.center(right), seldom, opened=how.tells)
    empty = trials == 0
    e_low, e_high = how.interval(errors, 0.0, 1.0)
    # Noise makes it larger, in a resample once more: see `pairing.with_intervals`.
    excess = np.maximum(np.nan_to_num(how.center(errors) - errors[..., 0]), 0.0)
    return {
        **_with_ends("calibration_error", errors[..., 0], np.maximum(e_low - excess, 0.0), e_high),
        "curve_belief": middle,
        "curve_right": right[..., 0],
        "curve_right_low": np.where(empty, np.nan, low),
        "curve_right_high": np.where(empty, np.nan, high),
        "curve_trials": trials,
    }


def bin_edges(belief: NDArray[np.float64], bins: int = BINS) -> NDArray[np.float64]:
    """Lower ends of bins of about equally many beliefs, equal ones in one bin, increasing; at most `bins`.

    Beliefs after the same taps in another order are equal but for rounding, so ends lie just below them.
    """
    ordered = np.sort(belief)
    if not len(ordered):
        return ordered
    ends = ordered[np.arange(bins) * len(ordered) // bins]
    return ends[np.diff(ends, prepend=-np.inf) > 2 * _ROUNDING] - _ROUNDING


def _with_ends(
    name: str, estimate: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    """An estimate and its interval, which is NaN where the estimate is."""
    ends = (np.where(np.isnan(estimate), np.nan, end) for end in (low, high))
    return {name: estimate} | dict(zip((f"{name}_low", f"{name}_high"), ends, strict=True))


def _dataset(
    settings: Sequence[tuple[str, float, int]],
    rows: Sequence[dict[str, NDArray[Any]]],
    subject: Subject,
    attributes: dict[str, Any],
) -> xr.Dataset:
    meanings = MEANS | RATIOS | CALIBRATION
    dims = {"confusion": ("setting", "counted", "true", "decided"), "used_up": ("setting",), "few": ("setting",)}
    data = {}
    for key in rows[0]:
        own = dims.get(key, ("setting", "counted", "what", *(("bin",) if key.startswith("curve") else ())))
        units = {"log_loss": "nat", "taps": "taps"}.get(key, "")
        data[key] = (own, np.array([row[key] for row in rows]), {"long_name": meanings.get(key, key), "units": units})
    policy, theta, contacts = zip(*settings, strict=True)
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
        {
            **attributes,
            "decides": subject.kind,
            "sessions": sessions_drawn(subject.table),
            "of_sessions": sessions_in_words(subject.table),
        },
    )
