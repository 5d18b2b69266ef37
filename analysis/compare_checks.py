"""Posterior predictive checks: what training taps show and what each model would have made of them.

Every statistic belongs to an assumption that some models of the catalogue give up. It is taken of the training taps and
of replicates, taps of the same classes drawn from the fitted model with parameters from its posterior; a model that
lacks what the statistic measures shows it by replicates that all lie to one side (Gelman et al., "Bayesian Data
Analysis", 3rd ed., sec. 6.3).
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..models.bins import find_bins
from ..models.catalogue import Fitted
from ..models.forms import TableForm, in_states
from ..models.model import TapModel
from ..models.model_draws import form_of
from ..models.scaling import sum_by
from ..models.shapes import Parameters
from ..models.taps import TapSet

REPLICATES = 20


class _Cells(NamedTuple):
    """Taps, their classes, and what is left of them without the mean tap of their class.

    Attributes:
        mean: Mean tap of each class that has one, shape (C, J, K).
        residual: Shape (N, J, K).
        own: Row of each tap's class in `mean`, shape (N,).
        place: Position of each tap within its class, centred, shape (N,).
        session: Of each tap, shape (N,).
    """

    mean: NDArray[np.float64]
    residual: NDArray[np.float64]
    own: NDArray[np.intp]
    place: NDArray[np.float64]
    session: NDArray[np.int64]


class Statistic(NamedTuple):
    """What a check looks at.

    Attributes:
        label: For print.
        assumption: Which it tests.
        of: Its value.
        needs: Least samples, taxels, taps per class, positions per class and sessions.
    """

    label: str
    assumption: str
    of: Callable[[_Cells], float]
    needs: tuple[int, int, int, int, int]


def _profile_share(cells: _Cells) -> float:
    """Share of the variance between times of a class in its whole variance."""
    between = cells.mean.var(axis=1).mean()
    return float(between / max(between + (cells.residual**2).mean(), 1e-300))


def _lag_one(cells: _Cells) -> float:
    """Autocorrelation of neighbouring samples' residuals."""
    r = cells.residual
    return _ratio((r[:, 1:] * r[:, :-1]).mean(), np.sqrt((r[:, 1:] ** 2).mean() * (r[:, :-1] ** 2).mean()))


def _taxel_correlation(cells: _Cells) -> float:
    """Mean absolute correlation of the residuals of two taxels at the same time."""
    flat = cells.residual.reshape(-1, cells.residual.shape[2])
    flat = flat[:, flat.std(axis=0) > 0]
    if flat.shape[1] < 2:
        return np.nan
    correlation = np.atleast_2d(np.corrcoef(flat.T))
    below = np.tril(np.ones(correlation.shape, dtype=bool), -1)
    return float(np.abs(correlation[below]).mean())


def _tap_gain(cells: _Cells) -> float:
    """Standard deviation of how much stronger whole taps are than the mean of their class."""
    mean = cells.mean - cells.mean.mean(axis=(0, 1))
    power = (mean**2).sum(axis=(1, 2))
    gain = (cells.residual * mean[cells.own]).sum(axis=(1, 2)) / np.maximum(power, 1e-300)[cells.own]
    return float(gain[power[cells.own] > 0].std()) if (power > 0).any() else np.nan


def _tails(cells: _Cells) -> float:
    """Share of residuals beyond three standard deviations of their class and taxel."""
    square = sum_by(cells.own, cells.residual**2, len(cells.mean)).mean(axis=1)
    count = np.bincount(cells.own, minlength=len(cells.mean))[:, None]
    deviation = np.sqrt(square / count)[cells.own][:, None]
    return float((np.abs(cells.residual) > 3 * deviation)[np.broadcast_to(deviation > 0, cells.residual.shape)].mean())


def _slope_over_place(cells: _Cells) -> float:
    """Share of the variance within classes that goes with the position within the class."""
    C = len(cells.mean)
    place = sum_by(cells.own, cells.place**2, C)
    product = sum_by(cells.own, cells.place[:, None, None] * cells.residual, C)
    explained = (product**2 / np.maximum(place, 1e-300)[:, None, None])[place > 0].sum()
    return _ratio(float(explained), float((cells.residual**2).sum()))


def _between_sessions(cells: _Cells) -> float:
    """Share of the variance within classes that is between sessions."""
    _, session = np.unique(cells.session, return_inverse=True)
    _, index = np.unique(cells.own * (session.max() + 1) + session, return_inverse=True)
    count = np.bincount(index)[:, None, None]
    mean = sum_by(index, cells.residual, len(count)) / count
    return _ratio(float((count * mean**2).sum()), float((cells.residual**2).sum()))


STATISTICS: dict[str, Statistic] = {
    "profile": Statistic("variance between times", "exchangeable samples", _profile_share, (2, 1, 1, 1, 1)),
    "lag": Statistic("correlation of neighbouring samples", "independence in time", _lag_one, (2, 1, 2, 1, 1)),
    "taxels": Statistic("correlation of taxels", "independence of taxels", _taxel_correlation, (1, 2, 2, 1, 1)),
    "tails": Statistic("residuals beyond 3 SD", "shape of the distribution", _tails, (1, 1, 2, 1, 1)),
    "gain": Statistic("spread of tap strength", "independence within a tap", _tap_gain, (2, 1, 2, 1, 1)),
    "place": Statistic("variance with place in class", "one mean per class", _slope_over_place, (1, 1, 3, 2, 1)),
    "sessions": Statistic("variance between sessions", "independence of taps", _between_sessions, (1, 1, 2, 1, 2)),
}
"""Checks by name."""


def predictive_checks(
    models: Mapping[str, Fitted],
    taps: TapSet,
    seed: int,
    replicates: int = REPLICATES,
    progress: Callable[[int], None] | None = None,
) -> xr.Dataset:
    """Statistics of training taps and of replicates from every model.

    Samples are rounded to their bins on both sides, as the histogram has no finer values.

    Args:
        models: Fits with a posterior, by name.
        taps: The training taps, of classes that all models know.
        seed: Of the replicates.
        replicates: How many of each model.
        progress: Told of every replicate.

    Returns:
        `observed` (statistic), `replicated` (model, statistic, replicate), and `p` (model, statistic), the share of
        replicates at or above what was observed, from 0 to 1.
    """
    first = next(iter(models.values())).model
    where, what = taps.indices(first.grid)
    values = _rounded(taps.taps, first.edges)
    chosen = {name: s for name, s in STATISTICS.items() if _can(s, taps, where, what)}
    observed = _statistics(values, taps, where, what, first.grid.M, chosen)
    result = np.full((len(models), len(chosen), replicates), np.nan)
    for i, fitted in enumerate(models.values()):
        model = fitted.model
        if fitted.posterior is None:
            continue
        generator = np.random.default_rng([seed, i])
        for r in range(replicates):
            made = _replicate(fitted.posterior.draw(generator), model, taps, where, what, generator)
            found = _statistics(_rounded(made, model.edges), taps, where, what, model.grid.M, chosen)
            result[i, :, r] = list(found.values())
            if progress is not None:
                progress(1)
    above = (result >= np.array(list(observed.values()))[:, None]).mean(axis=-1)
    return xr.Dataset(
        {
            "observed": ("statistic", np.array(list(observed.values()))),
            "replicated": (("model", "statistic", "replicate"), result),
            "p": (("model", "statistic"), np.where(np.isnan(result).all(axis=-1), np.nan, above)),
            "label": ("statistic", np.array([s.label for s in chosen.values()], dtype=np.str_)),
            "assumption": ("statistic", np.array([s.assumption for s in chosen.values()], dtype=np.str_)),
        },
        {"model": np.array(list(models), dtype=np.str_), "statistic": np.array(list(chosen), dtype=np.str_)},
    )


def _replicate(
    parameters: Parameters,
    model: TapModel,
    taps: TapSet,
    where: NDArray[np.intp],
    what: NDArray[np.intp],
    generator: np.random.Generator,
) -> NDArray[np.float64]:
    """Taps of the same classes and, where the model knows places within a class, at the same places."""
    form = in_states(form_of(model, parameters), model.states, model.edges)
    hypothesis = _states_of_sessions(model.states.log_prior, taps.session, generator) * model.grid.M + what
    J = taps.taps.shape[1]
    if isinstance(form, TableForm) or len(form.log_weight) == 1 or model.grid.where_edges is None:
        return form.sample(where, hypothesis, model.edges, J, generator)
    edges, Q = model.grid.where_edges, len(form.log_weight)
    share = (taps.where - edges[where]) / np.diff(edges)[where]
    made, q = np.empty(taps.taps.shape), np.clip((share * Q).astype(int), 0, Q - 1)
    for i in np.unique(q):
        this = q == i
        at = form._replace(mean=form.mean[i : i + 1], scale=form.scale[i : i + 1], log_weight=np.zeros(1))
        made[this] = at.sample(where[this], hypothesis[this], model.edges, J, generator)
    return made


def _states_of_sessions(
    log_prior: NDArray[np.float64], session: NDArray[np.int64], generator: np.random.Generator
) -> NDArray[np.intp]:
    """One state for all taps of a session, shape (N,)."""
    numbers, index = np.unique(session, return_inverse=True)
    return generator.choice(len(log_prior), size=len(numbers), p=np.exp(log_prior))[index]


def _can(statistic: Statistic, taps: TapSet, where: NDArray[np.intp], what: NDArray[np.intp]) -> bool:
    """Whether taps show a statistic at all."""
    key = where * (what.max() + 1) + what
    repeats = len(key) / len(np.unique(key))
    places = np.mean([len(np.unique(taps.where[key == c])) for c in np.unique(key)])
    has = (*taps.taps.shape[1:], repeats, places, len(np.unique(taps.session)))
    return all(value >= least for value, least in zip(has, statistic.needs, strict=True))


def _statistics(
    values: NDArray[np.float64],
    taps: TapSet,
    where: NDArray[np.intp],
    what: NDArray[np.intp],
    M: int,
    chosen: Mapping[str, Statistic],
) -> dict[str, float]:
    _, own = np.unique(where * M + what, return_inverse=True)
    own, C = np.asarray(own, dtype=np.intp), int(own.max()) + 1
    count = np.bincount(own, minlength=C).astype(np.float64)
    mean = sum_by(own, values, C) / count[:, None, None]
    place = taps.where - (np.bincount(own, taps.where, minlength=C) / count)[own]
    cells = _Cells(mean, values - mean[own], own, place, taps.session)
    return {name: statistic.of(cells) for name, statistic in chosen.items()}


def _rounded(taps: NDArray[np.floating], edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """The middle of each sample's bin."""
    K = taps.shape[2]
    edges = np.broadcast_to(edges, (K, edges.shape[-1]))
    centre = 0.5 * (edges[:, :-1] + edges[:, 1:])
    return centre[np.arange(K), find_bins(taps, edges)]


def _ratio(part: float, whole: float) -> float:
    return float(part / whole) if whole > 0 else np.nan
