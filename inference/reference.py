"""The paper's equations 1 to 10 in plain NumPy, one function each, in the paper's order.

Lepora, Martinez-Hernandez and Prescott, "A SOLID case for active Bayesian perception in robot touch", Living Machines
2013. This file is the yardstick: it is written for reading beside the paper, imports nothing else of this project,
and every faster path is checked against it. Indices count from 0, arrays are float64.

Axes: `L` where classes, `M` what classes, `K` taxels, `J` samples of a tap, `B` histogram bins. A belief has shape
(L, M) and sums to one; a log belief is its logarithm, with -inf for an impossible class.
"""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

type Power = Literal["J", "JK", "none"] | float
type Border = Literal["uniform", "uniform_what", "prior", "clamp", "circular"]
type ValueRange = Literal["global", "taxel"]

POWERS = ("J", "JK", "none")
BORDERS = ("uniform", "uniform_what", "prior", "clamp", "circular")


class ZeroEvidenceError(ArithmeticError):
    """A tap is impossible under every class, so no posterior exists."""


def bin_edges(samples: ArrayLike, B: int, value_range: ValueRange = "global") -> NDArray[np.float64]:
    """Edges of B bins of equal width across the range of the training samples; text below Eq. 2.

    A range of 4 B rounding errors or less has no room for B bins. It is widened to either side by half a unit, or by
    8 B rounding errors if that is more.

    Args:
        samples: Training samples, shape (N, J, K).
        B: Number of bins.
        value_range: `"global"` for one range over all taxels, `"taxel"` for one of each.

    Returns:
        Edges, shape (B + 1,) or (K, B + 1).

    Raises:
        ValueError: `value_range` is unknown, or B is below 1.
    """
    if value_range not in ("global", "taxel") or B < 1:
        raise ValueError(f"B must be at least 1 and value_range global or taxel, got {B} and {value_range!r}.")
    samples = np.asarray(samples, dtype=np.float64)
    columns = [samples] if value_range == "global" else [samples[:, :, k] for k in range(samples.shape[2])]
    edges = []
    for column in columns:
        low, high = float(column.min()), float(column.max())
        rounding = float(np.spacing(max(abs(low), abs(high))))
        if high - low <= 4 * B * rounding:
            margin = max(0.5, 8 * B * rounding)
            low, high = low - margin, high + margin
        edges.append(np.linspace(low, high, B + 1))
    return edges[0] if value_range == "global" else np.array(edges)


def bin_index(samples: ArrayLike, edges: ArrayLike) -> NDArray[np.intp]:
    """Histogram bin b(s) of each sample; text below Eq. 2.

    Args:
        samples: Sensor values, any shape.
        edges: Increasing bin edges, shape (B + 1,). Bins are half-open, `[edges[b], edges[b + 1])`, the last one is
            closed; values outside go to the end bins.

    Returns:
        Indices in 0 .. B - 1, the shape of `samples`.

    Raises:
        ValueError: The edges do not increase, or a sample is NaN.
    """
    samples, edges = np.asarray(samples, dtype=np.float64), np.asarray(edges, dtype=np.float64)
    if edges.ndim != 1 or len(edges) < 2 or not np.all(np.diff(edges) > 0):
        raise ValueError(f"edges must be at least two increasing numbers, got shape {edges.shape}.")
    if np.isnan(samples).any():
        raise ValueError("Samples must not be NaN.")
    return np.clip(np.searchsorted(edges, samples, side="right") - 1, 0, len(edges) - 2)


def exponent(power: Power, J: int, K: int) -> float:
    """Exponent of the likelihood product: 1/J as printed in Eq. 1, or another choice.

    Args:
        power: `"J"` for 1/J, `"JK"` for 1/(J K), `"none"` for 1, or the exponent itself.
        J: Samples of a tap.
        K: Taxels.

    Raises:
        ValueError: The power is none of these, or no positive finite number.
    """
    if isinstance(power, str):
        if power not in POWERS:
            raise ValueError(f"power must be J, JK, none or a positive number, got {power!r}.")
        return {"J": 1.0 / J, "JK": 1.0 / (J * K), "none": 1.0}[power]
    if not (np.isfinite(power) and power > 0):
        raise ValueError(f"power must be J, JK, none or a positive number, got {power!r}.")
    return float(power)


def tap_log_likelihood(bins: ArrayLike, log_prob: ArrayLike, power: Power = "J") -> NDArray[np.float64]:
    """Log-likelihood of one tap under every class; Eq. 1.

    Args:
        bins: Bin of each sample and taxel, shape (J, K).
        log_prob: Logarithm of Eq. 2, shape (L, M, K, B).
        power: The root in Eq. 1, see `exponent`.

    Returns:
        log P(z | x_l, w_m), shape (L, M); -inf where a sample is impossible.

    Raises:
        ValueError: Taxels do not agree, or `power` is unknown.
    """
    bins, log_prob = np.asarray(bins), np.asarray(log_prob, dtype=np.float64)
    J, K = bins.shape
    if log_prob.ndim != 4 or log_prob.shape[2] != K:
        raise ValueError(f"bins have {K} taxels, log_prob has shape {log_prob.shape} instead of (L, M, {K}, B).")
    total = np.zeros(log_prob.shape[:2])
    for j in range(J):
        for k in range(K):
            total += log_prob[:, :, k, bins[j, k]]
    return exponent(power, J, K) * total


def tap_bins(tap: ArrayLike, edges: ArrayLike) -> NDArray[np.intp]:
    """`bin_index` of a tap, shape (J, K), with edges of all taxels, shape (B + 1,), or of each, shape (K, B + 1)."""
    tap, edges = np.asarray(tap), np.asarray(edges)
    if edges.ndim == 1:
        return bin_index(tap, edges)
    return np.stack([bin_index(tap[:, k], edges[k]) for k in range(len(edges))], axis=1)


def histogram_counts(
    samples: ArrayLike, edges: ArrayLike, where: ArrayLike, what: ArrayLike, shape: tuple[int, int]
) -> NDArray[np.int64]:
    """Occupation numbers h_k(b) of every class; text above Eq. 2.

    Args:
        samples: Training taps, shape (N, J, K).
        edges: As in `tap_bins`.
        where: Where class of each tap, shape (N,).
        what: What class of each tap, shape (N,).
        shape: (L, M).

    Returns:
        Counts, shape (L, M, K, B).
    """
    samples, edges = np.asarray(samples), np.asarray(edges)
    K, B = samples.shape[2], edges.shape[-1] - 1
    counts = np.zeros((*shape, K, B), dtype=np.int64)
    for tap, l, m in zip(samples, np.asarray(where), np.asarray(what), strict=True):
        bins = tap_bins(tap, edges)
        for k in range(K):
            counts[l, m, k] += np.bincount(bins[:, k], minlength=B)
    return counts


def trained_classes(counts: ArrayLike) -> NDArray[np.bool_]:
    """Mask of the classes with a training tap, shape (L, M), from counts of shape (L, M, K, B)."""
    return np.asarray(counts).sum(axis=(2, 3)) > 0


def log_histograms(counts: ArrayLike, pseudocount: float = 0.01) -> NDArray[np.float64]:
    """Logarithm of Eq. 2 for every class; -inf throughout for a class without a training tap.

    Args:
        counts: Occupation numbers, shape (L, M, K, B).
        pseudocount: As in `histogram_probabilities`.

    Returns:
        log P_k(b | x_l, w_m), shape (L, M, K, B).
    """
    counts = np.asarray(counts)
    trained = trained_classes(counts)
    log_prob = np.full(counts.shape, -np.inf)
    with np.errstate(divide="ignore"):
        log_prob[trained] = np.log(histogram_probabilities(counts[trained], pseudocount))
    return log_prob


def log_flat_prior(trained: ArrayLike) -> NDArray[np.float64]:
    """Log belief before the first tap, the same for all trained classes, shape (L, M); text below Eq. 3."""
    trained = np.asarray(trained, dtype=bool)
    return np.where(trained, -np.log(trained.sum()), -np.inf)


def histogram_probabilities(counts: ArrayLike, pseudocount: float = 0.01) -> NDArray[np.float64]:
    """Sample distribution P_k(s | c) over the bins; Eq. 2.

    Args:
        counts: Occupation numbers h_k(b), bins on the last axis.
        pseudocount: Added to every bin before normalising, in counts. 0 is the equation as printed.

    Returns:
        Probabilities that sum to one over the last axis, the shape of `counts`.

    Raises:
        ValueError: A count or the pseudocount is negative, or a histogram is empty while the pseudocount is 0.
    """
    occupation = np.asarray(counts, dtype=np.float64) + pseudocount
    if not (pseudocount >= 0 and np.all(occupation >= pseudocount)):
        raise ValueError("Counts and pseudocount must not be negative.")
    total = occupation.sum(axis=-1, keepdims=True)
    if np.any(total == 0):
        raise ValueError("A histogram without any sample has no distribution when the pseudocount is 0.")
    return occupation / total


def update(prior: ArrayLike, log_likelihood: ArrayLike) -> tuple[NDArray[np.float64], float]:
    """Posterior after one more tap and the log evidence of that tap; Eq. 3 and 4.

    Args:
        prior: Belief before the tap, shape (L, M).
        log_likelihood: log P(z_t | c), shape (L, M), see `tap_log_likelihood`.

    Returns:
        The posterior, shape (L, M), and log P(z_t | z_1 .. z_{t-1}).

    Raises:
        ZeroEvidenceError: No class with positive prior can have given the tap.
        ValueError: Shapes differ, or a value is NaN.
    """
    prior, log_likelihood = _pair(prior, log_likelihood)
    possible = (prior > 0) & (log_likelihood > -np.inf)
    if not possible.any():
        raise ZeroEvidenceError("The tap is impossible under every class with nonzero belief.")
    largest = log_likelihood[possible].max()
    joint = np.zeros(prior.shape)
    joint[possible] = prior[possible] * np.exp(log_likelihood[possible] - largest)
    evidence = joint.sum()
    return joint / evidence, float(np.log(evidence) + largest)


def where_marginal(belief: ArrayLike) -> NDArray[np.float64]:
    """P(x_l | z_t), shape (L,), from the joint belief, shape (L, M); Eq. 5."""
    return np.asarray(belief, dtype=np.float64).sum(axis=1)


def what_marginal(belief: ArrayLike) -> NDArray[np.float64]:
    """P(w_m | z_t), shape (M,), from the joint belief, shape (L, M); Eq. 6."""
    return np.asarray(belief, dtype=np.float64).sum(axis=0)


def what_decision(belief: ArrayLike, threshold: float) -> int | None:
    """Decided object, or `None` while no marginal exceeds the threshold theta_W; Eq. 7.

    The comparison is strict and ties go to the lowest index. A threshold of 1 or more never fires, whatever
    rounding makes of a marginal.
    """
    return _decision(what_marginal(belief), threshold)


def where_decision(belief: ArrayLike, threshold: float) -> int | None:
    """Decided position, or `None` while no marginal exceeds the threshold theta_X; Eq. 8.

    theta_X = 0 always decides (active perception), theta_X = 1 never does (passive perception).
    """
    return _decision(where_marginal(belief), threshold)


def shift(
    belief: ArrayLike, delta: int, border: Border = "uniform", trained: ArrayLike | None = None
) -> NDArray[np.float64]:
    """Belief after a move of the sensor by `delta` positions; Eq. 9.

    Belief about class l becomes belief about l + delta. The paper assumes what falls outside the range to be
    "uniformly distributed", and that every object was trained at every position. Here belief is lost if it would land
    outside the range or on an untrained class of its object, and trained classes that receive none are vacated. Of each
    object as many classes are vacated as lose their belief. The readings are

    - `"uniform"`: the lost belief is spread evenly over all vacated classes, all objects alike;
    - `"uniform_what"`: the same for each object apart, which keeps the what marginal;
    - `"prior"`: vacated classes get 1 over the number of trained classes, then everything is normalised;
    - `"clamp"`: positions beyond the end count as the end class, as for a sensor that stops there, and belief goes to
      the nearest trained position of its object, the lower of two equally near;
    - `"circular"`: belief comes in at the other end; what would land on untrained classes goes to the vacated ones of
      its object, both in order of position.

    Args:
        belief: Joint belief, shape (L, M), 0 in untrained classes.
        delta: Where classes moved, any whole number.
        border: One of the readings above.
        trained: Which classes belief may be in, shape (L, M); default all.

    Returns:
        The shifted belief, shape (L, M), sum one.

    Raises:
        ValueError: The border is unknown, or there is belief in an untrained class.
    """
    belief = np.asarray(belief, dtype=np.float64)
    _check_border(border)
    trained = _trained(trained, belief > 0)
    shifted, lost, vacated = np.zeros(belief.shape), np.zeros(belief.shape[1]), trained.copy()
    for m in range(belief.shape[1]):
        for l, target in _targets(trained[:, m], int(delta), border):
            if target is None:
                lost[m] += belief[l, m]
            else:
                shifted[target, m] += belief[l, m]
                vacated[target, m] = False
    if vacated.any():
        if border == "uniform":
            shifted[vacated] = lost.sum() / vacated.sum()
        if border == "uniform_what":
            shifted = np.where(vacated, lost / np.maximum(vacated.sum(axis=0), 1), shifted)
        if border == "prior":
            shifted[vacated] = 1.0 / trained.sum()
    return shifted / shifted.sum()


def fixation_move(where_index: int, fixation_index: int) -> int:
    """Move Delta(x_MAP) = x_fixed - x_MAP in positions; Eq. 10."""
    return fixation_index - where_index


def update_log(log_prior: ArrayLike, log_likelihood: ArrayLike) -> tuple[NDArray[np.float64], float]:
    """`update` for log beliefs, for sequences of any length; Eq. 3 and 4.

    Args:
        log_prior: Log belief before the tap, shape (L, M).
        log_likelihood: log P(z_t | c), shape (L, M).

    Returns:
        The log posterior, shape (L, M), and log P(z_t | z_1 .. z_{t-1}).

    Raises:
        ZeroEvidenceError: Every class is impossible.
        ValueError: Shapes differ, or a value is NaN.
    """
    log_prior, log_likelihood = _pair(log_prior, log_likelihood)
    log_joint = log_prior + log_likelihood
    log_evidence = float(_log_sum(log_joint))
    if log_evidence == -np.inf:
        raise ZeroEvidenceError("The tap is impossible under every class with nonzero belief.")
    return log_joint - log_evidence, log_evidence


def shift_log(
    log_belief: ArrayLike, delta: int, border: Border = "uniform", trained: ArrayLike | None = None
) -> NDArray[np.float64]:
    """`shift` for log beliefs; Eq. 9.

    Args:
        log_belief: Log of the joint belief, shape (L, M), -inf in untrained classes.
        delta: Where classes moved.
        border: As in `shift`.
        trained: As in `shift`.

    Returns:
        The shifted log belief, shape (L, M).

    Raises:
        ValueError: As `shift`.
    """
    log_belief = np.asarray(log_belief, dtype=np.float64)
    _check_border(border)
    trained = _trained(trained, log_belief > -np.inf)
    shifted, lost = np.full(log_belief.shape, -np.inf), np.full(log_belief.shape[1], -np.inf)
    vacated = trained.copy()
    for m in range(log_belief.shape[1]):
        for l, target in _targets(trained[:, m], int(delta), border):
            if target is None:
                lost[m] = np.logaddexp(lost[m], log_belief[l, m])
            else:
                shifted[target, m] = np.logaddexp(shifted[target, m], log_belief[l, m])
                vacated[target, m] = False
    if vacated.any():
        if border == "uniform":
            shifted[vacated] = _log_sum(lost) - np.log(vacated.sum())
        if border == "uniform_what":
            shifted = np.where(vacated, lost - np.log(np.maximum(vacated.sum(axis=0), 1)), shifted)
        if border == "prior":
            shifted[vacated] = -np.log(trained.sum())
    return shifted - _log_sum(shifted)


def saturated(log_belief: ArrayLike, taps: int, limit: float) -> NDArray[np.float64]:
    """Belief after some taps with their evidence capped at `limit` taps; not in the paper.

    The belief to the power min(1, limit / taps), normalised.

    Args:
        log_belief: Shape (L, M).
        taps: Taps so far, at least 1.
        limit: Above 0; infinity for none.

    Returns:
        The log belief that is read, shape (L, M).
    """
    raised = min(1.0, limit / taps) * np.asarray(log_belief, dtype=np.float64)
    return raised - _log_sum(raised)


def _check_border(border: str) -> None:
    if border not in BORDERS:
        raise ValueError(f"border must be one of {', '.join(BORDERS)}, got {border!r}.")


def _trained(trained: ArrayLike | None, believed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mask of the classes that may have belief."""
    trained = np.ones(believed.shape, dtype=bool) if trained is None else np.asarray(trained, dtype=bool)
    if trained.shape != believed.shape or (believed & ~trained).any():
        raise ValueError(
            f"Belief of shape {believed.shape} must be zero outside the trained classes of shape {trained.shape}."
        )
    return trained


def _targets(trained: NDArray[np.bool_], delta: int, border: str) -> list[tuple[int, int | None]]:
    """Each trained position of one object and the position that its belief moves to, `None` if it is lost."""
    L, places = len(trained), np.flatnonzero(trained)
    targets: dict[int, int | None] = {}
    for l in places.tolist():
        target = l + delta
        if border == "circular":
            target %= L
        if border == "clamp":
            end = min(max(target, 0), L - 1)
            target = int(places[np.argmin(np.abs(places - end))])
        targets[l] = target if 0 <= target < L and trained[target] else None
    if border == "circular":
        lost = [l for l in targets if targets[l] is None]
        vacated = [l for l in targets if l not in targets.values()]
        targets.update(zip(lost, vacated, strict=True))
    return list(targets.items())


def _decision(marginal: NDArray[np.float64], threshold: float) -> int | None:
    best = int(np.argmax(marginal))
    return best if threshold < 1 and marginal[best] > threshold else None


def _log_sum(log_values: NDArray[np.float64]) -> np.float64:
    return np.logaddexp.reduce(log_values.ravel())


def _pair(belief: ArrayLike, log_likelihood: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    belief = np.asarray(belief, dtype=np.float64)
    log_likelihood = np.asarray(log_likelihood, dtype=np.float64)
    if belief.shape != log_likelihood.shape:
        raise ValueError(f"Belief has shape {belief.shape}, log-likelihood {log_likelihood.shape}.")
    if np.isnan(belief).any() or np.isnan(log_likelihood).any() or np.isposinf(log_likelihood).any():
        raise ValueError("Belief and log-likelihood must hold no NaN, and the log-likelihood no +inf.")
    return belief, log_likelihood
