"""Variance of the evidence of taps, beyond that of independent samples, split by cause.

Evidence is the log-likelihood ratio of a tap for its own class against the nearest rival (see `evidence`). Were its
J K samples independent given the class, its variance would be the sum of theirs, and over n taps n times that. What
comes on top is split in this order:

1. `session`: the covariance of the taps of one class and session that lie far apart in it. All taps of a sequence share
   it, so over n taps it counts n squared times. What neighbours share beyond that goes to `order`.
2. `place`: what goes with the position of a tap inside its class, whatever its form where sessions repeat positions,
   else as a parabola. Where positions do not vary, what goes with the order of taps in their session is part of
   `order`.
   Named suspects, extra arrays of the recording, come next, one after the other: what they add to place or order.
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
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ....models.seeds import Purpose, generator
from ....models.taps import TapSet
from ...stats.evidence import Evidence
from ...stats.metrics import CONFIDENCE
from .classes import evidence_classes
from .sample_covariance import FORMER, GAIN, PATTERNS, TIMING, SampleMoments, lag_steps, sample_moments
from .split import EvidenceMoments, covariate_p, evidence_moments, responses_to
from .suspects import Suspect, suspicion

CAUSES = {
    "session": "differences between sessions",
    "place": "position within a class",
    "order": "drift or an unlabelled condition",
    "gain": "variation of tap strength",
    "timing": "variation of tap timing",
    "common": "noise shared by taxels",
    "noise": "noise correlated in time",
}
"""Causes by name, in words."""
PART_WORDS = {
    "independent": "independent samples",
    **CAUSES,
    "serial": "correlation of neighbouring taps",
    "rest": "remainder",
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
_FAR = 1.5  # a share beyond which an interval says that shares are not known
_SURE = 0.99  # of the intervals by which a cause is named: there are seven causes
_RESAMPLES = 400
_WITHIN = ("gain", "timing", "common", "noise")  # causes that act within a tap
_MOST_CORRECTION = 3.0  # of what the linear response of evidence predicts


def split_variance(
    taps: TapSet,
    evidence: Evidence,
    seed: int = 0,
    n: int = SEQUENCE,
    resamples: int = _RESAMPLES,
    suspects: Sequence[Suspect] = (),
) -> xr.Dataset:
    """The variance of the evidence of n taps by cause.

    Args:
        taps: Those of the evidence, with sessions that are numbered apart.
        evidence: Of these taps.
        seed: Of the resampling of classes.
        n: Taps of a sequence, of one class and session.
        resamples: How many.
        suspects: Arrays that may make evidence vary, see `suspects`.

    Returns:
        Over `part` (see `PARTS`; then `suspect_part` of each suspect): `share` of the variance of the evidence of a
        sequence, and `ratio`, this variance over that of a tap with independent samples. Further `design_effect`, the
        observed over the independent variance of a tap, the median over classes; `sequence_effect`, the same of n taps,
        over all classes; and
        standard deviations: `gain_sd` (relative), `timing_sd` (samples), `common_sd`, `noise_sd` and, from one sample
        to the next, `lasting_sd` (unit of the samples). Each has an interval `_low`, `_high` at 95% and `_sure`, the
        lower end at 99%. Without a class that has taps enough all are NaN. Attributes: `taps` n, `classes`,
        `sessions`, `covariate`, `"place"`, `"order"` or nothing, and `covariate_p`, by permutation of taps within
        halves of sessions, the probability of what it explains if it explained nothing; and of suspects in their order
        `suspects`, their names, `suspect_p` and `suspect_follows_order`, see `suspects.Suspected`.
    """
    judged = taps.select(evidence.tap)
    samples, session = judged.taps.astype(np.float64), judged.session
    classes, covariate = evidence_classes(taps, evidence, [suspect.columns for suspect in suspects])
    named = [suspect.name for suspect in suspects]
    parts = (*PARTS, *map(suspect_part, named))
    if not classes:
        nothing: dict[str, Any] = {"taps": n, "classes": 0, "sessions": 0, "covariate": "", "covariate_p": np.nan}
        unknown = [np.nan] * len(named)
        nothing |= {"suspects": named, "suspect_p": unknown, "suspect_follows_order": unknown}
        return _dataset(dict.fromkeys(_names(parts), np.full(2, np.nan)), parts, **nothing)
    steps = lag_steps(samples.shape[1])
    C = len(classes)
    known = _stack(SampleMoments, [sample_moments(one, samples[one.members], steps) for one in classes])
    theta, noise = known.solve(np.full(C, 1 / C))
    sizes = np.sqrt(np.maximum([*theta[:PATTERNS], noise[0] + theta[PATTERNS]], 0.0))
    responses = responses_to(evidence, samples, sizes)
    values = _stack(
        EvidenceMoments,
        [
            evidence_moments(one, evidence.values[one.members], [r[one.number] for r in responses], steps)
            for one in classes
        ],
    )
    weights = generator(seed, Purpose.CAUSES).multinomial(C, np.full(C, 1 / C), size=resamples)
    results = _combine(known, values, np.concatenate([np.ones((1, C)), weights]) / C, n, covariate, named)
    totals = [evidence.values[one.members].sum(axis=(1, 2)) for one in classes]
    found = [
        suspicion([suspect.columns[evidence.tap][one.members] for one in classes], classes, totals, seed)
        for suspect in suspects
    ]
    attributes = {
        "taps": n,
        "classes": C,
        "sessions": len(np.unique(session)),
        "covariate": covariate,
        "covariate_p": covariate_p(classes, evidence, seed),
        "suspects": named,
        "suspect_p": [one.p for one in found],
        "suspect_follows_order": [one.follows_order for one in found],
    }
    return _dataset(results, parts, **attributes)


def suspect_part(name: str) -> str:
    """The part of a named suspect."""
    return f"covariate {name}"


def part_words(part: str) -> str:
    """A part in words, also that of a suspect."""
    return PART_WORDS.get(part, f"“{part.removeprefix(suspect_part(''))}”")


def is_cause(part: str) -> bool:
    """Whether a part can be named first."""
    return part in CAUSES or part not in PART_WORDS


def tells(split: xr.Dataset) -> bool:
    """Whether shares are known well enough to name a cause: no interval of a sure one goes far beyond the whole."""
    causes = split.sel(part=_causes(split))
    sure = causes["share_sure"].values > 0
    return not bool((causes["share_high"].values[sure] > _FAR).any())


def unseen_parts(split: xr.Dataset) -> set[str]:
    """Parts of the variance of evidence that these taps cannot show."""
    unseen = {"place", "order"} - {split.attrs["covariate"]}
    if split.attrs["sessions"] < 2:
        unseen |= {"session", "serial"}
    suspects = zip(split.attrs["suspects"], split.attrs["suspect_p"], strict=True)
    return unseen | {suspect_part(name) for name, p in suspects if not np.isfinite(p)}


def seen(split: xr.Dataset) -> xr.Dataset:
    """Without the numbers of parts that these taps cannot show."""
    shown = ~split["part"].isin(sorted(unseen_parts(split)))
    return split.assign({name: of.where(shown) for name, of in split.data_vars.items() if "part" in of.dims})


def _causes(split: xr.Dataset) -> list[str]:
    return [str(part) for part in split["part"].values if is_cause(str(part))]


def first_cause(split: xr.Dataset, without: Sequence[str] = (), least_share: float = LEAST_SHARE) -> str | None:
    """The first of `sure_causes`, which has the same arguments; `None` where there is none."""
    return next(iter(sure_causes(split, without, least_share)), None)


def sure_causes(split: xr.Dataset, without: Sequence[str] = (), least_share: float = LEAST_SHARE) -> list[str]:
    """Causes that are surely there, by their share of the variance, the largest first; none where shares are unknown.

    With fewer classes than `FEWEST_CLASSES` only sessions can be among them, which a test of their own supports.

    Args:
        split: From `split_variance`.
        without: Causes that other tests do not support.
        least_share: Share below which a cause does not matter.
    """
    if not tells(split):
        return []
    few = split.attrs["classes"] < FEWEST_CLASSES
    names = [name for name in _causes(split) if name not in without and (name == "session" or not few)]
    share, sure = (dict(zip(names, split[of].sel(part=names).values, strict=True)) for of in ("share", "share_sure"))
    return sorted(
        (name for name in names if sure[name] > 0 and share[name] >= least_share), key=lambda name: -share[name]
    )


def _combine(
    known: SampleMoments,
    values: EvidenceMoments,
    weight: NDArray[np.float64],
    n: int,
    covariate: str,
    suspects: Sequence[str],
) -> dict[str, NDArray[np.float64]]:
    """All quantities under weights of classes (R, C), shape (R,) each."""
    theta, noise = known.solve(weight)
    # In units of the variance of each class, so that classes count alike.
    scale = weight / values.spread
    session, serial, explained, named, whole, independent, excess, _, patterns, lasting = (
        np.tensordot(scale, part, 1) for part in values
    )
    # Taps that share less than nothing by chance cannot take away more than the variance that there is.
    shared, nothing = n * session + (n - 1) * serial, np.zeros_like(session)
    kept = np.divide((1 - 1 / n) * whole, -shared, out=np.ones_like(shared), where=shared < 0).clip(max=1.0)
    session, serial = kept * session, kept * serial
    parts = {
        "independent": independent,
        "session": n * session,
        "place": explained if covariate == "place" else nothing,
        "order": explained if covariate == "order" else nothing,
        "serial": (n - 1) * serial,
        "gain": patterns[:, GAIN] * theta[:, GAIN] + patterns[:, FORMER] * theta[:, FORMER],
        "timing": patterns[:, TIMING] * theta[:, TIMING],
        "common": (patterns[:, PATTERNS:] * theta[:, PATTERNS:]).sum(axis=1),
        "noise": (lasting * noise).sum(axis=1),
        **{suspect_part(name): value for name, value in zip(suspects, named.T, strict=True)},
    }
    # Evidence answers to large disturbances otherwise than to small ones, so their sizes give proportions only.
    predicted = sum((parts[name].clip(min=0.0) for name in _WITHIN), nothing)
    correction = np.divide(excess.clip(min=0.0), predicted, out=nothing.copy(), where=predicted > 0)
    correction = correction.clip(max=_MOST_CORRECTION)
    parts |= {name: correction * parts[name].clip(min=0.0) for name in _WITHIN}
    parts["rest"] = excess - correction * predicted
    total = np.maximum(whole + n * session + (n - 1) * serial, 1e-300)
    ratio = values.whole / np.maximum(values.independent, 1e-300)
    result = {f"share {name}": value / total for name, value in parts.items()}
    result |= {f"ratio {name}": value / independent for name, value in parts.items()}
    result |= {"design_effect": _median(ratio, weight), "sequence_effect": total / independent}
    lasting_noise = noise[:, 1] if noise.shape[1] > 1 else nothing
    variances = (theta[:, GAIN], theta[:, TIMING], theta[:, PATTERNS], noise[:, 0], lasting_noise)
    return result | {name: np.sqrt(v.clip(min=0.0)) for name, v in zip(SIZES[2:], variances, strict=True)}


def _median(values: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Medians of values (C,) under weights (R, C), shape (R,)."""
    order = values.argsort()
    half = 0.5 * weight.sum(axis=1, keepdims=True)
    return values[order][(weight[:, order].cumsum(axis=1) >= half).argmax(axis=1)]


def _stack[T: (SampleMoments, EvidenceMoments)](kind: type[T], parts: list[T]) -> T:
    return kind(*(np.stack(part) for part in zip(*parts, strict=True)))


def _names(parts: Sequence[str]) -> list[str]:
    return [*(f"{quantity} {part}" for quantity in ("share", "ratio") for part in parts), *SIZES]


def _dataset(samples: Mapping[str, NDArray[np.float64]], names: Sequence[str], **attributes: Any) -> xr.Dataset:
    """Estimates, the first of the samples of each quantity, with intervals by the others."""
    data = xr.Dataset(coords={"part": list(names)}, attrs=attributes)
    for quantity in ("share", "ratio"):
        parts = [_interval(samples[f"{quantity} {part}"]) for part in names]
        for end in parts[0]:
            data[quantity + end] = ("part", np.array([part[end] for part in parts]))
    for name in SIZES:
        data.update({name + end: value for end, value in _interval(samples[name]).items()})
    return data


def _interval(values: NDArray[np.float64]) -> dict[str, float]:
    tail = (1 - CONFIDENCE) / 2
    low, high, sure = np.quantile(values[1:], [tail, 1 - tail, 1 - _SURE])
    return {"": float(values[0]), "_low": float(low), "_high": float(high), "_sure": float(sure)}
