"""What makes the evidence of taps vary more than independent samples would: its variance, split by cause.

Evidence is the log-likelihood ratio of a tap for its own class against the nearest rival (see `evidence`). Were its
J K samples independent given the class, its variance would be the sum of theirs, and over n taps n times that. What
comes on top is split in this order:

1. `session`: the covariance of the taps of one class and session that lie far apart in it. All taps of a sequence share
   it, so over n taps it counts n squared times. What neighbours share beyond that goes to `order`.
2. `place`: what goes with the position of a tap inside its class, whatever its form where sessions repeat positions,
   else as a parabola. Where positions do not vary, what goes with the order of taps in their session is part of
   `order`.
3. What is left of the covariance of samples is split by what the samples themselves say. Their covariance across
   different taxels is regressed on that of a common gain (`gain`: the mean tap times a number, and a constant level of
   that share in each taxel, which a high-pass makes of the strength of former taps), a common shift in time (`timing`:
   its derivative) and a common disturbance (`common`: the same in all taxels, any autocorrelation); the
   covariance within taxels that these leave is autocorrelated noise of single taxels (`noise`). These variances are
   turned into those of evidence by its measured response to a gain, a shift and an offset of that size, and brought to
   the sum that is observed, by a factor of three at most. `rest` is what remains.

Regressing products on products is the method of moments for variance components (Searle, Casella and McCulloch,
"Variance Components", 1992, ch. 4); intervals come from resampling classes.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Self

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..models.taps import TapSet
from .evidence import Evidence
from .metrics import CONFIDENCE

CAUSES = {
    "session": "sessions differ",
    "place": "the position inside a class varies",
    "order": "taps drift within a session",
    "gain": "taps differ in strength",
    "timing": "taps differ in timing",
    "common": "taxels share noise",
    "noise": "the noise of a taxel lasts from sample to sample",
}
"""Causes by name, in words."""
PART_WORDS = {
    "independent": "independent samples",
    **CAUSES,
    "serial": "neighbouring taps have more in common than distant ones",
    "rest": "what is left",
}
"""Parts of the variance of evidence in words: what independent samples would have, the causes, and the rest."""
PARTS = tuple(PART_WORDS)
SIZES = ("design_effect", "sequence_effect", "gain_sd", "timing_sd", "common_sd", "noise_sd", "lasting_sd")
"""Further quantities, see `split_variance`."""
SEQUENCE = 10
"""Taps of the sequence whose evidence is split."""
LEAST_SHARE = 0.05
"""Share of the variance below which a cause is not named."""
FEWEST_CLASSES = 4
"""Classes below which resampling them says nothing sure: with two, one data set in six names a cause where none is."""
_SURE = 0.99  # of the intervals by which a cause is named: there are seven causes
_RESAMPLES = 400
_LAGS = (0, 1, 2, 3, 5, 9, 17, 33, 65, 129, 257)  # first lag of each step of an autocovariance
_LEAST_STEP = 0.02  # of a gain or a shift in time, for the response to one that is hardly there
_LEAST_FREEDOM = 3
_ROUNDING = 1e-9  # of evidence
_WITHIN = ("gain", "timing", "common", "noise")  # causes that act within a tap
_MOST_CORRECTION = 3.0  # of what the linear response of evidence predicts
_GAIN, _TIMING, _FORMER = 0, 1, 2
_PATTERNS = 3  # those that are not a common disturbance


class _Class(NamedTuple):
    """The taps of one class.

    Attributes:
        number: Of the class.
        members: Which taps, in recorded order, shape (n,).
        stratum: Session and half of each, shape (n,).
        session: Session of each, from 0, shape (n,).
        half: Shape (n,).
        columns: What place or order can explain, shape (n, q).
    """

    number: int
    members: NDArray[np.intp]
    stratum: NDArray[np.intp]
    session: NDArray[np.intp]
    half: NDArray[np.intp]
    columns: NDArray[np.float64]

    def without(self, values: NDArray[np.float64], groups: NDArray[np.intp]) -> tuple[NDArray[np.float64], int]:
        """Values (n, ...) without the means of groups and what the columns explain, and the freedom that is left."""
        basis = _orthonormal(_centred(self.columns, groups))
        flat = _centred(values.reshape(len(values), -1), groups)
        residual = (flat - basis @ (basis.T @ flat)).reshape(values.shape)
        return residual, len(values) - int(groups.max()) - 1 - basis.shape[1]


class _Samples(NamedTuple):
    """What the samples of each class say of their covariance; stacked over C classes.

    Patterns are gain, timing, the level that former taps leave, and a common disturbance at each of S steps of lags.

    Attributes:
        normal: Products of the patterns across taxels, shape (C, P, P).
        right: Products of the patterns with the observed covariance, shape (C, P).
        lagged: Observed covariance within taxels, summed at each step of lags, shape (C, S).
        pairs: Number of pairs of samples there, shape (C, S).
        patterns_within: What each pattern at variance 1 adds to that covariance, shape (C, P, S).
    """

    normal: NDArray[np.float64]
    right: NDArray[np.float64]
    lagged: NDArray[np.float64]
    pairs: NDArray[np.float64]
    patterns_within: NDArray[np.float64]

    def solve(self, weight: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Variances of the patterns, shape (P,), and of noise at each step of lags, (S,), with weights of classes."""
        normal, right, lagged, pairs, within = (np.tensordot(weight, part, 1) for part in self)
        theta = _least_squares(normal, right)
        left = lagged - theta @ within
        return theta, np.divide(left, pairs, out=np.zeros_like(left), where=pairs > 0)


class _Values(NamedTuple):
    """Variances of the evidence of each class, per tap; stacked over C classes.

    Attributes:
        session: Between sessions.
        serial: What two taps of one session share beyond that, on average.
        covariates: What place or order add beyond what they do to single samples.
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
    whole: NDArray[np.float64]
    independent: NDArray[np.float64]
    excess: NDArray[np.float64]
    spread: NDArray[np.float64]
    patterns: NDArray[np.float64]
    noise: NDArray[np.float64]


def split_variance(
    taps: TapSet, evidence: Evidence, seed: int = 0, n: int = SEQUENCE, resamples: int = _RESAMPLES
) -> xr.Dataset:
    """The variance of the evidence of n taps by cause.

    Args:
        taps: Those of the evidence, with sessions that are numbered apart.
        evidence: Of these taps.
        seed: Of the resampling of classes.
        n: Taps of a sequence, of one class and session.
        resamples: How many.

    Returns:
        Over `part` (see `PARTS`): `share` of the variance of the evidence of a sequence, and `ratio`, this variance
        over that of a tap with independent samples. Further `design_effect`, the observed over the independent
        variance of a tap, the median over classes; `sequence_effect`, the same of n taps, over all classes; and
        standard deviations: `gain_sd` (relative), `timing_sd` (samples), `common_sd`, `noise_sd` and, from one sample
        to the next, `lasting_sd` (unit of the samples). Each has an interval `_low`, `_high` at 95 % and `_sure`, the
        lower end at 99 %. Without a class that has taps enough all are NaN. Attributes: `taps` n, `classes`,
        `sessions`, `covariate`, `"place"`, `"order"` or nothing, and `covariate_p`, by permutation of taps within
        halves of sessions, the probability of what it explains if it explained nothing.
    """
    samples, session = taps.taps[evidence.tap].astype(np.float64), taps.session[evidence.tap]
    classes, covariate = _classes(taps, evidence)
    if not classes:
        return _dataset(
            [dict.fromkeys(_names(), np.nan)] * 2, taps=n, classes=0, sessions=0, covariate="", covariate_p=np.nan
        )
    steps = _steps(samples.shape[1])
    C = len(classes)
    known = _stack(_Samples, [_samples_of(one, samples[one.members], steps) for one in classes])
    theta, noise = known.solve(np.full(C, 1 / C))
    sizes = np.sqrt(np.maximum([*theta[:_PATTERNS], noise[0] + theta[_PATTERNS]], 0.0))
    responses = _responses(evidence, samples, sizes)
    values = _stack(
        _Values,
        [_values_of(one, evidence.values[one.members], [r[one.number] for r in responses], steps) for one in classes],
    )
    weights = np.random.default_rng([seed, 5]).multinomial(C, np.full(C, 1 / C), size=resamples)
    results = [_combine(known, values, w / C, n, covariate) for w in [np.ones(C), *weights]]
    attributes = {
        "taps": n,
        "classes": C,
        "sessions": len(np.unique(session)),
        "covariate": covariate,
        "covariate_p": _covariate_p(classes, evidence, seed),
    }
    return _dataset(results, **attributes)


def first_cause(split: xr.Dataset, without: Sequence[str] = (), least_share: float = LEAST_SHARE) -> str | None:
    """The cause with the largest share of the variance, of those that are surely there; `None` where none is.

    With fewer classes than `FEWEST_CLASSES` only sessions are named, which a test of their own supports.

    Args:
        split: From `split_variance`.
        without: Causes that other tests do not support.
        least_share: Share below which a cause does not matter.
    """
    few = split.attrs["classes"] < FEWEST_CLASSES
    names = [name for name in CAUSES if name not in without and (name == "session" or not few)]
    if not names:
        return None
    causes = split.sel(part=names)
    share = np.where(causes["share_sure"] > 0, causes["share"], -np.inf)
    largest = int(share.argmax())
    return names[largest] if share[largest] >= least_share else None


def _classes(taps: TapSet, evidence: Evidence) -> tuple[list[_Class], str]:
    """The classes with taps enough, and whether place, order or nothing explains taps within their sessions.

    Classes whose evidence is the same for all taps are left out: they have no variance to split.
    """
    session, place = taps.session[evidence.tap], taps.where[evidence.tap]
    recorded = np.lexsort((taps.trial[evidence.tap], session))
    several = [len(np.unique(place[evidence.own == c])) for c in np.unique(evidence.own)]
    covariate = "place" if np.median(several) > 2 else "order"
    classes = []
    for c in np.unique(evidence.own):
        members = recorded[evidence.own[recorded] == c]
        half = evidence.half[members]
        numbers, index = np.unique(session[members], return_inverse=True)
        _, stratum = np.unique(index * 2 + half, return_inverse=True)
        columns = _place_columns(place[members], len(numbers)) if covariate == "place" else _order_columns(index)
        columns = np.concatenate([columns * (half == h)[:, None] for h in np.unique(half)], axis=1)
        strata = int(stratum.max()) + 1
        if len(members) - strata - np.linalg.matrix_rank(_centred(columns, stratum)) < _LEAST_FREEDOM:
            columns = columns[:, :0]
        if len(members) - strata >= _LEAST_FREEDOM and _varies(evidence.values[members].sum(axis=(1, 2)), half):
            classes.append(_Class(int(c), members, stratum, index, half, columns))
    return classes, covariate if any(one.columns.shape[1] for one in classes) else ""


def _varies(total: NDArray[np.float64], half: NDArray[np.intp]) -> bool:
    """Whether evidence (n,) differs between taps of a half by more than rounding."""
    left = _centred(total[:, None], half)
    return bool((np.abs(left) > _ROUNDING * np.abs(total).max()).any())


def _place_columns(place: NDArray[np.float64], sessions: int) -> NDArray[np.float64]:
    """Every place by itself where sessions repeat them, else a line and a parabola."""
    places, index = np.unique(place, return_inverse=True)
    if sessions > 1 and len(place) >= 2 * len(places):
        return np.eye(len(places))[index]
    x = (place - place.mean()) / (np.ptp(place) or 1.0)
    return np.stack([x, x**2], axis=1)


def _order_columns(session: NDArray[np.intp]) -> NDArray[np.float64]:
    """A line and a parabola over the order of taps in their session, and what fades by half from tap to tap."""
    rank = _rank(session).astype(np.float64)
    x = rank / max(rank.max(), 1.0)
    return np.stack([x, x**2, 0.5**rank], axis=1)


def _orthonormal(columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """An orthonormal basis of what columns span."""
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    return u[:, s > 1e-9 * max(s.max(initial=0.0), 1e-300)]


def _centred(values: NDArray[np.float64], groups: NDArray[np.intp]) -> NDArray[np.float64]:
    """Values (n, V) less the mean of their group."""
    member = np.eye(int(groups.max()) + 1)[groups]
    return values - member @ ((member.T @ values) / member.sum(axis=0)[:, None])


def _steps(J: int) -> NDArray[np.intp]:
    """The step of each lag, shape (J,)."""
    return np.searchsorted(_LAGS, np.arange(J), side="right") - 1


def _samples_of(one: _Class, samples: NDArray[np.float64], steps: NDArray[np.intp]) -> _Samples:
    """The moments of one class's samples (n, J, K)."""
    residual, freedom = one.without(samples, one.session)
    live = ((residual**2).sum(axis=0) > 0).astype(np.float64)
    mean = samples.mean(axis=0)
    patterns = np.stack([mean, _slope(mean), np.broadcast_to((mean - mean[0]).mean(axis=0), mean.shape)]) * live
    S, J = int(steps.max()) + 1, len(steps)
    normal, right = np.zeros((_PATTERNS + S, _PATTERNS + S)), np.zeros(_PATTERNS + S)
    within = np.zeros((_PATTERNS + S, S))
    across, same = _taxel_pairs(live)
    normal[_PATTERNS:, _PATTERNS:] = np.diag(_by_step(across, steps))
    within[_PATTERNS:] = np.diag(_by_step(same, steps))
    for a, pattern in enumerate(patterns):
        for b, other in enumerate(patterns):
            by_taxel = (pattern * other).sum(axis=0)
            normal[a, b] = by_taxel.sum() ** 2 - (by_taxel**2).sum()
        across, same = _taxel_pairs(pattern)
        normal[a, _PATTERNS:] = normal[_PATTERNS:, a] = _by_step(across, steps)
        within[a] = _by_step(same, steps)
        projected = np.einsum("njk,jk->nk", residual, pattern)
        right[a] = (projected.sum(axis=1) ** 2).sum() - (projected**2).sum()
    sums = residual.sum(axis=2)
    flat = residual.transpose(1, 0, 2).reshape(J, -1)
    observed_within = flat @ flat.T
    right[_PATTERNS:] = _by_step(sums.T @ sums - observed_within, steps)
    pairs = _by_step(_taxel_pairs(live)[1], steps)
    return _Samples(normal, right / freedom, _by_step(observed_within, steps) / freedom, pairs, within)


def _slope(taps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Change from sample to sample of taps (..., J, K); 0 with one sample."""
    return np.gradient(taps, axis=-2) if taps.shape[-2] > 1 else np.zeros_like(taps)


def _taxel_pairs(a: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sums over pairs of taxels of a_jk a_j'k', of different ones and of the same, each of shape (J, J)."""
    same, total = a @ a.T, a.sum(axis=1)
    return np.outer(total, total) - same, same


def _by_step(matrix: NDArray[np.float64], steps: NDArray[np.intp]) -> NDArray[np.float64]:
    """Sums of a matrix (J, J) over the pairs of times at each step of lags."""
    lag = np.abs(np.arange(len(steps))[:, None] - np.arange(len(steps)))
    return np.bincount(steps[lag].ravel(), matrix.ravel(), minlength=int(steps.max()) + 1)


def _responses(
    evidence: Evidence, samples: NDArray[np.float64], sizes: NDArray[np.float64]
) -> list[dict[int, NDArray[np.float64]]]:
    """How the evidence of each class answers to a gain, a shift in time, former taps and an offset of these sizes."""
    gain, timing, lingering, offset = sizes
    former = np.broadcast_to((samples - samples[:, :1]).mean(axis=1, keepdims=True), samples.shape)
    ways = [
        (samples, max(gain, _LEAST_STEP)),
        (_slope(samples), max(timing, _LEAST_STEP)),
        (former, max(lingering, _LEAST_STEP)),
        (np.ones_like(samples), offset or 1.0),
    ]
    responses = [evidence.judge.response(samples, way, float(step)) for way, step in ways]
    return [dict(zip(classes.tolist(), response, strict=True)) for classes, response in responses]


def _values_of(
    one: _Class,
    values: NDArray[np.float64],
    responses: list[NDArray[np.float64]],
    steps: NDArray[np.intp],
) -> _Values:
    """The variances of one class's evidence, values (n, J, K)."""
    n = len(values)
    strata = int(one.stratum.max()) + 1
    within = _centred(values.reshape(n, -1), one.stratum)
    residual, freedom = one.without(values, one.stratum)
    by_taxel = residual.sum(axis=1)
    whole = float((within.sum(axis=1) ** 2).sum()) / (n - strata)
    left = float((by_taxel.sum(axis=1) ** 2).sum()) / freedom
    single, single_left = float((within**2).sum()) / (n - strata), float((residual**2).sum()) / freedom
    total = values.sum(axis=(1, 2))
    session, serial = _Shared.of(one).variances(total, left)
    spread = _spread(one, total)
    live = (residual**2).sum(axis=0) > 0
    *to_patterns, to_offset = (response * live for response in responses)
    across, same = _taxel_pairs(to_offset)
    np.fill_diagonal(same, 0.0)
    noise = _by_step(same, steps)
    patterns = np.concatenate([[_pattern_excess(pattern) for pattern in to_patterns], _by_step(across, steps) + noise])
    return _Values(
        session=np.array(session),
        serial=np.array(serial),
        covariates=np.array(whole - left - (single - single_left)),
        whole=np.array(whole),
        independent=np.array(single),
        excess=np.array(left - single_left),
        spread=np.array(spread),
        patterns=patterns,
        noise=noise,
    )


def _pattern_excess(response: NDArray[np.float64]) -> float:
    """What a pattern of variance 1 adds to the variance of a sum beyond what it adds to single variances."""
    return float(response.sum() ** 2 - (response**2).sum())


class _Shared(NamedTuple):
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
    def of(cls, one: _Class, half: int | None = None) -> Self:
        """That of a class, or of one of its halves."""
        n = len(one.members)
        same = (one.session[:, None] == one.session) & ~np.eye(n, dtype=bool)
        rank = _rank(one.session)
        far = 4 * np.abs(rank[:, None] - rank) >= np.bincount(one.session)[one.session][:, None]
        # Either half of the training session is judged by the other one, which makes their evidence alike.
        judged_alike = same & (one.half[:, None] == one.half)
        if half is not None:
            judged_alike &= one.half == half
        forms = np.stack([judged_alike & far, judged_alike & ~far])
        basis = _orthonormal(np.concatenate([np.eye(2)[one.half], one.columns], axis=1))
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
    classes, _ = _classes(taps, evidence)
    p = [_half_p(taps, evidence, classes, h, permutations, seed) for h in (0, 1)]
    seen = [value for value in p if np.isfinite(value)]
    return min(1.0, len(seen) * min(seen)) if seen else np.nan


def _covariate_p(classes: list[_Class], evidence: Evidence, seed: int, permutations: int = 999) -> float:
    """The probability of what place or order explains if it explained nothing, by permutation within strata.

    The statistic is the sum over classes of the variance explained over that of evidence. NaN where there is none.
    """
    generator = np.random.default_rng([seed, 9])
    statistic, seen = np.zeros(permutations + 1), False
    for one in classes:
        basis = _orthonormal(_centred(one.columns, one.stratum))
        if not basis.shape[1]:
            continue
        seen, total = True, evidence.values[one.members].sum(axis=(1, 2))
        keys = np.concatenate([np.zeros((1, len(total))), generator.random((permutations, len(total)))])
        values = _permuted(total, one.stratum, keys)
        statistic += ((values @ basis) ** 2).sum(axis=1) / _spread(one, total)
    return float((1 + np.count_nonzero(statistic[1:] >= statistic[0])) / (1 + permutations)) if seen else np.nan


def _permuted(values: NDArray[np.float64], groups: NDArray[np.intp], keys: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values (n,) in the order of each row of keys (R, n) within their groups, shape (R, n)."""
    order = np.argsort(groups, kind="stable")
    result = np.empty(keys.shape)
    result[:, order] = values[np.lexsort((keys, np.broadcast_to(groups, keys.shape)), axis=-1)]
    return result


def _half_p(taps: TapSet, evidence: Evidence, classes: list[_Class], half: int, permutations: int, seed: int) -> float:
    generator = np.random.default_rng([seed, 6, half])
    statistic, seen = np.zeros(permutations + 1), False
    for one in classes:
        shared, total = _Shared.of(one, half), evidence.values[one.members].sum(axis=(1, 2))
        if not shared.expected[0]:
            continue
        seen, within = True, _spread(one, total)
        groups = _exchangeable(one, taps.where[evidence.tap][one.members])
        keys = np.concatenate([np.zeros((1, len(total))), generator.random((permutations, len(total)))])
        statistic += shared.permuted(total, groups, within, keys) / within
    return float((1 + np.count_nonzero(statistic[1:] >= statistic[0])) / (1 + permutations)) if seen else np.nan


def _spread(one: _Class, total: NDArray[np.float64]) -> float:
    """Variance of evidence of one class within its halves, whatever the session."""
    residual, freedom = one.without(total[:, None], one.half)
    return max(float((residual**2).sum()) / freedom, 1e-300)


def _exchangeable(one: _Class, place: NDArray[np.float64]) -> NDArray[np.intp]:
    """Groups of taps that differ in session only, so far as sessions repeat places or ranks."""
    _, at = np.unique(place, return_inverse=True)
    if at.max() == 0:
        at = _rank(one.session)
    _, groups, count = np.unique(one.half * (at.max() + 1) + at, return_inverse=True, return_counts=True)
    return groups if (count > 1).mean() > 0.5 else one.half


def _rank(session: NDArray[np.intp]) -> NDArray[np.intp]:
    """The number of each tap in its session, from 0."""
    rank = np.zeros(len(session), dtype=np.intp)
    for s in np.unique(session):
        rank[session == s] = np.arange(np.count_nonzero(session == s))
    return rank


def _combine(known: _Samples, values: _Values, weight: NDArray[np.float64], n: int, covariate: str) -> dict[str, float]:
    """All quantities under weights of classes."""
    theta, noise = known.solve(weight)
    # In units of the variance of each class, so that classes count alike.
    scale = weight / values.spread
    session, serial, explained, whole, independent, excess, _, patterns, lasting = (
        np.tensordot(scale, part, 1) for part in values
    )
    # Taps that share less than nothing by chance cannot take away more than the variance that there is.
    shared = n * session + (n - 1) * serial
    kept = min(1.0, (1 - 1 / n) * whole / -shared) if shared < 0 else 1.0
    session, serial = kept * session, kept * serial
    parts = {
        "independent": independent,
        "session": n * session,
        "place": explained if covariate == "place" else 0.0,
        "order": explained if covariate == "order" else 0.0,
        "serial": (n - 1) * serial,
        "gain": patterns[_GAIN] * theta[_GAIN] + patterns[_FORMER] * theta[_FORMER],
        "timing": patterns[_TIMING] * theta[_TIMING],
        "common": patterns[_PATTERNS:] @ theta[_PATTERNS:],
        "noise": lasting @ noise,
    }
    # Evidence answers to large disturbances otherwise than to small ones, so their sizes give proportions only.
    predicted = sum(max(parts[name], 0.0) for name in _WITHIN)
    correction = min(max(excess, 0.0) / predicted, _MOST_CORRECTION) if predicted > 0 else 0.0
    parts |= {name: correction * max(parts[name], 0.0) for name in _WITHIN}
    parts["rest"] = excess - correction * predicted
    total = max(whole + n * session + (n - 1) * serial, 1e-300)
    ratio = values.whole / np.maximum(values.independent, 1e-300)
    result = {f"share {name}": value / total for name, value in parts.items()}
    result |= {f"ratio {name}": value / independent for name, value in parts.items()}
    result |= {"design_effect": _median(ratio, weight), "sequence_effect": total / independent}
    variances = (theta[_GAIN], theta[_TIMING], theta[_PATTERNS], noise[0], noise[1] if len(noise) > 1 else 0.0)
    return result | {name: np.sqrt(max(v, 0.0)) for name, v in zip(SIZES[2:], variances, strict=True)}


def _least_squares(normal: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """The solution of normal equations, the shortest one where patterns are missing or cannot be told apart."""
    scale = np.sqrt(np.diag(normal))
    scale[scale == 0] = 1.0
    return np.linalg.lstsq(normal / np.outer(scale, scale), right / scale, rcond=1e-8)[0] / scale


def _median(values: NDArray[np.float64], weight: NDArray[np.float64]) -> float:
    order = values.argsort()
    return float(values[order][np.searchsorted(weight[order].cumsum(), 0.5 * weight.sum())])


def _stack[T: (_Samples, _Values)](kind: type[T], parts: list[T]) -> T:
    return kind(*(np.stack(part) for part in zip(*parts, strict=True)))


def _names() -> list[str]:
    return [*(f"{quantity} {part}" for quantity in ("share", "ratio") for part in PARTS), *SIZES]


def _dataset(results: Sequence[Mapping[str, float]], **attributes: float | str) -> xr.Dataset:
    """Estimates, the first of the results, with intervals by the others."""
    samples = {name: np.array([result[name] for result in results]) for name in _names()}
    data = xr.Dataset(coords={"part": list(PARTS)}, attrs=attributes)
    for quantity in ("share", "ratio"):
        parts = [_interval(samples[f"{quantity} {part}"]) for part in PARTS]
        for end in parts[0]:
            data[quantity + end] = ("part", np.array([part[end] for part in parts]))
    for name in SIZES:
        data.update({name + end: value for end, value in _interval(samples[name]).items()})
    return data


def _interval(values: NDArray[np.float64]) -> dict[str, float]:
    tail = (1 - CONFIDENCE) / 2
    low, high, sure = np.quantile(values[1:], [tail, 1 - tail, 1 - _SURE])
    return {"": float(values[0]), "_low": float(low), "_high": float(high), "_sure": float(sure)}
