"""Likelihood of a tap under every form of measurement model, in plain NumPy and SciPy.

Written for reading: loops where the formulas of `models.measurement.likelihood` have sums, all places and
hypotheses at once. The compiled loops of `models.measurement.likelihood.innovations` and the distribution of
`models.measurement.likelihood.binned` are checked against it. Letters are those of `reference`; H stands for
hypotheses, objects or objects in states, and Q for the parts of a mixture.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from ..models.measurement.likelihood.any_form import Form
from ..models.measurement.likelihood.bins import TableForm
from ..models.measurement.likelihood.forms import GaussianForm
from ..models.measurement.likelihood.mixture import MixtureForm
from . import reference


def log_likelihood(
    tap: NDArray[np.floating], form: Form, edges: NDArray[np.float64], exponent: float
) -> NDArray[np.float64]:
    """Log P(z | where, hypothesis) of one tap, shape (L, H); Eq. 1 with the probability of the form.

    Args:
        tap: Prepared samples, shape (J, K); those that are NaN do not count, which requires independent samples.
        form: Form of the model.
        edges: Bin edges, shape (B + 1,) or (K, B + 1).
        exponent: Power of the likelihood.
    """
    if isinstance(form, TableForm):
        return table_log_likelihood(tap, form.log_prob, edges, exponent)
    if isinstance(form, GaussianForm):
        return exponent * _log_mixture(np.asarray(tap, dtype=np.float64), form, edges)
    if isinstance(form, MixtureForm):
        each = [log_likelihood(tap, part, edges, 1.0) for part in form.parts]
        return exponent * (np.logaddexp.reduce(each, axis=0) - np.log(len(each)))
    out = np.empty((1, *form.shape))  # a generative model has no formula but its own
    form.prepare(np.zeros(form.shape, dtype=bool)).log_likelihood(np.asarray(tap)[None], edges, exponent, out)
    return out[0]


def table_log_likelihood(
    tap: NDArray[np.floating], log_prob: NDArray[np.float64], edges: NDArray[np.float64], exponent: float
) -> NDArray[np.float64]:
    """Eq. 1 from the samples that are there, taxel by taxel; `log_prob` has shape (L, H, K, B)."""
    if not np.isnan(tap).any():
        return reference.tap_log_likelihood(reference.tap_bins(tap, edges), log_prob, exponent)
    total = np.where(np.isneginf(log_prob).all(axis=(2, 3)), -np.inf, 0.0)
    for k in range(tap.shape[1]):
        there = tap[~np.isnan(tap[:, k]), k]
        bins = reference.bin_index(there, edges if edges.ndim == 1 else edges[k])
        total += reference.tap_log_likelihood(bins[:, np.newaxis], log_prob[:, :, [k]], exponent)
    return total


def _log_mixture(tap: NDArray[np.float64], form: GaussianForm, edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Log of the sum over q of weight q times the probability of the tap's bins under Gaussian q, shape (L, H)."""
    there = ~np.isnan(tap)
    tap = np.where(there, tap, 0.0)
    lower, upper = _bin_of_each_sample(tap, edges)
    total = np.full(form.shape, -np.inf)
    for q in range(len(form.log_weight)):
        innovation = innovations(tap, form, q)
        forecast = tap - innovation
        log_prob = log_normal_interval((lower - forecast) / form.scale[q], (upper - forecast) / form.scale[q])
        total = np.logaddexp(total, form.log_weight[q] + log_prob.sum(axis=(2, 3), where=there))
    return total


def innovations(tap: NDArray[np.float64], form: GaussianForm, q: int) -> NDArray[np.float64]:
    """Prediction errors of the samples given the previous ones, under Gaussian q; shape (L, H, J, K).

    It is u_jk = sum_{k' <= k} W_kk' sum_{i <= j} V_k'ji r_ik' with the residuals r.
    """
    J, K = tap.shape
    V, W = np.broadcast_to(form.time, (K, J, J)), form.taxel
    residual = tap - form.mean[q]
    in_time = np.zeros_like(residual)
    for j in range(J):
        for i in range(j + 1):
            if V[:, j, i].any():
                in_time[:, :, j] += V[:, j, i] * residual[:, :, i]
    if W.shape[-1] == 0:
        return in_time
    across = np.zeros_like(residual)
    for k in range(K):
        for p in range(k + 1):
            across[..., k] += W[:, :, k, p, np.newaxis] * in_time[..., p]
    return across


def log_normal_interval(lower: NDArray[np.float64], upper: NDArray[np.float64]) -> NDArray[np.float64]:
    """Log probability of a standard normal between `lower` and `upper`, arrays of one shape."""
    mirrored = lower + upper > 0  # both distribution functions are then small, and their logs exact
    low, high = np.where(mirrored, -upper, lower), np.where(mirrored, -lower, upper)
    log_high = log_ndtr(high)
    return log_high + np.log(-np.expm1(log_ndtr(low) - log_high))


def _bin_of_each_sample(
    tap: NDArray[np.float64], edges: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lower and upper bin edge of each sample, both (J, K); end bins extend to infinity."""
    J, K = tap.shape
    index = reference.tap_bins(tap, edges)
    lower, upper = np.empty((J, K)), np.empty((J, K))
    for k in range(K):
        row = (edges if edges.ndim == 1 else edges[k]).copy()
        row[0], row[-1] = -np.inf, np.inf
        lower[:, k], upper[:, k] = row[index[:, k]], row[index[:, k] + 1]
    return lower, upper
