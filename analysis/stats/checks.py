"""Posterior predictive checks: statistics of training taps and of replicates drawn from each model.

Every statistic belongs to an assumption that some models of the catalogue give up. It is taken of the training taps and
of replicates, taps of the same classes drawn from the fitted model with parameters from its posterior; a model that
lacks what the statistic measures shows it by replicates that all lie to one side (Gelman et al., "Bayesian Data
Analysis", 3rd ed., sec. 6.3). Samples are rounded to their bins on both sides, as the histogram has no finer values.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import NamedTuple, Self

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...models import seeds
from ...models.grid import ClassGrid
from ...models.measurement.draws import replicated_bins
from ...models.measurement.fits.portable import PortableFit
from ...models.measurement.histogram import HistogramModel
from ...models.measurement.likelihood.bins import find_bins
from ...models.measurement.likelihood.shapes import Parameters
from ...models.measurement.model import Fitted, TapModel
from ...models.progress import ShownHere, silent
from ...models.taps import TapSet
from ...models.threads import cores, in_order
from ..tasks.crew import ONE_BY_ONE, Crew
from . import check_loops as loops
from .evidence import halves, rivals

REPLICATES = 20
_AT_ONCE = 1 << 24  # samples of which several replicates are held at a time
_DEAD = 1e-9  # of the largest deviation: what is below is rounding
_RANKED = 10  # times of a tap at which ranks are taken, at most
_LEAST_FREEDOM = 3
_PSEUDOCOUNT = 0.01  # of the tables that judge taps


class TapLabels(NamedTuple):
    """What is known of N taps beside their samples, the same for all replicates.

    Taps of a class stand together, in it those of a session, and in it those of a half (see `evidence.halves`).

    Attributes:
        taps: The taps in this order.
        grid: The classes, all taps belong to one.
        where: Where class of each tap, shape (N,).
        what: Likewise.
        half: Shape (N,).
        classes: First tap of each class that has one, and N, shape (C + 1,).
        sessions: First tap of each session of a class, shape (S,).
        parts: First tap of each half of a session of a class.
    """

    taps: TapSet
    grid: ClassGrid
    where: NDArray[np.intp]
    what: NDArray[np.intp]
    half: NDArray[np.intp]
    classes: NDArray[np.intp]
    sessions: NDArray[np.intp]
    parts: NDArray[np.intp]

    @classmethod
    def of(cls, taps: TapSet, grid: ClassGrid) -> Self:
        """Those of taps that all belong to a class, sorted."""
        where, what = taps.indices(grid)
        half = halves(taps, grid)
        keys = where * grid.M + what, taps.session, half
        order = np.lexsort(keys[::-1])
        changes = [np.append(True, np.diff(key[order]) != 0) for key in keys]
        classes, sessions, parts = (np.flatnonzero(starts) for starts in np.logical_or.accumulate(changes))
        return cls(
            taps.select(order),
            grid,
            where[order],
            what[order],
            half[order],
            np.append(classes, len(taps)),
            sessions,
            parts,
        )

    def each(self) -> Iterator[slice]:
        """The taps of one class after the other."""
        return map(slice, self.classes[:-1].tolist(), self.classes[1:].tolist())


class BinnedTaps(NamedTuple):
    """Taps in their bins, and what is left of them without the mean tap of their class.

    Attributes:
        labels: Of the taps.
        cell: Bin b of each sample of taxel k as k B + b, shape (N, J K).
        edges: Of the bins, shape (K, B + 1).
        mean: Mean tap of each class, shape (C, J, K).
        residual: Shape (N, J, K).
        square: Sum of its squares over the taps of each class, shape (C, J, K).
    """

    labels: TapLabels
    cell: NDArray[np.uint32]
    edges: NDArray[np.float64]
    mean: NDArray[np.float64]
    residual: NDArray[np.float64]
    square: NDArray[np.float64]

    @classmethod
    def of(cls, labels: TapLabels, bins: NDArray[np.integer], edges: NDArray[np.float64]) -> Self:
        """Those of taps in the order of the labels, by the bins of their samples, shape (N, J, K), which may change."""
        (N, J, K), B, C = bins.shape, edges.shape[-1] - 1, len(labels.classes) - 1
        edges = np.broadcast_to(edges, (K, B + 1))
        centre = (0.5 * (edges[:, :-1] + edges[:, 1:])).ravel()
        cell = bins.astype(np.uint32, copy=False)
        cell += (np.arange(K) * B).astype(np.uint32)
        cell = cell.reshape(N, J * K)
        mean, square = np.empty((2, C, J, K))
        residual = np.empty(bins.shape)
        rows = (each.reshape(len(each), -1) for each in (mean, residual, square))
        loops.leave_means(cell, centre, labels.classes, *rows)
        return cls(labels, cell, edges, mean, residual, square)

    @property
    def rows(self) -> NDArray[np.float64]:
        """Residuals with each tap as a row, shape (N, J K)."""
        return self.residual.reshape(len(self.residual), -1)

    @property
    def variance(self) -> NDArray[np.float64]:
        """Mean square of the residuals of each taxel, shape (K,); 0 where there is rounding only."""
        square = self.square.sum(axis=(0, 1)) / max(self.residual[..., 0].size, 1)
        return np.where(square > (_DEAD * np.ptp(self.edges)) ** 2, square, 0.0)


class Statistic(NamedTuple):
    """What a check looks at.

    Attributes:
        label: For print.
        assumption: Which it tests.
        of: Its value, NaN where the taps do not show it.
        needs: Least samples, taxels, taps per class, positions per class, sessions, and taps per class and session.
    """

    label: str
    assumption: str
    of: Callable[[BinnedTaps], float]
    needs: tuple[int, int, int, int, int, int]


def _profile_share(cells: BinnedTaps) -> float:
    """Share of the variance between times of a class in its whole variance."""
    between = cells.mean.var(axis=1).mean()
    return float(between / max(between + cells.variance.mean(), 1e-300))


def _lag_one(cells: BinnedTaps) -> float:
    """Autocorrelation of neighbouring samples' residuals."""
    product, former, latter = loops.neighbours(cells.rows, len(cells.edges))
    return _ratio(product, np.sqrt(former * latter))


def _taxel_correlation(cells: BinnedTaps) -> float:
    """Mean absolute correlation of the residuals of two taxels at the same time."""
    live = cells.variance > 0
    flat = cells.residual.reshape(-1, len(live))
    return _mean_absolute((flat.T @ flat)[np.ix_(live, live)] / len(flat), cells.variance[live])


def _rank_correlation(cells: BinnedTaps) -> float:
    """Mean absolute rank correlation of two taxels at the same time, within classes and sessions."""
    (N, J, K), first = cells.residual.shape, np.append(cells.labels.sessions, len(cells.cell))
    times = np.unique(np.linspace(0, J - 1, min(J, _RANKED)).round().astype(np.intp))
    places = (times[:, None] * K + np.arange(K)).ravel()
    units, varies = np.empty((N, len(places))), np.empty((len(first) - 1, len(places)))
    loops.ranks(cells.cell, places, first, np.zeros(K * (cells.edges.shape[1] - 1), dtype=np.int64), units, varies)
    units, weighted = units.reshape(-1, K), varies * np.diff(first)[:, None]
    weight = weighted.reshape(-1, K).T @ varies.reshape(-1, K)
    return _mean_absolute(units.T @ units / np.maximum(weight, 1.0), np.ones(K), weight > 0)


def _strength(cells: BinnedTaps) -> float:
    """Share of the variance within classes that goes with how strong whole taps are, along the mean tap."""
    mean = (cells.mean - cells.mean.mean(axis=(0, 1))).reshape(len(cells.mean), -1)
    power = (mean**2).sum(axis=1)
    explained = 0.0
    for c, own in enumerate(cells.labels.each()):
        if power[c] > 0:
            product = cells.residual[own].reshape(-1, mean.shape[1]) @ mean[c]
            explained += float(product @ product) / power[c]
    return _ratio(explained, float(cells.square.sum()))


def _design_effect(cells: BinnedTaps) -> float:
    """Variance of the evidence of taps over that of independent samples, the median over classes.

    Evidence is the log-likelihood ratio to the most similar class by histograms of the other half of the taps.
    """
    labels, (K, B) = cells.labels, (len(cells.edges), cells.edges.shape[1] - 1)
    at = labels.where[labels.classes[:-1]], labels.what[labels.classes[:-1]]
    found = np.zeros((2, len(at[0]), K * B), dtype=np.int64)
    loops.count_halves(cells.cell, labels.classes, labels.half, found)
    counts = np.zeros((2, *labels.grid.shape, K * B), dtype=np.int64)
    counts[:, *at] = found
    trained = (counts.sum(axis=-1) > 0).all(axis=0)
    if trained.sum() < 2:
        return np.nan
    ratios = [_log_ratios(labels, counts[1 - h].reshape(*labels.grid.shape, K, B), cells, trained) for h in (0, 1)]
    effects = []
    for own, l, m in zip(labels.each(), *at, strict=True):
        parts = labels.parts[(labels.parts >= own.start) & (labels.parts < own.stop)]
        table = np.stack([ratio[l * labels.grid.M + m] for ratio in ratios])
        if own.stop - own.start - len(parts) < _LEAST_FREEDOM or np.isnan(table).any():
            continue
        effects.append(_ratio(*loops.spread_of_sums(cells.cell, table, labels.half, np.append(parts, own.stop))))
    return float(np.nanmedian(effects)) if np.isfinite(effects).any() else np.nan


def _log_ratios(
    labels: TapLabels, counts: NDArray[np.int64], cells: BinnedTaps, trained: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Log ratios of each class's table to that of its rival, shape (L M, K B); NaN without a rival."""
    model = HistogramModel(labels.grid, cells.edges, "none", labels.taps.preprocessing, counts, _PSEUDOCOUNT)
    rival = rivals(model, trained)
    table = model.log_prob.reshape(len(rival), -1)
    return np.where((rival >= 0)[:, None], table - table[rival], np.nan)


def _tails(cells: BinnedTaps) -> float:
    """Share of residuals beyond three standard deviations of their class and taxel."""
    (C, J, K), count = cells.square.shape, np.diff(cells.labels.classes)
    deviation = np.sqrt(cells.square.sum(axis=1) / (count * J)[:, None])
    live = deviation > _DEAD * np.ptp(cells.edges)
    limit = np.repeat(np.where(live, 3 * deviation, np.inf)[:, None], J, axis=1).reshape(C, J * K)
    beyond = loops.count_beyond(cells.rows, cells.labels.classes, limit)
    return _ratio(beyond, float((live.sum(axis=1) * count * J).sum()))


def _slope_over_place(cells: BinnedTaps) -> float:
    """Share of the variance within classes that goes with the position within the class."""
    explained, where = 0.0, cells.labels.taps.where
    for own in cells.labels.each():
        place = where[own] - where[own].mean()
        square = float(place @ place)
        if square > 0:
            product = place @ cells.residual[own].reshape(len(place), -1)
            explained += float(product @ product) / square
    return _ratio(explained, float(cells.square.sum()))


def _between_sessions(cells: BinnedTaps) -> float:
    """Share of the variance within classes that is between sessions."""
    first = np.append(cells.labels.sessions, len(cells.residual))
    return _ratio(loops.between(cells.rows, first), float(cells.square.sum()))


STATISTICS: dict[str, Statistic] = {
    "profile": Statistic("variance between times", "exchangeable samples", _profile_share, (2, 1, 1, 1, 1, 1)),
    "lag": Statistic("correlation of neighbouring samples", "independence in time", _lag_one, (2, 1, 2, 1, 1, 1)),
    "taxels": Statistic("correlation of taxels", "independence of taxels", _taxel_correlation, (1, 2, 2, 1, 1, 1)),
    "ranks": Statistic("rank correlation of taxels", "independence of taxels", _rank_correlation, (1, 2, 3, 1, 1, 3)),
    "gain": Statistic("variance with tap strength", "independence within a tap", _strength, (2, 1, 2, 1, 1, 1)),
    "design": Statistic("design effect of evidence", "independence within a tap", _design_effect, (1, 1, 4, 1, 1, 2)),
    "tails": Statistic("residuals beyond 3 SD", "shape of the distribution", _tails, (1, 1, 2, 1, 1, 1)),
    "place": Statistic("variance with position in class", "one mean per class", _slope_over_place, (1, 1, 3, 2, 1, 1)),
    "sessions": Statistic("variance between sessions", "independence of taps", _between_sessions, (1, 1, 2, 1, 2, 2)),
}
"""Checks by name."""


def predictive_checks(
    models: Mapping[str, Fitted],
    taps: TapSet,
    seed: int,
    replicates: int = REPLICATES,
    progress: Callable[[int], object] = silent,
    crew: Crew = ONE_BY_ONE,
) -> xr.Dataset:
    """Statistics of training taps and of replicates from every model.

    Args:
        models: By name.
        taps: The taps.
        seed: Random seed.
        replicates: How many, of each model.
        progress: Called with 1 after each of them.
        crew: What does the work, a model at a time.

    Returns:
        `observed` (statistic), `replicated` (model, statistic, replicate), and `p` (model, statistic), the share of
        replicates at or above what was observed, from 0 to 1.
    """
    first = next(iter(models.values())).model
    labels = TapLabels.of(taps, first.grid)
    observed = observed_statistics(labels, first.edges)
    shared = _Checked(labels, list(observed), replicates, seed, ShownHere(progress))
    result = np.array(list(crew(_replicated, enumerate(map(PortableFit, models.values())), shared)))
    values, chosen = np.array(list(observed.values())), [STATISTICS[name] for name in observed]
    above = (result >= values[:, None]).mean(axis=-1)
    return xr.Dataset(
        {
            "observed": ("statistic", values),
            "replicated": (("model", "statistic", "replicate"), result),
            "p": (("model", "statistic"), np.where(np.isnan(result).all(axis=-1), np.nan, above)),
            "label": ("statistic", np.array([s.label for s in chosen], dtype=np.str_)),
            "assumption": ("statistic", np.array([s.assumption for s in chosen], dtype=np.str_)),
        },
        {"model": np.array(list(models), dtype=np.str_), "statistic": np.array(list(observed), dtype=np.str_)},
    )


def _taken(names: Iterable[str], of: BinnedTaps) -> list[float]:
    """Statistics of taps, drawn in one thread while those before are looked at in others."""
    return [STATISTICS[name].of(of) for name in names]


class _Checked(NamedTuple):
    """The taps of a check, the names of its statistics, and how they are replicated."""

    labels: TapLabels
    names: list[str]
    replicates: int
    seed: int
    progress: ShownHere


def _replicated(item: tuple[int, PortableFit], checked: _Checked) -> NDArray[np.float64]:
    """Statistics of replicates of a model by its number, shape (statistic, replicate); NaN without a posterior."""
    (number, made), (labels, names, replicates, seed, progress) = item, checked
    result = np.full((len(names), replicates), np.nan)
    fitted = made.fitted
    if fitted.posterior is None:
        return result
    generator = seeds.generator(seed, seeds.Purpose.CHECKS, number)
    replicated = (
        replicate(fitted.posterior.draw(generator), fitted.model, labels, generator) for _ in range(replicates)
    )
    at_once = max(1, min(cores(None), _AT_ONCE // max(labels.taps.samples.size, 1)))
    for r, found in enumerate(in_order((partial(_taken, names, of) for of in replicated), at_once)):
        result[:, r] = found
        progress(1)
    return result


def observed_statistics(labels: TapLabels, edges: NDArray[np.float64]) -> dict[str, float]:
    """The statistics that taps show, by name.

    Args:
        labels: With the taps.
        edges: Of the bins, shape (B + 1,) or (K, B + 1).
    """
    cells = BinnedTaps.of(labels, find_bins(labels.taps.taps, edges), edges)
    values = {name: statistic.of(cells) for name, statistic in STATISTICS.items() if _can(statistic, labels)}
    return {name: value for name, value in values.items() if np.isfinite(value)}


def replicate(parameters: Parameters, model: TapModel, labels: TapLabels, generator: np.random.Generator) -> BinnedTaps:
    """Taps of the same classes and, where the model knows places within a class, at the same places."""
    return BinnedTaps.of(labels, replicated_bins(parameters, model, labels.taps, generator), model.edges)


def _can(statistic: Statistic, labels: TapLabels) -> bool:
    """Whether taps show a statistic at all."""
    N, C, S = len(labels.where), len(labels.classes) - 1, len(labels.sessions)
    places = np.mean([len(np.unique(labels.taps.where[own])) for own in labels.each()])
    has = (*labels.taps.tap_shape, N / C, places, len(np.unique(labels.taps.session)), N / S)
    return all(value >= least for value, least in zip(has, statistic.needs, strict=True))


def _mean_absolute(
    covariance: NDArray[np.float64], variance: NDArray[np.float64], known: NDArray[np.bool_] | None = None
) -> float:
    """Mean absolute correlation of all known pairs, NaN without any."""
    below = np.tril(np.ones(covariance.shape, dtype=bool), -1)
    below = below if known is None else below & known
    correlation = covariance / np.sqrt(np.outer(variance, variance))
    return float(np.abs(correlation[below]).mean()) if below.any() else np.nan


def _ratio(part: float, whole: float) -> float:
    return float(part / whole) if whole > 0 else np.nan
