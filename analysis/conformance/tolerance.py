"""Tolerances of answers, and answers allowed where rounding decides.

Errors of floating point grow with what has to be added up, so the tolerance of a case does.
"""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .answers import Answer
from .case import Case

type Precision = Literal["double", "single"]

_ROUNDING = {"double": float(np.finfo(np.float64).eps), "single": float(np.finfo(np.float32).eps)}
_LEAST = {"double": 1e-10, "single": 1e-4}
_LARGEST = 1e-2  # a tolerance above this one tells nothing
_STEPS = 64  # roundings of the size of the whole sum
_STEEP = 10.0  # information changes at most this much faster than belief, but for taps that hardly ever come
_TINY = float(np.finfo(np.float32).tiny)


class Tolerance(NamedTuple):
    """How much a number may differ from the exact one: absolute plus relative times its size."""

    absolute: float
    relative: float


def tolerances(case: Case, expected: list[Answer], precision: Precision) -> dict[str, Tolerance]:
    """The tolerance of each quantity of a case.

    Args:
        case: The case.
        expected: Its right answers.
        precision: Of the program's numbers.
    """
    if case.pinned is not None:
        return {name: Tolerance(*bounds) for name, bounds in case.pinned.tolerances.items()}
    least, rounding = _LEAST[precision], _ROUNDING[precision]
    belief = Tolerance(max(least, _STEPS * rounding * _added(case, expected)), 0.0)
    terms = case.sizes["J"] * case.sizes["K"]
    sums = Tolerance(least, max(least, _STEPS * rounding * terms))
    table = Tolerance(least, least)
    more = {"information": Tolerance(_STEEP * belief.absolute, 0.0)} if case.strategy else {}
    return more | {
        "edges": table,
        "counts": Tolerance(0.0, 0.0),
        "log_likelihood": sums,
        "log_evidence": Tolerance(belief.absolute, sums.relative),
        "posterior": belief,
        "log_posterior": Tolerance(belief.absolute, sums.relative),
        "where": belief,
        "what": belief,
    }


def _added(case: Case, expected: list[Answer]) -> float:
    """The sum of the largest logarithms of each tap, as far as answers tell, and of the prior."""
    sizes = [np.abs(a.values["log_likelihood"]) for a in expected if "log_likelihood" in a.values]
    largest = [size[np.isfinite(size)].max(initial=0.0) for size in sizes]
    whole = float(np.mean(largest)) * len(case.taps) if largest else 0.0
    return whole - float(np.log(case.prior[case.prior > 0].min(initial=1.0)))


def needs_double(case: Case, expected: list[Answer]) -> str:
    """Why 32-bit arithmetic cannot do a case, in a phrase; empty if it can."""
    if case.pinned is not None:
        return case.pinned.left_out
    if tolerances(case, expected, "single")["posterior"].absolute > _LARGEST:
        return "the logarithms to be added are too large"
    if ((case.prior > 0) & (case.prior < _TINY)).any():
        return "a prior is too small"
    if case.probabilities is not None and ((case.probabilities > 0) & (case.probabilities < _TINY)).any():
        return "a probability is too small"
    if case.edges is not None and not _same_bins(case.taps, case.edges):
        return "samples lie nearer to bin edges than it can tell"
    return ""


def _same_bins(taps: NDArray[np.float64], edges: NDArray[np.float64]) -> bool:
    """Whether rounding samples and edges leaves every sample on its side of every edge."""
    K = taps.shape[2]
    rows = np.broadcast_to(edges, (K, edges.shape[-1]))
    narrow = rows.astype(np.float32)
    if not (np.diff(narrow) > 0).all():
        return False
    low, high = float(narrow.min()) - 1.0, float(narrow.max()) + 1.0
    return all(
        np.array_equal(
            np.searchsorted(rows[k], taps[..., k], side="right"),
            np.searchsorted(narrow[k], np.clip(taps[..., k], low, high).astype(np.float32), side="right"),
        )
        for k in range(K)
    )


def allowed_decisions(case: Case, answer: Answer, tolerance: Tolerance) -> list[set[int]]:
    """The decisions that pass at each threshold; -1 is none."""
    if answer.allowed is not None:
        return answer.allowed.decisions
    what, right = answer.values["what"], answer.values["decisions"].tolist()
    return [
        {index} if case.strict_ties else {index} | _allowed(what, theta, tolerance.absolute)
        for theta, index in zip(case.thresholds, right, strict=True)
    ]


def allowed_moves(case: Case, answer: Answer, tolerance: Tolerance) -> set[int]:
    """The own moves that pass."""
    if answer.allowed is not None:
        return answer.allowed.moves
    right = {int(answer.values["move"])}
    if case.strict_ties:
        return right
    if "information" in answer.values:
        information, here = answer.values["information"], int(answer.values["where"].argmax())
        near = information >= information.max() - 2 * _STEEP * tolerance.absolute
        return right | {index - here for index in np.flatnonzero(near).tolist()}
    indices = _allowed(answer.values["where"], case.theta_x, tolerance.absolute)
    return right | {0 if index < 0 else case.fixation - index for index in indices}


def _allowed(marginal: NDArray[np.float64], threshold: float, tolerance: float) -> set[int]:
    """Indices whose belief is as good as the largest, and -1, where the threshold is as good as reached or not."""
    largest = float(marginal.max())
    near = set(np.flatnonzero(marginal >= largest - tolerance).tolist())
    may = threshold < 1 and largest > threshold - tolerance
    may_not = threshold >= 1 or largest <= threshold + tolerance
    return (near if may else set()) | ({-1} if may_not else set())
