"""Models compared by prediction of taps: log probability of the bins of a tap under its own class.

All densities are at power 1, as a powered likelihood is not normalised, and all are probabilities of the same bins.
Single training taps are left out by Pareto smoothed importance sampling (Vehtari et al., JMLR 25 (2024) 72) where its
diagnostic allows, which a sample of the taps decides, and exactly where a closed form exists; for whole groups see
`groups`.
"""

import sys
import warnings
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...inference.trials.resampling import Spread, freedom_of
from ...models.measurement.draws import drawn
from ...models.measurement.model import Fitted
from ...models.seeds import Purpose, generator
from ...models.taps import TapSet
from ...models.threads import one_blas_thread
from ..stats.pairing import with_intervals

GOOD_K = 0.7
"""Pareto k above which importance sampling of a tap is not to be trusted, however many draws; less with few."""
SAMPLE = 100
"""Taps by which importance sampling is judged; the others are looked at only where it works for all of these."""


class ScoreKind(NamedTuple):
    """What scores are.

    Attributes:
        long_name: Of their mean.
        units: Likewise.
        limits: Least and largest value.
    """

    long_name: str = "mean log probability of a tap's bins"
    units: str = "nat per tap"
    limits: tuple[float, float] = (-np.inf, np.inf)


LOG_PROBABILITY = ScoreKind()
_SKEWED_FROM = 5
"""Fewest clusters of one size where correcting for skewness covers more than Student's t, widened as much, would."""


class TapScores(NamedTuple):
    """Score of each tap, and where it belongs.

    Attributes:
        values: Log probabilities in nats, or another score, shape (N,).
        cluster: Number of what would be drawn anew: the tap's session, the fold of positions or objects that was left
            out, or the class where one session is left out alone; shape (N,).
        without: The score if one more cluster had been left out, shape (N, C), NaN for the tap's own; `None` where
            taps of other clusters do not depend on it.
    """

    values: NDArray[np.float64]
    cluster: NDArray[np.intp]
    without: NDArray[np.float64] | None = None


def leave_one_tap_out(fitted: Fitted, taps: TapSet, draws: int, seed: int) -> xr.Dataset:
    """Importance sampled leave-one-out of training taps, by ArviZ.

    A model is ranked by it only if it works for every tap, so a random sample comes first. Where it fails for one of
    these, as for most models of taps with many samples, the others are not looked at.

    Returns:
        Over (tap): `looked_at`, `psis` in nats and `pareto_k`, NaN where a tap was not looked at or no tail can be
        fitted; where the model has a closed form `exact`, and for the plain histogram `exact_plug_in`.
    """
    order = generator(seed, Purpose.SINGLE_TAPS).permutation(len(taps))
    looked_at, (psis, k) = np.zeros(len(taps), dtype=bool), np.full((2, len(taps)), np.nan)
    good_k = GOOD_K
    for chosen in (order[:SAMPLE], order[SAMPLE:]):
        if not len(chosen) or not (k[looked_at] <= good_k).all():
            break
        looked_at[chosen] = True
        psis[chosen], k[chosen], good_k = _importance_sampled(fitted, taps.select(chosen), draws, seed)
    result = xr.Dataset(
        {"psis": ("tap", psis), "pareto_k": ("tap", k), "looked_at": ("tap", looked_at), "good_k": good_k}
    )
    left = fitted.leave_out(taps)
    if left is not None:
        result["exact"] = "tap", left.integrated
        if left.plug_in is not None:
            result["exact_plug_in"] = "tap", left.plug_in
    return result


def without_placeholders() -> None:
    """Takes away the placeholders of JAX and NumPyro that ArviZ leaves: SciPy would look into them, which loads JAX.

    For a process that does not give posteriors to ArviZ.
    """
    known = {*sys.modules}
    import arviz_base  # noqa: F401, PLC0415

    for name in {"jax", "numpyro"} - known:
        sys.modules.pop(name, None)


def _importance_sampled(
    fitted: Fitted, taps: TapSet, draws: int, seed: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Log probability of each tap given the others and its Pareto k, shape (N,) both, and the largest good k."""
    from arviz_stats.base.array import array_stats  # noqa: PLC0415

    log_probability = np.empty((len(taps), draws))
    for i, (_, values) in enumerate(drawn(fitted, taps, draws, seed)):
        log_probability[:, i] = values
    try:
        elpd, pareto_k, _ = array_stats.loo(log_probability[:, None])
    except ValueError:  # all draws give some tap the same probability, so there is no tail to fit
        nothing = np.full(len(taps), np.nan)
        return nothing, nothing, GOOD_K
    return elpd, pareto_k, min(GOOD_K, 1 - 1 / float(np.log10(draws)))


def join_scores(parts: Sequence[TapScores]) -> TapScores:
    """Scores of several folds one behind the other, their clusters kept apart."""
    offset, clusters = 0, []
    for part in parts:
        clusters.append(part.cluster + offset)
        offset += int(part.cluster.max(initial=-1)) + 1
    without = [part.without for part in parts if part.without is not None]
    return TapScores(
        np.concatenate([part.values for part in parts]),
        np.concatenate(clusters),
        np.concatenate(without) if without else None,
    )


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
    import scipy.optimize  # noqa: F401, PLC0415 - a library that is loaded later would use all cores and round otherwise
    from arviz_stats.loo.compare import compare  # noqa: PLC0415 - as in ArviZ, which loads matplotlib as well

    with one_blas_thread(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return compare(elpd, method="stacking", round_to="none")


def mean_scores(
    scores: Mapping[str, TapScores], reference: str, name: str, of: ScoreKind = LOG_PROBABILITY
) -> xr.Dataset:
    """Mean score per tap of every model, its difference to a reference and to the next smaller one, with intervals.

    Each cluster is left out in turn (jackknife), with its taps and, where the scores of other taps depend on it, as
    they do on the positions that the model was trained on, in what models say of those. The variance of C clusters of
    one size has C - 1 degrees of freedom. There is no interval from one cluster, or from two on which scores depend.
    The loss of a session grows with the square of its deviation, so it is skewed over sessions. From five clusters on
    intervals of log probabilities are corrected for it (Hall 1992, see `inference.trials.skewness`), unless the scores
    of taps depend on other clusters.
    """
    names = list(scores)
    first = scores[names[0]]
    sizes = np.bincount(first.cluster)
    C, known = len(sizes), len(sizes) > (1 if first.without is None else 2)
    samples = np.array([_jackknifed(one, C) for one in scores.values()])
    factor, freedom = float((C - 1) / np.sqrt(C) if known else np.nan), freedom_of(sizes)
    skewed = sizes if first.without is None and round(freedom + 1) >= _SKEWED_FROM else None
    spread = Spread(factor, freedom=freedom, sizes=skewed)
    attributes = {"long_name": of.long_name, "units": of.units}
    place = names.index(reference)
    result = with_intervals(name, samples, ("model",), place, attributes, spread, limits=of.limits, steps=True)
    return result.assign_coords(model=np.array(names, dtype=np.str_)).assign_attrs(
        taps=len(first.values), reference=reference, clusters=C, freedom=spread.freedom
    )


def _jackknifed(scores: TapScores, clusters: int) -> list[float]:
    """Mean score, and behind it that without each cluster, shape (1 + C,)."""
    values, cluster, without = scores
    left = (values if without is None else without[:, c] for c in range(clusters))
    return [values.mean(), *(one[cluster != c].mean() if clusters > 1 else np.nan for c, one in enumerate(left))]
