"""Errors, reaction times and their intervals.

Outcomes are xarray datasets with the dims ``place`` (sensing position or start of a trial, or fixation point) and
``theta``; several data sets add the dim ``data_set`` in front. Position errors are those between classes, at the
place where the sensor stood when it decided, in the unit of the positions.
"""

import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array
from scipy.special import stdtrit

from ...inference.trials.records import ENDINGS, TrialPlan, Trials
from ...inference.trials.resampling import CONFIDENCE, Spread, resamples_in_words, share_beyond, widened
from ...models.grid import ClassGrid

QUANTITIES = ("what_error", "where_error", "taps")
FRACTIONS = ("stopped_fraction", "clamped_fraction", "substituted_fraction", "what_wrong", "no_class_left_fraction")
NO_SPREAD = Spread(1.0)


class Means(NamedTuple):
    """Mean outcomes of trials.

    Attributes:
        trials: Number of trials at each place, shape (places,).
        mean: By the name of the quantity, shape (places, H); NaN at places without a trial.
        noise: Variance of the means of `QUANTITIES` by the sampling of trials on the same taps, likewise.
    """

    trials: NDArray[np.float64]
    mean: dict[str, NDArray[np.float64]]
    noise: dict[str, NDArray[np.float64]]


class OutcomeSums(NamedTuple):
    """Sums of outcomes over trials of the same place and start, of which those of blocks of trials can be joined.

    Starts are planned in equal numbers, so only what varies between trials of one start is noise.

    Attributes:
        stratum: place L + start, shape (S,).
        trials: Number of trials, shape (S,).
        total: Sums by the name of the quantity, shape (S, H).
        square: Sums of squared deviations from the mean of the stratum, of `QUANTITIES`, likewise.
    """

    stratum: NDArray[np.intp]
    trials: NDArray[np.float64]
    total: dict[str, NDArray[np.float64]]
    square: dict[str, NDArray[np.float64]]

    def joined(self) -> Self:
        """One row for each stratum, in increasing order."""
        stratum, key = np.unique(self.stratum, return_inverse=True)
        of = _sums(key, len(stratum))
        count = of @ self.trials
        total = {name: of @ value for name, value in self.total.items()}
        square = {}
        for name, within in self.square.items():
            mean = total[name] / count[:, np.newaxis]
            own = self.trials[:, np.newaxis]
            square[name] = of @ (within + own * (self.total[name] / own - mean[key]) ** 2)
        return self._replace(stratum=stratum, trials=count, total=total, square=square)

    def means(self, L: int) -> Means:
        """Means of joined sums at each of L places."""
        places = _sums(self.stratum // L, L)
        trials = places @ self.trials
        count = self.trials[:, np.newaxis]
        with np.errstate(invalid="ignore"):
            mean = {name: (places @ total) / trials[:, np.newaxis] for name, total in self.total.items()}
        noise = {
            name: (places @ (square / np.maximum(count - 1, 1) * count)) / np.maximum(trials, 1)[:, np.newaxis] ** 2
            for name, square in self.square.items()
        }
        return Means(trials, mean, noise)


def join_sums(parts: Sequence[OutcomeSums]) -> OutcomeSums:
    """Sums over several blocks of trials."""
    if len(parts) == 1:
        return parts[0]
    total, square = (
        {name: np.concatenate([getattr(part, of)[name] for part in parts]) for name in getattr(parts[0], of)}
        for of in ("total", "square")
    )
    stratum, count = (np.concatenate([getattr(part, of) for part in parts]) for of in ("stratum", "trials"))
    return OutcomeSums(stratum, count, total, square).joined()


def sum_outcomes(
    trials: Trials, plan: TrialPlan, place: ArrayLike, grid: ClassGrid, minus: Trials | None = None
) -> OutcomeSums:
    """Sums of outcomes at each place, start and threshold.

    Args:
        trials: n decided trials at H thresholds.
        plan: The same trials as planned.
        place: Class of positions that each trial belongs to, shape (n,).
        grid: The classes.
        minus: Other trials of the same plan, whose outcomes are subtracted trial by trial.
    """
    place = np.asarray(place, dtype=np.intp)
    values = _values(trials, plan, grid)
    if minus is not None:
        subtracted = _values(minus, plan, grid)
        values = {name: value - subtracted[name] for name, value in values.items()}
    nothing = {name: np.zeros_like(values[name]) for name in QUANTITIES}
    return OutcomeSums(place * grid.L + plan.where, np.ones(len(place)), values, nothing).joined()


def outcomes_dataset(
    means: Means,
    resampled: Sequence[Means],
    grid: ClassGrid,
    thresholds: ArrayLike,
    deadline: int,
    endings: Sequence[Means] = (),
) -> xr.Dataset:
    """Mean outcomes with labels.

    Args:
        means: The means.
        resampled: The same on resamples of the test taps.
        grid: The classes.
        thresholds: theta_W, shape (H,).
        deadline: Taps after which a trial ends.
        endings: Means of trials that were cut short at their best, and at their worst, see
        `inference.trials.records`.

    Returns:
        Dims (place, theta): `Means.mean` by name, `Means.noise` as ``<quantity>_noise``, endings with the suffixes of
        `inference.trials.records.ENDINGS`, and the number of ``trials`` (place). With resamples also
        ``<quantity>_resampled`` (resample, place, theta), the mean of their noise as ``<quantity>_resampled_noise``,
        and the mean number of their trials as ``resampled_trials`` (place).
    """
    cells = ["place", "theta"]
    columns: dict[str, Any]
    columns = {"trials": ("place", means.trials)} | {name: (cells, value) for name, value in means.mean.items()}
    if resampled:
        columns["resampled_trials"] = ("place", np.mean([part.trials for part in resampled], axis=0))
    for name, noise in means.noise.items():
        columns[f"{name}_noise"] = (cells, noise)
        for suffix, ending in zip(ENDINGS, endings, strict=bool(endings)):
            columns[name + suffix] = (cells, ending.mean[name])
        if resampled:
            columns[f"{name}_resampled"] = (["resample", *cells], np.stack([part.mean[name] for part in resampled]))
            columns[f"{name}_resampled_noise"] = (cells, np.mean([part.noise[name] for part in resampled], axis=0))
    return xr.Dataset(
        columns,
        {
            "place": ("place", grid.where_value, {"units": grid.axis_unit}),
            "theta": ("theta", np.asarray(thresholds, dtype=np.float64)),
        },
        {
            "what_unit": grid.what_error_unit,
            "where_unit": grid.where_unit,
            **{f"range_{name}": one for name, one in ranges(grid, deadline).items()},
        },
    )


def by_place(
    data_sets: xr.Dataset,
    spread: Spread = NO_SPREAD,
    *,
    difference: bool = False,
    parts: int | None = None,
    slowest: xr.DataArray | None = None,
) -> xr.Dataset:
    """Mean and interval at each place and threshold; dims (place, theta).

    Args:
        data_sets: Outcomes with the dim ``data_set``.
        spread: How resamples of a single data set turn into intervals; several data sets have t-intervals, enlarged by
            its factor.
        difference: Whether outcomes are differences, which can be below what an outcome can.
        parts: Into how many the test taps are parted by place; `None` for the number of places.
        slowest: Mean reaction times that say how many decisions the test taps allow; `None` for those of the outcomes.
    """
    parts = data_sets.sizes.get("place", 1) if parts is None else parts
    sets = data_sets.sizes["data_set"]
    result = data_sets[[*QUANTITIES, *FRACTIONS]].mean("data_set", keep_attrs=True)
    times = result["taps"] if slowest is None else slowest
    trials = data_sets["trials"].mean("data_set").broadcast_like(times)
    with np.errstate(divide="ignore", invalid="ignore"):  # differences of reaction times may be 0
        independent = sets * np.minimum(spread.taps / parts / times.values, trials.transpose(*times.dims).values)
    for name in QUANTITIES:
        own = Range(*data_sets.attrs[f"range_{name}"])
        least, most = (-np.inf, np.inf) if difference else own[:2]
        might_be = [
            data_sets[name + suffix].mean("data_set").values for suffix in ENDINGS if name + suffix in data_sets
        ]
        value = result[name].values
        smallest, largest = np.minimum.reduce([value, *might_be]), np.maximum.reduce([value, *might_be])
        if sets > 1:
            half, center = spread.factor * _half_width(data_sets[name]).values, value
            low, high = (smallest - half).clip(least, most), (largest + half).clip(least, most)
        else:
            samples = _samples(data_sets.isel(data_set=0), name, spread)
            (low, high), center = spread.interval(samples, least, most, might_be), spread.center(samples)
        if difference:
            # Where every decision takes one tap they are the same by design.
            beyond = np.where(times > 1, own.step * share_beyond(independent), 0.0)
            low, high = np.where(low == smallest, low - beyond, low), np.where(high == largest, high + beyond, high)
        else:
            low, high = widened(low, high, value, center, independent, own.step, most, least=least)
        result[f"{name}_low"], result[f"{name}_high"] = (result[name].copy(data=end) for end in (low, high))
    return result


def over_places(
    data_sets: xr.Dataset, spread: Spread = NO_SPREAD, *, difference: bool = False, slowest: xr.DataArray | None = None
) -> xr.Dataset:
    """Mean and interval at each threshold of the mean over all places; arguments as `by_place`, dim theta."""
    mean = data_sets.mean("place", skipna=True, keep_attrs=True)
    share = (data_sets["trials"] > 0).sum("place")
    mean["trials"] = data_sets["trials"].sum("place")
    if "resampled_trials" in data_sets:
        mean["resampled_trials"] = data_sets["resampled_trials"].sum("place")
    for name in data_sets.data_vars:
        if str(name).endswith("_noise"):  # places are averaged with equal weight, so their variances add up to this
            mean[name] = data_sets[name].sum("place") / share**2
    return by_place(mean, spread, difference=difference, slowest=slowest)


def confusion(true: ArrayLike, decided: ArrayLike, M: int) -> NDArray[np.int64]:
    """How often each object (row) was taken for each (column), shape (M, M).

    Args:
        true: What class of every trial, shape (n,).
        decided: Decided what class, shape (n,).
        M: Number of what classes.
    """
    return np.bincount(np.asarray(true) * M + np.asarray(decided), minlength=M * M).reshape(M, M)


def join(parts: Sequence[xr.Dataset], names: Sequence[str]) -> xr.Dataset:
    """Outcomes of several data sets along the dim ``data_set``."""
    return xr.concat(parts, dim=xr.DataArray(list(names), dims="data_set", name="data_set"))


def interval_sentence(data_sets: int, kind: str, spread: Spread = NO_SPREAD) -> str:
    """Sentence that explains the intervals.

    Args:
        data_sets: How many data sets were averaged.
        kind: What one of them is called: "simulated data sets" or "folds".
        spread: How resamples of a single one turn into intervals.
    """
    if data_sets > 1:
        shared = ", and allow for folds that share training sessions" if kind == "folds" else ""
        return (
            f"Intervals are {CONFIDENCE:.0%} t-intervals of the mean over {data_sets} {kind}; they cover the "
            f"variation between data sets and between trials{shared}."
        )
    if np.isnan(spread.factor):
        return spread.few
    if spread.sessions > 1:
        return (
            f"Intervals are {CONFIDENCE:.0%} jackknife intervals from trials on the test taps "
            f"{resamples_in_words(spread.sessions)}; they cover other test sessions, for the same model."
        )
    return (
        f"Intervals are {CONFIDENCE:.0%} intervals from trials on test taps {resamples_in_words(1, thinned=False)}, "
        f"or, for fresh taps and accuracies, {resamples_in_words(1)}; they cover other test taps of the same session, "
        "for the same model, but not other sessions."
    )


def _half_width(values: xr.DataArray) -> xr.DataArray:
    """Half the t-interval over data sets; a place may lack trials in some of them."""
    seen = values.count("data_set")
    with warnings.catch_warnings(action="ignore", category=RuntimeWarning):  # of NumPy before 2.5, about single ones
        spread = values.std("data_set", ddof=1)
    return spread * stdtrit(seen - 1, 0.5 + CONFIDENCE / 2) / np.sqrt(seen)


def _samples(data: xr.Dataset, name: str, spread: Spread) -> NDArray[np.float64]:
    """The estimate and, behind it, resamples that vary by their taps and by as many trials as the estimate's.

    Resamples have fewer trials than the estimate, so their variance is reduced by the excess of sampling noise.
    """
    estimate = data[name].values[..., np.newaxis]
    if f"{name}_resampled" not in data:
        return np.concatenate([estimate, np.full_like(estimate, np.nan)], axis=-1)
    drawn = np.moveaxis(data[f"{name}_resampled"].values, 0, -1)
    own, present = data[f"{name}_noise"], data[f"{name}_resampled_noise"]
    share = (data["resampled_trials"] / data["trials"]).broadcast_like(own).transpose(*own.dims)
    drawn = with_noise(drawn, own.values, present.values, share.values, spread.factor)
    return np.concatenate([estimate, drawn], axis=-1)


def with_noise(
    drawn: NDArray[np.float64],
    own: NDArray[np.float64],
    present: NDArray[np.float64],
    share: float | NDArray[np.float64],
    factor: float,
) -> NDArray[np.float64]:
    """Resamples moved closer to their mean, or further from it, to vary by as many trials as the estimate has.

    Args:
        drawn: Means on R resamples, shape (..., R).
        own: Variance of the estimate by the sampling of its trials, shape (...). Where its trials had the same outcome
            it is unknown, not 0: that of the resamples counts.
        present: That of a resample, likewise.
        share: Trials of a resample divided by those of the estimate, broadcast to (...).
        factor: By which deviations will be enlarged, see `Spread`.
    """
    known = np.isfinite(drawn)
    number = known.sum(axis=-1, keepdims=True)
    mean = np.where(known, drawn, 0).sum(axis=-1, keepdims=True) / np.maximum(number, 1)
    variance = (np.where(known, drawn - mean, 0) ** 2).sum(axis=-1) / np.maximum(number[..., 0] - 1, 1)
    wanted = np.where(own > 0, own, share * present) / factor**2
    with np.errstate(invalid="ignore", divide="ignore"):
        scale = np.sqrt((np.maximum(variance - present, 0) + wanted) / variance)
    return mean + np.where(variance > 0, scale, 1.0)[..., np.newaxis] * (drawn - mean)


def _values(trials: Trials, plan: TrialPlan, grid: ClassGrid) -> dict[str, NDArray[np.float64]]:
    """Outcomes of single trials, each of shape (n, H)."""
    what = plan.what[:, np.newaxis]
    return {
        "what_error": grid.what_error(trials.what, what),
        "where_error": grid.where_error(trials.where, trials.true_where),
        "taps": trials.taps.astype(np.float64),
        "stopped_fraction": trials.stopped.astype(np.float64),
        "clamped_fraction": (trials.clamped > 0).astype(np.float64),
        "substituted_fraction": (trials.substituted > 0).astype(np.float64),
        "what_wrong": (trials.what != what).astype(np.float64),
        "no_class_left_fraction": trials.no_class_left.astype(np.float64),
    }


def _sums(group: NDArray[np.intp], groups: int) -> csr_array:
    """The matrix that adds up rows by their group."""
    n = len(group)
    return csr_array((np.ones(n), (group, np.arange(n))), shape=(groups, n))


class Range(NamedTuple):
    """Of a mean over decisions.

    Attributes:
        least: What it cannot be below.
        most: Nor above; infinite where the two would be the same.
        step: By how much a single decision that is not at the least value exceeds it; 0 where none can.
    """

    least: float = 0.0
    most: float = np.inf
    step: float = 1.0


SHARE = Range(0.0, 1.0)


def of_taps(deadline: int) -> Range:
    """Of reaction times with a deadline."""
    return Range(1.0, float(deadline) if deadline > 1 else np.inf)


def ranges(grid: ClassGrid, deadline: int) -> dict[str, Range]:
    """Of errors and reaction times, by name.

    Args:
        grid: The classes.
        deadline: Taps after which a trial ends at the latest.
    """
    found = {"taps": of_taps(deadline)}
    for name, error, n in (("where_error", grid.where_error, grid.L), ("what_error", grid.what_error, grid.M)):
        errors = error(*np.triu_indices(n, 1))
        above = errors[errors > 0]
        found[name] = Range(0.0, float(above.max()), float(above.min())) if len(above) else Range(step=0.0)
    return found
