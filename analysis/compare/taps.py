"""Models compared by prediction of taps: log probability of the bins of a tap under its own class.

All densities are at power 1, as a powered likelihood is not normalised, and all are probabilities of the same bins.
Two ways to leave taps out. Single training taps: by Pareto smoothed importance sampling (Vehtari et al., JMLR 25 (2024)
72) where its diagnostic allows, which a sample of the taps decides, and exactly for the histogram. Whole sessions:
fitted to the others, which is what a model meets when it is put to use.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...inference.trials.resampling import Spread
from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.measurement.draws import drawn, integrated, plug_in
from ...models.measurement.histogram import HistogramPosterior
from ...models.measurement.model import Fitted
from ...models.seeds import Purpose, generator
from ...models.taps import TapSet, concatenate
from ..stats.pairing import RESAMPLES, with_intervals

GOOD_K = 0.7
"""Pareto k above which importance sampling of a tap is not to be trusted, however many draws; less with few."""
SAMPLE = 100
"""Taps by which importance sampling is judged; the others are looked at only where it works for all of these."""
MOST_FOLDS = 6


class SessionFold(NamedTuple):
    """One group of sessions left out."""

    name: str
    train: TapSet
    test: TapSet


class TapScores(NamedTuple):
    """Log probability of each tap, and where it belongs.

    Attributes:
        values: In nats, shape (N,).
        cluster: Number of the tap's session and class; taps of one cluster err together; shape (N,).
    """

    values: NDArray[np.float64]
    cluster: NDArray[np.intp]


def known_taps(taps: TapSet, grid: ClassGrid, covered: NDArray[np.bool_]) -> TapSet:
    """The taps of covered classes.

    Raises:
        InputError: There is none.
    """
    where, what = taps.indices(grid)
    inside = (where >= 0) & (what >= 0)
    inside[inside] = covered[where[inside], what[inside]]
    if not inside.any():
        raise InputError("No tap is left: none belongs to a class with a training tap.")
    return taps.select(inside)


def leave_one_tap_out(
    fitted: Fitted,
    taps: TapSet,
    draws: int,
    seed: int,
    progress: Callable[[int], None] | None = None,
) -> xr.Dataset:
    """Importance sampled leave-one-out of training taps, by ArviZ.

    A model is ranked by it only if it works for every tap, so a random sample comes first. Where it fails for one of
    these, as for most models of taps with many samples, the others are not looked at.

    Returns:
        Over (tap): `looked_at`, `psis` in nats and `pareto_k`, NaN where a tap was not looked at or no tail can be
        fitted; and `exact` and `exact_plug_in` where the model is a plain histogram.
    """
    grid, own = fitted.model.grid, taps.indices(fitted.model.grid)
    order = generator(seed, Purpose.SINGLE_TAPS).permutation(len(taps))
    looked_at, (psis, k) = np.zeros(len(taps), dtype=bool), np.full((2, len(taps)), np.nan)
    good_k = GOOD_K
    for chosen, count in ((order[:SAMPLE], progress), (order[SAMPLE:], None)):
        if not len(chosen) or not (k[looked_at] <= good_k).all():
            break
        looked_at[chosen] = True
        psis[chosen], k[chosen], good_k = _importance_sampled(fitted, taps.select(chosen), draws, seed, count)
    result = xr.Dataset(
        {"psis": ("tap", psis), "pareto_k": ("tap", k), "looked_at": ("tap", looked_at), "good_k": good_k}
    )
    if isinstance(fitted.posterior, HistogramPosterior) and len(fitted.model.states.gain) == 1:
        left = fitted.posterior.leave_out(taps.taps, fitted.model.edges, own[0] * grid.M + own[1])
        result["exact"], result["exact_plug_in"] = ("tap", left.integrated), ("tap", left.plug_in)
    return result


def _importance_sampled(
    fitted: Fitted, taps: TapSet, draws: int, seed: int, progress: Callable[[int], None] | None
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Log probability of each tap given the others and its Pareto k, shape (N,) both, and the largest good k."""
    import arviz as az  # noqa: PLC0415

    log_probability = np.empty((draws, len(taps)))
    for i, (_, values) in enumerate(drawn(fitted, taps, draws, seed)):
        log_probability[i] = values
        if progress is not None:
            progress(1)
    bins = (("chain", "draw", "tap"), log_probability[None])
    tree = xr.DataTree.from_dict({"log_likelihood": xr.Dataset({"bins": bins})})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of large Pareto k, which are reported one by one
        try:
            loo: Any = az.loo(tree, pointwise=True, reff=1.0)
        except ValueError:  # all draws give some tap the same probability, so there is no tail to fit
            nothing = np.full(len(taps), np.nan)
            return nothing, nothing, GOOD_K
    return loo.elpd_i.values, loo.pareto_k.values, min(GOOD_K, float(loo.good_k))


def session_folds(train: TapSet, test: TapSet, *, one_recording: bool = False) -> tuple[list[SessionFold], str]:
    """Every session of both sets left out in turn, in at most `MOST_FOLDS` groups.

    Args:
        train: Training taps.
        test: Test taps.
        one_recording: Whether sessions of the same number in both are the same session.

    Returns:
        The folds, the one that tests `test` on `train` itself last where there is such a one, and a sentence. No fold
        where there is one session only.
    """
    test = test if one_recording else _renumbered(train, test)
    try:
        pooled = concatenate([train, test])
    except InputError as error:
        sentence = f"TRAIN and TEST cannot be pooled ({str(error).rstrip('.')}), so TEST alone is left out."
        return [SessionFold("TEST", train, test)], sentence
    sessions = np.unique(pooled.session)
    if len(sessions) < 2:
        return [], "No session can be left out, because there is only one."
    groups = np.array_split(sessions, min(len(sessions), MOST_FOLDS))
    folds = []
    for group in groups:
        left_out = np.isin(pooled.session, group)
        folds.append(
            SessionFold(f"session {', '.join(map(str, group))}", pooled.select(~left_out), pooled.select(left_out))
        )
    same = [set(np.unique(fold.train.session)) == set(np.unique(train.session)) for fold in folds]
    is_main = [s and len(fold.train) == len(train) for s, fold in zip(same, folds, strict=True)]
    folds = [f for f, m in zip(folds, is_main, strict=True) if not m] + [
        f._replace(train=train) for f, m in zip(folds, is_main, strict=True) if m
    ]
    each = "Each session" if len(groups) == len(sessions) else f"Each of {len(groups)} groups of sessions"
    return folds, f"{each} of TRAIN and TEST was predicted from the others."


def score_fold(fitted: Fitted, fold: SessionFold, seed: int) -> dict[str, TapScores]:
    """Scores `integrated` and `plug_in` of the taps of a fold's test set whose classes the model knows."""
    taps = known_taps(fold.test, fitted.model.grid, fitted.model.trained)
    own = taps.indices(fitted.model.grid)
    _, cluster = np.unique(np.stack([taps.session, own[0] * fitted.model.grid.M + own[1]]), axis=1, return_inverse=True)
    cluster = np.asarray(cluster, dtype=np.intp).ravel()
    scores = {"plug_in": TapScores(plug_in(fitted, taps.taps, own), cluster)}
    if fitted.posterior is not None:
        chance = generator(seed, Purpose.SCORES)
        scores["integrated"] = TapScores(integrated(fitted, taps.taps, own, chance), cluster)
    return scores


def join_scores(parts: Sequence[TapScores]) -> TapScores:
    """Scores of several folds one behind the other, their clusters kept apart."""
    offset, clusters = 0, []
    for part in parts:
        clusters.append(part.cluster + offset)
        offset += int(part.cluster.max(initial=-1)) + 1
    return TapScores(np.concatenate([part.values for part in parts]), np.concatenate(clusters))


def relative_elpd(scores: Mapping[str, TapScores], folds: int) -> dict[str, Any]:
    """Log probabilities of the same taps under each model as ArviZ's `ELPDData`, for `az.compare`.

    Each tap's are relative to the best model: a number common to all models changes no difference and no weight, and
    without it exp() of all would be 0.
    """
    from arviz_stats.utils import ELPDDataLOOKFold  # noqa: PLC0415

    names = list(scores)
    values = np.array([scores[name].values for name in names])
    relative = values - values.max(axis=0)
    n = values.shape[1]
    return {
        name: ELPDDataLOOKFold(
            elpd=float(row.sum()),
            se=float(np.sqrt(n * row.var())),
            p=np.nan,
            n_samples=n,
            n_data_points=n,
            scale="log",
            warning=False,
            good_k=np.nan,
            elpd_i=xr.DataArray(row, dims="tap"),
            n_folds=folds,
        )
        for name, row in zip(names, relative, strict=True)
    }


def stacked(elpd: Mapping[str, Any]) -> Any:
    """ArviZ's comparison of two models or more: a data frame of rank, differences with standard errors and weights.

    Args:
        elpd: See `relative_elpd`.
    """
    import arviz as az  # noqa: PLC0415

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return az.compare(elpd, method="stacking", round_to="none")


def mean_scores(scores: Mapping[str, TapScores], reference: str, name: str, seed: int) -> xr.Dataset:
    """Mean log probability per tap of every model, and of its difference to a reference, with bootstrap intervals.

    Clusters are drawn, a session's taps of one class at a time, the same for all models; C of them tell their variance
    with C - 1 degrees of freedom.
    """
    names = list(scores)
    first = scores[names[0]]
    C, N = int(first.cluster.max()) + 1, len(first.values)
    size = np.bincount(first.cluster, minlength=C)
    drawn_times = generator(seed, Purpose.CLUSTERS).multinomial(C, np.full(C, 1 / C), size=RESAMPLES).astype(np.float64)
    weights = np.concatenate([np.ones((1, C)), drawn_times])
    sums = np.array([np.bincount(scores[n].cluster, scores[n].values, minlength=C) for n in names])
    samples = (sums @ weights.T) / (weights @ size)
    attributes = {"long_name": "mean log probability of a tap's bins", "units": "nat per tap"}
    spread = Spread(float(np.sqrt(C / max(C - 1, 1))), freedom=max(C - 1.0, 1.0))
    result = with_intervals(name, samples, ("model",), names.index(reference), attributes, spread)
    return result.assign_coords(model=np.array(names, dtype=np.str_)).assign_attrs(taps=N, reference=reference)


def _renumbered(train: TapSet, test: TapSet) -> TapSet:
    """The test taps, in sessions of their own numbers where the training taps have the same ones."""
    if not np.isin(test.session, train.session).any():
        return test
    offset = int(train.session.max()) + 1 - int(test.session.min())
    return TapSet(test.dataset.assign_coords(session=("tap", test.session + offset)))
