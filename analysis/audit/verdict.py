"""The verdict of an audit in sentences: calibration of beliefs, main cause of dependence and recommended remedy.

Beliefs are overconfident if the miscalibration factor is above that of a correct model on as many taps, by a two-sided
Monte Carlo test at 5%. Only overconfidence calls for a remedy. A remedy is recommended if its gain in log score is
significantly above zero, adjusted for all remedies together, and its error at the reaction time of the current setting
is not significantly larger; of several, the one with the largest gain per tap.
"""

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
import xarray as xr

from ..page.numbers import factor_ends, number, spanned
from ..stats.detection import LEVEL
from .leakage.run import Leakage
from .remedy_scores import BeliefEvidence, Measured, Scored
from .variance.causes import CAUSES, FEWEST_CLASSES, part_words, suspect_part, tells
from .variance.causes import first_cause as largest_cause

type Calibration = Literal["overconfident", "right", "cautious", "not enough data to tell"]

NOT_ENOUGH: Calibration = "not enough data to tell"
MEASURING = "the measuring session"

_WIDE = 4.0  # ratio of the ends of an interval around 1 that leaves everything open
_WORSE = 0.1  # of the error of the current setting: the increase that a remedy may cause
_TEST_LEVEL = 0.01  # as sure as causes without a test of their own have to be, see `causes`
LEAKAGE, SPARSE = "leakage", "few samples"
CAUSE_WORDS = {
    LEAKAGE: "leakage (classes are inferred without touch)",
    SPARSE: "too few samples per histogram bin",
    **CAUSES,
}
"""Possible main causes, as they are printed."""
_FOLLOWS = 0.5  # of the variance of a suspect within sessions, from which on it follows the order of taps
_SPARSE = 10.0  # samples per bin that a training histogram uses, below which sampling alone makes beliefs too sure


class Cause(NamedTuple):
    """The main cause of dependence.

    Attributes:
        name: A key of `CAUSE_WORDS`, `causes.suspect_part` of a suspect, or `None`.
        sentence: The same as a sentence, with numbers.
    """

    name: str | None
    sentence: str


def calibration(judged: BeliefEvidence) -> Calibration:
    """How beliefs compare with outcomes: a Monte Carlo test of the miscalibration factor at `detection.LEVEL`.

    The reference is what a right model gives on as many taps. Where beliefs are not right in the reference, as no whole
    number of samples is worth the exponent, the interval of the factor must lie on the same side of 1 as well.
    A factor is infinite where decisions are wrong although their beliefs are 1.
    """
    value = judged.factor[0]
    if value is None:
        return "not enough data to tell"
    low, high = (end if known is None else known for known, end in zip(judged.factor[1:], (0.0, np.inf), strict=True))
    if judged.beside.above <= LEVEL / 2 and (value if judged.exact else low) > 1:
        return "overconfident"
    if judged.beside.below <= LEVEL / 2 and (value if judged.exact else high) < 1:
        return "cautious"
    return "right" if np.isfinite(value) and high <= _WIDE * max(low, 1 / _WIDE) else "not enough data to tell"


def ranking(measured: Measured) -> list[Scored]:
    """Remedies by gain per tap, the best first, without the current setting."""
    return sorted(measured.scores[1:], key=lambda score: -(score.gain or (-np.inf,))[0])


def worthwhile(measured: Measured, score: Scored) -> bool:
    """Whether a remedy has a significant gain and no significantly larger error."""
    base = measured.scores[0].error
    allowed = _WORSE * base[0] if base is not None else 0.0
    worse = score.error_change is not None and score.error_change[1] > allowed
    return score.sure_gain is not None and score.sure_gain > 0 and not worse


def recommended(measured: Measured) -> str | None:
    """The recommended remedy; `None` where none is needed or none is significant."""
    if calibration(measured.judged) != "overconfident":
        return None
    return next((score.name for score in ranking(measured) if worthwhile(measured, score)), None)


def first_cause(
    leakage: Leakage, split: xr.Dataset | None, session_p: float, samples_per_bin: float, state: Calibration
) -> Cause:
    """The main cause of dependence.

    Leakage where it explains the accuracy of whole taps; else the significant cause with the largest share of the
    variance of the evidence; else, where beliefs are overconfident, histograms of too few samples.

    Args:
        leakage: Of the training and measuring taps.
        split: From `causes.split_variance`; `None` where there is none.
        session_p: From `causes.session_p`.
        samples_per_bin: Training samples in each bin that a histogram uses.
        state: How beliefs compare with outcomes.
    """
    if leakage.explained:
        return Cause(
            LEAKAGE, f"{next(iter(leakage.sentences))} Record the classes in random order before applying any remedy."
        )
    name = shown_cause(leakage, split, session_p)
    if name and split is not None:
        return Cause(name, _share_sentence(split, name))
    if state == "overconfident" and samples_per_bin < _SPARSE:
        return Cause(
            SPARSE,
            f"Histograms have only {samples_per_bin:.0f} samples per occupied bin, so they are imprecise. Add "
            "training taps or increase --pseudocount before applying a remedy for dependence.",
        )
    return Cause(None, _nothing_sentence(split))


def shown_cause(leakage: Leakage, split: xr.Dataset | None, session_p: float) -> str:
    """The part of the variance that is the main cause; empty where none is."""
    if leakage.explained or split is None:
        return ""
    return largest_cause(split, unsupported_causes(split, session_p)) or ""


def unsupported_causes(split: xr.Dataset, session_p: float) -> list[str]:
    """Causes that have a test of their own which does not reject."""
    tested = {"session": session_p, str(split.attrs["covariate"]): float(split.attrs["covariate_p"])}
    suspects = zip(split.attrs["suspects"], split.attrs["suspect_p"], strict=True)
    # A suspect that could not be tested is not accused.
    return [name for name, p in tested.items() if p > _TEST_LEVEL] + [
        suspect_part(name) for name, p in suspects if not p <= _TEST_LEVEL
    ]


def cause_words(name: str | None) -> str:
    """A cause as it is printed."""
    return "nothing" if name is None else CAUSE_WORDS.get(name) or part_words(name)


def _share_sentence(split: xr.Dataset, name: str) -> str:
    at, n = split.sel(part=name), int(split.attrs["taps"])
    share, low, high = (float(at[f"share{end}"]) for end in ("", "_low", "_high"))
    alone = float(split["share"].sel(part="independent"))
    effect = float(split["sequence_effect"])
    return (
        f"Main cause of dependence: {part_words(name)}. It accounts for "
        f"{spanned(100 * share, 100 * low, 100 * high, '%')} of the variance of the evidence of {n} taps; independent "
        f"samples would account for {alone:.0%}. The variance is {effect:.2g} times that of independent samples."
        + (_followers(split) if name == "order" else "")
    )


def _followers(split: xr.Dataset) -> str:
    """The suspects that go with the order of taps."""
    follows = zip(split.attrs["suspects"], split.attrs["suspect_follows_order"], strict=True)
    names = [f"“{name}”" for name, share in follows if share > _FOLLOWS]
    verb = "follows" if len(names) == 1 else "follow"
    return f" {', '.join(names)} {verb} that order and cannot be distinguished from drift here." if names else ""


def _nothing_sentence(split: xr.Dataset | None) -> str:
    if split is None or not split.attrs["classes"]:
        return "The causes of dependence cannot be estimated: too few classes have enough taps with varying evidence."
    low, value, high = (float(split[f"sequence_effect{end}"]) for end in ("_low", "", "_high"))
    if not tells(split):
        return (
            "The causes of dependence cannot be estimated from these taps: the estimated shares of the variance are "
            "not between 0 and 1."
        )
    told = f"{spanned(value, low, high)} times that of independent samples"
    n = int(split.attrs["taps"])
    if split.attrs["classes"] < FEWEST_CLASSES or (low <= 1 and high > _WIDE):
        return f"Too few data to identify a cause of dependence: the variance of the evidence of {n} taps is {told}."
    return f"No cause of dependence is significant: the variance of the evidence of {n} taps is {told}."


def verdict(
    cause: Cause, measured: Measured, theta: float, titles: Mapping[str, str], unit: str, within: str = MEASURING
) -> list[str]:
    """The verdict, sentence by sentence."""
    state = calibration(measured.judged)
    sentences = [_calibration_sentence(state, measured, theta, within), cause.sentence]
    name = recommended(measured)
    scores = {score.name: score for score in measured.scores}
    if name is not None:
        sentences.append(_remedy_sentence(scores[name], measured, theta, titles[name], unit))
    elif state == "overconfident":
        sentences.append(
            "No remedy is recommended: none improves these taps significantly. The table of remedies lists their "
            "effects."
        )
    elif state == "not enough data to tell":
        few = "No remedy is recommended: these taps are too few to decide whether one is needed."
        sentences.append(" ".join([few, *_still_gains(measured, titles)]))
    else:
        sentences.append(_unneeded_sentence(measured, titles))
    return sentences


def _calibration_sentence(state: Calibration, measured: Measured, theta: float, within: str) -> str:
    judged, beside = measured.judged, measured.judged.beside
    value = judged.factor[0]
    if value is None or judged.wrong is None:
        return f"Calibration cannot be assessed: at threshold {theta:g} every decision has belief 1."
    beginning = {
        "overconfident": "Beliefs are overconfident",
        "cautious": "Beliefs are cautious",
        "right": "Beliefs are calibrated",
        "not enough data to tell": "Too few data to assess the calibration of beliefs",
    }[state]
    told = (
        f"{beginning}: in {within} at threshold {theta:g}, {measured.policy}, {judged.wrong:.1%} of the decisions are "
        "wrong, "
    )
    if np.isinf(value):
        told += "although all beliefs are 1, so the miscalibration factor is infinite"
    else:
        told += f"{_times(judged.factor)} times as often as the beliefs imply"
    told += f"; a correct model on {judged.taps} tap{'s' * (judged.taps > 1)} per class "
    if np.isnan(beside.median):
        told += "makes no wrong decision"
    else:
        told += f"gives {_times((beside.median, beside.low, beside.high))}"
    return f"{told}. {judged.few}".strip()


def _times(factor: Sequence[float | None]) -> str:
    """A factor with its interval, if there is one, for a sentence."""
    value, low, high = factor_ends(factor)
    return f"{value} ({low} to {high})" if low else value


def _remedy_sentence(score: Scored, measured: Measured, theta: float, title: str, unit: str) -> str:
    gain, low, high = score.gain or (np.nan,) * 3
    n = measured.n
    near = [
        f"“{one.name}”"
        for one in ranking(measured)
        if one.name != score.name and worthwhile(measured, one) and one.gain is not None and one.gain[2] > gain
    ]
    close = f" Its interval also contains the gain of {', '.join(near)}." if near else ""
    told = (
        f"Recommended remedy: “{score.name}” ({title}). It gains {spanned(gain / n, low / n, high / n)} nats of log "
        f"score per tap over {n} tap{'s' * (n > 1)}"
    )
    if score.error_change is not None and score.error is not None:
        change, c_low, c_high = score.error_change
        lower = (
            ""
            if measured.theta == theta
            else f" at threshold {measured.theta:g} (the highest at which the test taps suffice)"
        )
        told += (
            f"; at {measured.taps:.1f} taps, the mean reaction time of the current setting{lower}, it changes the "
            f"object error by {spanned(change, c_low, c_high)} {unit}, to {number(score.error[0], 2)} {unit}"
        )
    if score.taps is not None and score.factor[0] is not None:
        told += (
            f"; at threshold {theta:g} it takes {score.taps:.1f} taps, with a miscalibration factor of "
            f"{_times(score.factor)}"
        )
    if score.factor[1] is not None and score.factor[1] > max(1.0, measured.judged.beside.high):
        return told + ". Beliefs remain overconfident with it." + close
    return told + "." + close


def _unneeded_sentence(measured: Measured, titles: Mapping[str, str]) -> str:
    more = _still_gains(measured, titles)
    return (
        " ".join(["No remedy is needed.", *more]) if more else "No remedy is needed, and none has a significant gain."
    )


def _still_gains(measured: Measured, titles: Mapping[str, str]) -> list[str]:
    """What the best remedy with a significant gain would give though none is recommended; nothing without one."""
    best = next((score for score in ranking(measured) if worthwhile(measured, score)), None)
    if best is None:
        return []
    gain = number((best.gain or (0.0,))[0] / measured.n, 2)
    return [f"“{best.name}” ({titles[best.name]}) would still gain {gain} nats of log score per tap."]
