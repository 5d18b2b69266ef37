"""Variance of the evidence of taps: within and between sessions, by position or order, and by permutation."""

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ....models import seeds
from ....models.taps import TapSet
from ...stats.evidence import Evidence
from .classes import EvidenceClass, centred, evidence_classes, orthonormal, rank_in_session
from .sample_covariance import by_step, slope, taxel_pairs

_LEAST_STEP = 0.02  # of a gain or a shift in time, for the response to one that is hardly there


class EvidenceMoments(NamedTuple):
    """Variances of the evidence of each class, per tap; stacked over C classes.

    Attributes:
        session: Between sessions.
        serial: What two taps of one session share beyond that, on average.
        covariates: What place or order add beyond what they do to single samples.
        suspects: The same of each named suspect, beyond place or order and the suspects before it, shape (C, suspects).
        whole: Within sessions.
        independent: The same if samples were independent.
        excess: What their covariance within and across taxels adds to the latter.
        spread: Within halves, whatever the session.
        patterns: What each pattern at variance 1 adds, by the response of evidence, shape (C, P).
        noise: The same for noise at each step of lags, shape (C, S).
    """

    session: NDArray[np.float64]
    serial: NDArray[np.float64]
    covariates: NDArray[np.float64]
    suspects: NDArray[np.float64]
    whole: NDArray[np.float64]
    independent: NDArray[np.float64]
    excess: NDArray[np.float64]
    spread: NDArray[np.float64]
    patterns: NDArray[np.float64]
    noise: NDArray[np.float64]


def responses_to(
    evidence: Evidence, samples: NDArray[np.float64], sizes: NDArray[np.float64]
) -> list[dict[int, NDArray[np.float64]]]:
    """How the evidence of each class answers to a gain, a shift in time, former taps and an offset of these sizes."""
    gain, timing, lingering, offset = sizes
    former = np.broadcast_to((samples - samples[:, :1]).mean(axis=1, keepdims=True), samples.shape)
    ways = [
        (samples, max(gain, _LEAST_STEP)),
        (slope(samples), max(timing, _LEAST_STEP)),
        (former, max(lingering, _LEAST_STEP)),
        (np.ones_like(samples), offset or 1.0),
    ]
    responses = [evidence.judge.response(samples, way, float(step)) for way, step in ways]
    return [dict(zip(classes.tolist(), response, strict=True)) for classes, response in responses]


def evidence_moments(
    one: EvidenceClass,
    values: NDArray[np.float64],
    responses: list[NDArray[np.float64]],
    steps: NDArray[np.intp],
) -> EvidenceMoments:
    """The variances of one class's evidence, values (n, J, K)."""
    n = len(values)
    strata = int(one.stratum.max()) + 1
    within = centred(values.reshape(n, -1), one.stratum)
    whole, single = _variances(within, n - strata)
    by_steps = [one.without(values, one.stratum, suspects) for suspects in range(len(one.suspects) + 1)]
    shared = np.array([left - alone for left, alone in (_variances(*step) for step in by_steps)])
    residual = by_steps[-1][0]
    total = values.sum(axis=(1, 2))
    session, serial = SharedEvidence.of(one).variances(total, _variances(*by_steps[0])[0])
    spread = spread_within_halves(one, total)
    live = (residual**2).sum(axis=0) > 0
    *to_patterns, to_offset = (response * live for response in responses)
    across, same = taxel_pairs(to_offset)
    np.fill_diagonal(same, 0.0)
    noise = by_step(same, steps)
    patterns = np.concatenate([[_pattern_excess(pattern) for pattern in to_patterns], by_step(across, steps) + noise])
    return EvidenceMoments(
        session=np.array(session),
        serial=np.array(serial),
        covariates=np.array(whole - single - shared[0]),
        suspects=-np.diff(shared),
        whole=np.array(whole),
        independent=np.array(single),
        excess=np.array(shared[-1]),
        spread=np.array(spread),
        patterns=patterns,
        noise=noise,
    )


def _variances(residual: NDArray[np.float64], freedom: int) -> tuple[float, float]:
    """Of the evidence of a tap, and the sum of those of its samples, from residuals (n, J, K) or (n, J K)."""
    flat = residual.reshape(len(residual), -1)
    return float((flat.sum(axis=1) ** 2).sum()) / freedom, float((flat**2).sum()) / freedom


def _pattern_excess(response: NDArray[np.float64]) -> float:
    """What a pattern of variance 1 adds to the variance of a sum beyond what it adds to single variances."""
    return float(response.sum() ** 2 - (response**2).sum())


class SharedEvidence(NamedTuple):
    """How to read from the evidence of one class what taps of a session share.

    Attributes:
        left: Projection that takes out means of halves and what the columns explain, shape (n, n).
        forms: Masks of pairs of taps of one session and half, far apart and near, shape (2, n, n).
        expected: What a variance of 1 between sessions gives over these pairs; 0 where it gives nothing.
        near: Share of the pairs of a session that are near.
    """

    left: NDArray[np.float64]
    forms: NDArray[np.bool_]
    expected: NDArray[np.float64]
    near: float

    @classmethod
    def of(cls, one: EvidenceClass, half: int | None = None) -> Self:
        """That of a class, or of one of its halves."""
        n = len(one.members)
        same = (one.session[:, None] == one.session) & ~np.eye(n, dtype=bool)
        rank = rank_in_session(one.session)
        far = 4 * np.abs(rank[:, None] - rank) >= np.bincount(one.session)[one.session][:, None]
        # Either half of the training session is judged by the other one, which makes their evidence alike.
        judged_alike = same & (one.half[:, None] == one.half)
        if half is not None:
            judged_alike &= one.half == half
        forms = np.stack([judged_alike & far, judged_alike & ~far])
        basis = orthonormal(np.concatenate([np.eye(2)[one.half], one.columns], axis=1))
        left = np.eye(n) - basis @ basis.T
        member = left @ np.eye(int(one.session.max()) + 1)[one.session]
        expected = (member @ member.T * forms).sum(axis=(1, 2))
        near = float((same & ~far).sum() / max(same.sum(), 1))
        return cls(left, forms, np.where(expected > 1e-6 * n, expected, 0.0), near)

    def variances(self, total: NDArray[np.float64], within: float) -> tuple[float, float]:
        """What taps far apart share, and what any two share beyond that on average, by evidence (n,).

        Taps are far apart if a quarter of the taps of their class and session or more lie between them. 0 where no
        session has two taps or there is one session.
        """
        residual = self.left @ total
        products = ((np.outer(residual, residual) - within * self.left) * self.forms).sum(axis=(1, 2))
        shared = np.divide(products, self.expected, out=np.zeros(2), where=self.expected > 0)
        return float(shared[0]), float(self.near * (shared[1] - shared[0])) if self.expected.all() else 0.0

    def permuted(
        self, total: NDArray[np.float64], groups: NDArray[np.intp], within: float, permutations: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """What taps far apart share if evidence is permuted within groups, by random keys (R, n); shape (R,)."""
        if not self.expected[0]:
            return np.zeros(len(permutations))
        values = _permuted(total, groups, permutations)
        form = self.left @ self.forms[0] @ self.left
        constant = within * float((self.left * self.forms[0]).sum())
        return (np.einsum("ri,ij,rj->r", values, form, values, optimize=True) - constant) / self.expected[0]


def session_p(taps: TapSet, evidence: Evidence, permutations: int = 999, seed: int = 0) -> float:
    """The probability under no difference between sessions of what taps of one session share, by permutation.

    Evidence is exchanged between taps of one class, half and place, or rank in the session, and otherwise of one class
    and half. The halves of the training session judge each other, so each half is tested by itself and the smaller
    p-value doubled. NaN where nothing can be seen.
    """
    classes, _ = evidence_classes(taps, evidence)
    p = [_half_p(taps, evidence, classes, h, permutations, seed) for h in (0, 1)]
    seen = [value for value in p if np.isfinite(value)]
    return min(1.0, len(seen) * min(seen)) if seen else np.nan


def covariate_p(classes: list[EvidenceClass], evidence: Evidence, seed: int, permutations: int = 999) -> float:
    """The probability of what place or order explains if it explained nothing, by permutation within strata.

    The statistic is the sum over classes of the variance explained over that of evidence. NaN where there is none.
    """
    generator = seeds.generator(seed, seeds.Purpose.COVARIATE)
    statistic, seen = np.zeros(permutations + 1), False
    for one in classes:
        basis = orthonormal(centred(one.columns, one.stratum))
        if not basis.shape[1]:
            continue
        seen, total = True, evidence.values[one.members].sum(axis=(1, 2))
        keys = np.concatenate([np.zeros((1, len(total))), generator.random((permutations, len(total)))])
        values = _permuted(total, one.stratum, keys)
        statistic += ((values @ basis) ** 2).sum(axis=1) / spread_within_halves(one, total)
    return float((1 + np.count_nonzero(statistic[1:] >= statistic[0])) / (1 + permutations)) if seen else np.nan


def _half_p(
    taps: TapSet, evidence: Evidence, classes: list[EvidenceClass], half: int, permutations: int, seed: int
) -> float:
    generator = seeds.generator(seed, seeds.Purpose.HALVES, half)
    statistic, seen = np.zeros(permutations + 1), False
    for one in classes:
        shared, total = SharedEvidence.of(one, half), evidence.values[one.members].sum(axis=(1, 2))
        if not shared.expected[0]:
            continue
        seen, within = True, spread_within_halves(one, total)
        groups = _exchangeable(one, taps.where[evidence.tap][one.members])
        keys = np.concatenate([np.zeros((1, len(total))), generator.random((permutations, len(total)))])
        statistic += shared.permuted(total, groups, within, keys) / within
    return float((1 + np.count_nonzero(statistic[1:] >= statistic[0])) / (1 + permutations)) if seen else np.nan


def _permuted(values: NDArray[np.float64], groups: NDArray[np.intp], keys: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values (n,) in the order of each row of keys (R, n), from 0 to 1, within their groups, shape (R, n).

    A row of zeros leaves them in place.
    """
    order = np.argsort(groups, kind="stable")
    result = np.empty(keys.shape)
    result[:, order] = values[np.argsort(groups + keys, axis=-1)]  # half the time of sorting by two keys
    result[~keys.any(axis=-1)] = values
    return result


def spread_within_halves(one: EvidenceClass, total: NDArray[np.float64]) -> float:
    """Variance of evidence of one class within its halves, whatever the session."""
    residual, freedom = one.without(total[:, None], one.half)
    return max(float((residual**2).sum()) / freedom, 1e-300)


def _exchangeable(one: EvidenceClass, place: NDArray[np.float64]) -> NDArray[np.intp]:
    """Groups of taps that differ in session only, so far as sessions repeat places or ranks."""
    _, at = np.unique(place, return_inverse=True)
    if at.max() == 0:
        at = rank_in_session(one.session)
    _, groups, count = np.unique(one.half * (at.max() + 1) + at, return_inverse=True, return_counts=True)
    return groups if (count > 1).mean() > 0.5 else one.half
