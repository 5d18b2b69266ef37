"""Paired comparisons of models: the same test taps and the same resamples for all."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ...inference.trials.records import TapTable
from ...inference.trials.resampling import Spread, widened
from ...models.errors import InputError

RESAMPLES = 1000
"""Where resampling costs no trials."""
_FEW_ERRORS = 5  # with fewer of either model, resamples do not show how much the difference of errors varies


def check_tables(tables: Mapping[str, TapTable]) -> tuple[int, int]:
    """Refuses tables that do not hold the same test taps.

    Returns:
        (L, M).

    Raises:
        InputError: There is no table, or two of them cannot be compared.
    """
    if not tables:
        raise InputError("No model to compare.")
    first, *_ = tables
    pool = tables[first].pool
    L, M = pool.shape
    for name, table in tables.items():
        same = all(np.array_equal(a, b) for a, b in zip(pool, table.pool, strict=True))
        if not same or len(table.log_likelihood) != len(tables[first].log_likelihood):
            raise InputError(f"The models {first!r} and {name!r} have different test taps.")
        H = table.log_prior.shape[-1]
        if table.log_prior.shape != (L, H) or table.log_likelihood.shape[1:] != (L, H) or not H or H % M:
            raise InputError(
                f"The table of model {name!r} has likelihoods of shape {table.log_likelihood.shape} and a prior of "
                f"shape {table.log_prior.shape}, which do not match {L} x {M} classes."
            )
    return L, M


def reference_name(names: Sequence[str], reference: str | None) -> str:
    """The model that the others are compared with, by default the first.

    Raises:
        InputError: There is no such model.
    """
    reference = names[0] if reference is None else reference
    if reference not in names:
        raise InputError(f"The reference model {reference!r} is not one of the models {', '.join(names)}.")
    return reference


def with_intervals(
    name: str,
    samples: NDArray[np.float64],
    dims: tuple[str, ...],
    reference: int,
    attributes: Mapping[str, Any],
    spread: Spread,
    *,
    limits: tuple[float, float] = (-np.inf, np.inf),
    biased: bool = False,
    independent: ArrayLike | None = None,
    smallest: float = 1.0,
    endings: Sequence[NDArray[np.float64]] = (),
    steps: bool = False,
) -> xr.Dataset:
    """A quantity of every model and its difference to the reference model, each with an interval.

    Args:
        name: Of the quantity.
        samples: Its estimate and, behind that, resamples that all models share, shape (models, ..., 1 + R) or as
            `resampling.Spread.interval` says.
        dims: Of the axes but the last.
        reference: Index of the reference model.
        attributes: Of the variables.
        spread: How resamples turn into intervals.
        limits: Least and greatest possible value.
        biased: Whether noise makes the quantity larger, as it does a calibration error. A resample adds as much noise
            again, so that its excess over the estimate says how much too large that may be: the interval reaches
            down by so much more.
        independent: Of what may not have been seen, such as errors: how many decisions are independent, see
            `resampling.widened`, broadcast to (models, ...).
        smallest: The smallest error.
        endings: Best and worst that the estimates might have been, shape (models, ...), see
            `inference.trials.records`; none where they could not.
        steps: Whether models are compared with the next smaller value too.

    Returns:
        `<name>`, `<name>_low`, `<name>_high`, and the same of `<name>_difference`, which is NaN where both models
        are infinite; with `steps` the same of `<name>_step`, the difference to the model of the next smaller value,
        NaN for the smallest.
    """
    least, most = limits
    own, event = spread.interval(samples, least, most, endings), np.zeros(samples.shape[:-1])
    if independent is not None:
        center = spread.center(samples)
        own = widened(*own, samples[..., 0], center, independent, smallest, most, least=least)
        seen = spread.per_error(samples, least, most)
        event += np.where(seen > 0, seen, smallest / np.maximum(independent, 1))
        few = (seen == 0) | (np.minimum(center - least, most - center) < _FEW_ERRORS * seen)
    else:
        few = np.zeros(event.shape, dtype=bool)
    rows, number = [(name, samples, own, limits)], np.indices(event.shape)[0]
    bases = {"difference": np.full_like(number, reference)} | (
        {"step": _next_smaller(samples[..., 0])} if steps else {}
    )
    for label, base in bases.items():
        there, itself = partial(np.take_along_axis, indices=base, axis=0), base == number
        with np.errstate(invalid="ignore"):
            difference = samples - np.take_along_axis(samples, base[..., np.newaxis], axis=0)
            apart = [one - there(other) for one, other in zip(endings, endings[::-1], strict=True)]
        if label == "step":
            difference[itself] = np.nan
        apart = [np.where(itself, difference[..., 0], one) for one in apart]
        between = np.where((few | there(few)) & ~itself, np.hypot(event, there(event)), 0.0)
        ends = spread.interval(difference, endings=apart, event=between)
        rows.append((f"{name}_{label}", difference, ends, (least - most, most - least)))
    result = {}
    for label, values, ends, bounds in rows:
        # The lower end moves by an excess, the upper one by what is missing.
        excess = np.nan_to_num(spread.center(values) - values[..., 0]) if biased else np.zeros(values.shape[:-1])
        low, high = ends[0] - np.maximum(excess, 0.0), ends[1] - np.minimum(excess, 0.0)
        low, high = np.clip(low, *bounds), np.clip(high, *bounds)
        result |= {label: values[..., 0], f"{label}_low": low, f"{label}_high": high}
    return xr.Dataset({key: (dims, values, dict(attributes)) for key, values in result.items()})


def _next_smaller(values: NDArray[np.float64]) -> NDArray[np.intp]:
    """Index of the model whose value is the next smaller one, itself for the smallest; shape (models, ...)."""
    order = values.argsort(axis=0, kind="stable")
    found = np.empty_like(order)
    np.put_along_axis(found, order, np.concatenate([order[:1], order[:-1]]), axis=0)
    return found
