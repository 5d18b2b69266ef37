"""Models compared by their decisions: the same trials, passive and active, played by every model.

`play_models` plays once, on the test taps and on resamples of them; `decision_curves` and `at_equal_taps` are two views
of that. Trials pair across models and policies: they have the same resamples, starts and random numbers. No trial draws
a tap twice, see `inference.trials.resampling`.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ...inference.moves.control import check_fixation
from ...inference.trials.records import ENDINGS, Farthest, TapTable, TrialPlan, Trials, endings
from ...inference.trials.resampling import (
    CONFIDENCE,
    RESAMPLE_TRIALS,
    RESAMPLES,
    USED_UP,
    USED_UP_SELECTED,
    Spread,
    planned_trials,
    play_resamples,
    spread,
    taps_per_class,
    too_few,
    trial_noise,
)
from ...inference.trials.selections import sessions_in_words
from ...models.compiled import compiled
from ...models.errors import InputError
from ...models.grid import ClassGrid, policies
from ...models.settings import PlaySettings
from .metrics import SHARE, Range, ranges
from .pairing import check_tables, reference_name, with_intervals

MEANS = {
    "what_error": "mean object error",
    "where_error": "mean position error at the decision",
    "taps": "mean reaction time",
    "stopped_fraction": "fraction of trials that cross the threshold before the deadline",
    "doubt": "mean of 1 - belief in the decided object",
    "what_wrong": "fraction of trials that decide for a wrong object",
    "used_up": "fraction of trials that end because the stored taps of a class are used up",
    "no_class_left": "fraction of trials that end with a tap that is impossible under every remaining class",
}
MISCALIBRATION = "fraction of wrong objects over the mean of 1 - belief"
ERRORS = ("what_error", "where_error", "what_wrong")
_ROUND = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
SELECTED = "used_up_selected"
SHARES = ("stopped_fraction", "what_wrong", "used_up", "no_class_left")
_SELDOM = (*ERRORS, *SHARES, "taps")
"""What may not have been seen at all: errors, ends without a decision, decisions of more than one tap."""
_RANGES = dict.fromkeys((*SHARES, "doubt"), SHARE)


def play_models(
    tables: Mapping[str, TapTable],
    grid: ClassGrid,
    thresholds: ArrayLike,
    trials: int,
    seed: int,
    *,
    play: PlaySettings = PlaySettings(),
    resamples: int = RESAMPLES,
    resample_trials: int = RESAMPLE_TRIALS,
    only: str | None = None,
    highest: Mapping[str, float] | None = None,
    progress: Callable[[int], None] | None = None,
) -> xr.Dataset:
    """Means over the same trials on the test taps, and over the same trials on resamples of them, for every model.

    Args:
        tables: The same test taps as every model sees them, by the model's name.
        grid: The classes.
        thresholds: theta_W, shape (H,), any order; sorted in the result.
        trials: Of each model and policy, starting anywhere; resamples take fewer.
        seed: Of the trials and the resamples.
        play: How trials are played, those of the active policy whether or not it is passive.
        resamples: How many.
        resample_trials: On each of them.
        only: The policy to play; `None` for all of `policies`.
        highest: The highest threshold that a model is played to, by its name; beyond are NaN. `None` for all.
        progress: Called with the number of trials finished since the last call, see `planned`.

    Returns:
        `MEANS` over (model, policy, theta, resample); resample 0 holds the taps as they are, and halves of the trials
        on the others follow behind these, see `resampling.ResampledTrials`. With the suffixes of `ENDINGS` what
        resample 0 might have been besides, see `inference.trials.records`. Attributes `factor`, see `spread_of`,
        `taps_per_class`, `of_sessions`, `test_taps`, and `range_<name>` of what has one, see `ranges.Range`.

    Raises:
        InputError: The tables do not hold the same taps or are not of this grid, or a setting is out of range.
    """
    if check_tables(tables) != grid.shape:
        raise InputError(f"The classes of the tables do not match the grid of {grid.L} x {grid.M}.")
    if resamples < 1:
        raise InputError(f"Intervals need at least one resample, got {resamples}.")
    thresholds = np.sort(np.atleast_1d(np.asarray(thresholds, dtype=np.float64)))
    played = policies(grid) if only is None else (only,)
    shape = len(tables), len(played), len(MEANS), len(thresholds)
    means, ends = np.full((*shape, 1 + 3 * resamples), np.nan), np.full((len(ENDINGS), *shape), np.nan)
    between = _between(grid)
    for i, (model, table) in enumerate(tables.items()):
        some = thresholds[thresholds <= (np.inf if highest is None else highest[model])]
        for j, policy in enumerate(played):
            kept = play_resamples(
                table,
                some,
                partial(_sums, between),
                trials=trials,
                play=play.changed(passive=policy != "active"),
                fixation=check_fixation(play.fixation, grid.L),
                seed=seed,
                resamples=resamples,
                resample_trials=resample_trials,
                progress=progress,
                endings=partial(endings, deadline=play.deadline, farthest=Farthest.on(grid)),
            ).per_trial()
            means[i, j, :, : len(some)] = [kept.samples[name] for name in MEANS]
            ends[:, i, j, :, : len(some)] = [[ending[name] for name in MEANS] for ending in kept.endings]
    dims = ("model", "policy", "theta", "resample")
    units = {"what_error": grid.what_error_unit, "where_error": grid.where_unit, "taps": "taps"}
    table = next(iter(tables.values()))
    how = spread(table, thinned=True)
    return xr.Dataset(
        {
            name: (dims, means[:, :, i], {"long_name": meaning, "units": units.get(name, "")})
            for i, (name, meaning) in enumerate(MEANS.items())
        }
        | {
            name + suffix: (dims[:-1], ends[e, :, :, i])
            for i, name in enumerate(MEANS)
            for e, suffix in enumerate(ENDINGS)
        },
        {
            "model": np.array(list(tables), dtype=np.str_),
            "policy": np.array(played, dtype=np.str_),
            "theta": thresholds,
        },
        {
            "what_unit": grid.what_error_unit,
            "where_unit": grid.where_unit,
            "trials": trials,
            "seed": seed,
            "resamples": resamples,
            "resample_trials": resample_trials,
            "factor": how.factor,
            "freedom": how.freedom,
            "sessions": how.sessions,
            "taps_per_class": taps_per_class(table.pool),
            "of_sessions": sessions_in_words(table),
            "test_taps": int(table.pool.count.sum()),
            **{f"range_{name}": one for name, one in (_RANGES | ranges(grid, play.deadline)).items()},
        },
    )


def planned(models: int, grid: ClassGrid, trials: int, resamples: int = RESAMPLES) -> int:
    """How many trials `play_models` plays."""
    return models * len(policies(grid)) * planned_trials(trials, resamples)


def spread_of(played: xr.Dataset) -> Spread:
    """How the resamples of `play_models` turn into intervals."""
    attributes = played.attrs
    return Spread(
        attributes["factor"],
        taps=attributes["test_taps"],
        noise=trial_noise(attributes["trials"], attributes["resample_trials"]),
        freedom=attributes["freedom"],
        sessions=attributes["sessions"],
    )


def decision_curves(played: xr.Dataset, reference: str | None = None) -> xr.Dataset:
    """What each model decides at each threshold, with intervals and paired differences to one of them.

    The miscalibration is P(wrong object) over the mean of 1 - belief, over all trials whether stopped or out of time:
    1 is right, more is overconfident. It is NaN where no decision is wrong, as nothing tells it from 0 then, and
    infinite where decisions are wrong of which the belief is 1.

    Args:
        played: From `play_models`.
        reference: Model that the others are compared with, by default the first.

    Returns:
        Dims (model, policy, theta): `MEANS` and `miscalibration`, each with `_low`, `_high`, `_difference` (model
        less reference), `_difference_low` and `_difference_high`; and `used_up_selected`, the mean of `used_up` where a
        quarter of the taps is left out.

    Raises:
        InputError: There is no such model.
    """
    samples = {name: played[name].values for name in MEANS}
    ends = {name: _endings(played, name) for name in MEANS}
    with np.errstate(divide="ignore", invalid="ignore"):
        samples["miscalibration"], ends["miscalibration"] = (
            one["what_wrong"] / one["doubt"] for one in (samples, ends)
        )
    samples["miscalibration"][samples["what_wrong"][..., 0] == 0] = np.nan
    attributes = {name: played[name].attrs for name in MEANS}
    attributes["miscalibration"] = {"long_name": MISCALIBRATION, "units": ""}
    times = played["taps"].values[..., 0]
    result = _compared(played, samples, ends, "theta", played["theta"].values, times, reference, attributes)
    result[SELECTED] = (("model", "policy", "theta"), spread_of(played).center(samples["used_up"]))
    return result


def at_equal_taps(played: xr.Dataset, taps: ArrayLike | None = None, reference: str | None = None) -> xr.Dataset:
    """Errors of each model at equal mean reaction times, with intervals and paired differences to one of them.

    Errors are interpolated linearly in the mean reaction time between thresholds, in every resample by its own
    curve: what one reaches by throwing a coin for each trial which of the two thresholds to use. Nothing is
    extrapolated: beyond a model's slowest or fastest threshold its errors are NaN, and intervals are where one
    resample in twenty leaves that range.

    Args:
        played: From `play_models`.
        taps: Mean reaction times in taps, shape (n,); default round ones that the reference and another model reach
            in nearly every resample, which may be none.
        reference: Model that the others are compared with, by default the first.

    Returns:
        Dims (model, policy, taps): `ERRORS`, each with `_low`, `_high`, `_difference` (model less reference),
        `_difference_low` and `_difference_high`, and likewise `_step`, see `pairing.with_intervals`; and over (policy,
        taps) whether a time is `common` to all models.

    Raises:
        InputError: There is no such model.
    """
    times, late = np.moveaxis(played["taps"].values, 2, -1), _endings(played, "taps")  # (..., theta)
    names = [str(name) for name in played["model"].values]
    fastest, slowest = _reached(spread_of(played).whole(played["taps"].values))
    points = (
        np.unique(np.asarray(taps, dtype=np.float64))
        if taps is not None
        else _round_times(fastest, slowest, names.index(reference_name(names, reference)))
    )
    errors = {name: np.moveaxis(played[name].values, 2, -1) for name in ERRORS}
    samples = {name: np.moveaxis(_interpolated(points, times, one), -1, 2) for name, one in errors.items()}
    ends = {name: _interpolated(points, late, _endings(played, name)) for name in ERRORS}
    attributes = {name: played[name].attrs for name in ERRORS}
    result = _compared(played, samples, ends, "taps", points, points, reference, attributes)
    common = (fastest.max(axis=0)[:, np.newaxis] <= points) & (points <= slowest.min(axis=0)[:, np.newaxis])
    result["common"] = (("policy", "taps"), common)
    result["taps"].attrs = {"long_name": MEANS["taps"], "units": "taps"}
    return result


def too_few_taps(curves: xr.Dataset, theta: float) -> list[str]:
    """Whether there are too few test taps for what is said of decisions: a sentence, or none.

    Args:
        curves: From `decision_curves`.
        theta: Threshold that is shown; what counts is the model of each policy whose trials use up most taps there.
    """
    shares, how = curves[["used_up", SELECTED]].sel(theta=theta), spread_of(curves)
    most = shares.isel(model=(shares["used_up"] + shares[SELECTED]).argmax("model"))
    used_up, selected = (float(most[name].max()) for name in ("used_up", SELECTED))
    share, limit, form = most[SELECTED], USED_UP_SELECTED, ".1%"
    if used_up > USED_UP:
        share, limit, form = most["used_up"], USED_UP, ".0%"
    of = [
        (f"{float(one):{form}} of the ", f"{one['policy'].item()} decisions of {one['model'].item()}")
        for one in share.sortby(share, ascending=False)
        if one == share.max() or one > limit
    ]
    decisions = " and ".join([of[0][1], *map("".join, of[1:])]) + ", the most of all models,"
    taps = int(curves.attrs["taps_per_class"])
    sentence = too_few(taps, used_up, selected, how.sessions, how.freedom, decisions)
    return [f"At threshold {theta:g}: {sentence}"] if sentence else []


def decision_interval_sentence(curves: xr.Dataset) -> str:
    """What trials and the intervals of `decision_curves` and `at_equal_taps` mean."""
    return (
        f"{curves.attrs['of_sessions']} "
        f"Intervals are {CONFIDENCE:.0%} jackknife intervals: the same trials are replayed for all models, leaving "
        "out a quarter of the test taps of each class, or one test session at a time if there are several. Taps are "
        "fresh: no trial uses a tap twice. A trial that uses up the stored taps of a class decides there; intervals "
        "cover any outcome of further taps. They do not cover variation between training sets."
    ).lstrip()


def _between(grid: ClassGrid) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Errors between all objects, shape (M, M), and all positions, shape (L, L)."""
    L, M = np.arange(grid.L), np.arange(grid.M)
    return grid.what_error(M[:, np.newaxis], M), grid.where_error(L[:, np.newaxis], L)


def _sums(
    between: tuple[NDArray[np.float64], NDArray[np.float64]], trials: Trials, plan: TrialPlan
) -> dict[str, NDArray[np.float64]]:
    """Sums of `MEANS` over trials at every threshold, each of shape (H,), with the errors of `_between`."""
    sums = np.zeros((len(MEANS), trials.taps.shape[1]))
    _add(trials, plan.what, between, sums)
    return dict(zip(MEANS, sums, strict=True))


@compiled
def _add(
    trials: Trials, true: NDArray[np.intp], between: tuple[NDArray[np.float64], NDArray[np.float64]], sums: Any
) -> None:
    """Adds trials up, in the order of `MEANS`, given the errors between classes, (M, M) and (L, L)."""
    what, where = trials.what, trials.where
    for i in range(len(true)):
        for h in range(sums.shape[1]):
            sums[0, h] += between[0][what[i, h], true[i]]
            sums[1, h] += between[1][where[i, h], trials.true_where[i, h]]
            sums[2, h] += trials.taps[i, h]
            sums[3, h] += trials.stopped[i, h]
            sums[4, h] += max(1.0 - trials.belief[i, h], 0.0)
            sums[5, h] += what[i, h] != true[i]
            sums[6, h] += trials.used_up[i, h]
            sums[7, h] += trials.no_class_left[i, h]


def _endings(played: xr.Dataset, name: str) -> NDArray[np.float64]:
    """What the estimates might have been besides, shape (2, model, policy, theta)."""
    return np.array([played[name + suffix].values for suffix in ENDINGS])


def _compared(
    played: xr.Dataset,
    samples: Mapping[str, NDArray[np.float64]],
    ends: Mapping[str, NDArray[np.float64]],
    dim: str,
    points: NDArray[np.float64],
    times: NDArray[np.float64],
    reference: str | None,
    attributes: Mapping[str, dict[str, str]],
) -> xr.Dataset:
    """Quantities of every model with intervals; `times` are mean taps of a decision, broadcast to the quantities."""
    names = [str(name) for name in played["model"].values]
    reference = reference_name(names, reference)
    coords = {name: played[name].values for name in ("model", "policy")}
    result = xr.Dataset(coords={**coords, dim: points}, attrs={**played.attrs, "reference": reference})
    for name, values in samples.items():
        limits = Range(*played.attrs.get(f"range_{name}", Range()))
        result.update(
            with_intervals(
                name,
                values,
                ("model", "policy", dim),
                names.index(reference),
                attributes[name],
                spread_of(played),
                limits=limits[:2],
                independent=played.attrs["test_taps"] / times if name in _SELDOM else None,
                smallest=limits.step,
                endings=list(ends[name]),
                steps=dim == "taps",
            )
        )
    return result


def _reached(times: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Fastest and slowest mean reaction time that nearly every resample reaches.

    Args:
        times: Means on resamples, shape (model, policy, theta, R).

    Returns:
        Each of shape (model, policy); where the fastest is the slower there is no such time.
    """
    tail = (1 - CONFIDENCE) / 2
    fastest, slowest = np.nanmin(times, axis=2), np.nanmax(times, axis=2)
    return np.quantile(fastest, 1 - tail, axis=-1), np.quantile(slowest, tail, axis=-1)


def _round_times(fastest: NDArray[np.float64], slowest: NDArray[np.float64], base: int) -> NDArray[np.float64]:
    """Round times that the base model and another, if there is one, both reach; the middle where none is round."""
    if len(fastest) > 1:
        others = np.arange(len(fastest)) != base
        fastest = np.maximum(fastest[others], fastest[base])
        slowest = np.minimum(slowest[others], slowest[base])
    shared = fastest <= slowest
    if not shared.any():
        return np.empty(0)
    decades = 10.0 ** np.arange(np.ceil(np.log10(slowest.max() + 1)))
    candidates = np.outer(decades, _ROUND).ravel()[:, np.newaxis]
    points = candidates[((fastest[shared] <= candidates) & (candidates <= slowest[shared])).any(axis=1), 0]
    return points if len(points) else np.array([(fastest[shared][0] + slowest[shared][0]) / 2])


def _interpolated(
    points: NDArray[np.float64], times: NDArray[np.float64], errors: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Errors at these times by curves (..., theta); shape (..., points)."""
    result = np.full((*times.shape[:-1], len(points)), np.nan)
    for index in np.ndindex(times.shape[:-1]):
        # A trial decides later at a higher threshold, so times increase, and where they do not all decisions agree.
        played = ~np.isnan(times[index])
        result[index] = np.interp(points, times[index][played], errors[index][played], left=np.nan, right=np.nan)
    return result
