"""Posterior predictive checks of an audit: do taps drawn from the naive-Bayes model resemble the recorded ones?

The model is fitted to the very taps that are checked, of all sessions, and replicates of them are drawn from it: new
histograms from their posterior, then every sample by itself. The posterior is that without a pseudocount, a Dirichlet
distribution of the bins that taps fell into: a pseudocount keeps the other bins possible, and where classes have few
samples it would give replicates outliers that no assumption of independence is to blame for. What `stats.checks`
measures, dependence of taxels, of samples and of taps, is then taken of the taps and of each replicate. Results are
kept as ArviZ keeps them, a tree with the groups `posterior_predictive` and `observed_data`, so that its functions take
them as they are.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...models import seeds
from ...models.errors import InputError
from ...models.measurement.histogram import HistogramModel, fit
from ...models.taps import TapSet
from ...models.threads import cores, in_order
from ..stats.checks import STATISTICS, TapLabels, observed_statistics, replicate
from ..stats.metrics import CONFIDENCE

REPLICATES = 100
FEWEST = 40
_SAMPLES = 180_000_000  # in all replicates, some seconds
_AT_ONCE = 1 << 26  # samples of replicates at a time, some GiB with what is taken of them
FAR = 4.0  # standard deviations of the replicates


def count_replicates(taps: TapSet, replicates: int = REPLICATES) -> int:
    """How many replicates are drawn: those wanted, or of many taps so many that it takes seconds, at least 40."""
    return min(replicates, max(FEWEST, _SAMPLES // max(taps.samples.size, 1)))


def audit_checks(
    taps: TapSet,
    model: HistogramModel,
    seed: int = 0,
    replicates: int = REPLICATES,
    progress: Callable[[int], None] | None = None,
) -> xr.DataTree:
    """Statistics of taps and of replicates from histograms that are fitted to the same taps.

    Args:
        taps: Taps of all sessions, numbered apart; those outside the classes are left out.
        model: Gives classes and bins.
        seed: Of the replicates.
        replicates: How many are wanted, see `count_replicates`.
        progress: Called after every replicate.

    Returns:
        A tree with the groups `posterior_predictive`, a variable (chain, draw) for each of `STATISTICS` that the taps
        show, and `observed_data`, the same variables without dimensions; attributes of variables: `long_name` and
        `assumption`. The root has the attributes `replicates`, `wanted`, `taps` and `seed`.

    Raises:
        InputError: No tap belongs to a class, or fewer than two replicates are wanted.
    """
    if replicates < 2:
        raise InputError(f"Checks need at least two replicates, got {replicates}.")
    inside = np.minimum(*taps.indices(model.grid)) >= 0
    if not inside.any():
        raise InputError("No tap belongs to a class of the model, so nothing can be checked.")
    taps = taps if inside.all() else taps.select(inside)
    fitted = fit(taps, model.grid, bins=model.edges.shape[-1] - 1, power="none", edges=model.edges)
    labels = TapLabels.of(taps, model.grid)
    observed = observed_statistics(labels, model.edges)
    used = count_replicates(taps, replicates)

    def of_replicate(r: int) -> list[float]:
        generator = seeds.generator(seed, seeds.Purpose.REPLICATES, r)
        made = replicate(_draw(fitted.counts, generator), fitted, labels, generator)
        return [STATISTICS[name].of(made) for name in observed]

    at_once = max(1, min(cores(None), _AT_ONCE // (taps.samples.size + 2 * fitted.counts.size)))
    values = np.empty((used, len(observed)))
    for r, found in enumerate(in_order((partial(of_replicate, r) for r in range(used)), at_once)):
        values[r] = found
        if progress is not None:
            progress(1)
    attributes = {
        name: {"long_name": STATISTICS[name].label, "assumption": STATISTICS[name].assumption} for name in observed
    }
    predicted = {
        name: (("chain", "draw"), values[np.newaxis, :, i], attributes[name]) for i, name in enumerate(observed)
    }
    groups = {
        "posterior_predictive": xr.Dataset(predicted, {"chain": [0], "draw": np.arange(used)}),
        "observed_data": xr.Dataset({name: ((), value, attributes[name]) for name, value in observed.items()}),
    }
    tree = xr.DataTree.from_dict(groups)
    tree.attrs = {"replicates": used, "wanted": replicates, "taps": len(taps), "seed": seed}
    return tree


def _draw(counts: NDArray[np.int64], generator: np.random.Generator) -> dict[str, NDArray[np.float64]]:
    """Histograms from a Dirichlet distribution with these counts; bins without any stay empty."""
    weight = generator.standard_gamma(counts)
    with np.errstate(divide="ignore", invalid="ignore"):
        return {"log_prob": np.log(weight / weight.sum(axis=-1, keepdims=True))}


def summarise_checks(tree: xr.DataTree) -> xr.Dataset:
    """Where the observed statistics lie among those of the replicates.

    Args:
        tree: From `audit_checks`.

    Returns:
        Dim statistic: `observed`; `mean`, `low` and `high` of the replicates, the latter at 95%; `z`, by how many of
        their standard deviations the observed value exceeds their mean; `p`, twice the share of replicates and the
        observed value that are at least as far out on its side, at most 1; `differs`, whether it lies outside all
        replicates and by more than four standard deviations; `label` and `assumption`.
    """
    predicted, observed = tree["posterior_predictive"].to_dataset(), tree["observed_data"].to_dataset()
    names = [str(name) for name in observed.data_vars]
    values = np.array([predicted[name].values.ravel() for name in names]).reshape(len(names), predicted.sizes["draw"])
    seen = np.array([float(observed[name]) for name in names])
    mean, sd = values.mean(axis=1), values.std(axis=1, ddof=1)
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(values, [tail, 1 - tail], axis=1)
    z = np.divide(seen - mean, sd, out=np.copysign(np.inf, seen - mean), where=sd > 0)
    z[seen == mean] = 0.0
    above, below = (
        (side.sum(axis=1) + 1) / (values.shape[1] + 1) for side in (values >= seen[:, None], values <= seen[:, None])
    )
    outside = (seen < values.min(axis=1)) | (seen > values.max(axis=1))
    text = {
        key: np.array([observed[name].attrs[attribute] for name in names], dtype=np.str_)
        for key, attribute in (("label", "long_name"), ("assumption", "assumption"))
    }
    numbers = {"observed": seen, "mean": mean, "low": low, "high": high, "z": z}
    numbers |= {"p": np.minimum(1.0, 2 * np.minimum(above, below)), "differs": outside & (np.abs(z) > FAR)}
    return xr.Dataset({key: ("statistic", value) for key, value in (numbers | text).items()}, {"statistic": names})
