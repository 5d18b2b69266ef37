"""What an audit says in words: a verdict, the first cause, and the remedy to choose.

Nothing here is measured. A fault is a miscalibration factor above what a right model gives on as many taps, by a Monte
Carlo test at 5 % for both directions together: decisions are more often wrong than they are believed to be. Only a
fault asks for a remedy.
One is chosen if its gain in log score is surely above zero, at a level that holds for all remedies together, and if it
does not surely err more at the reaction time of the setting as it is; of several, the one that buys most per tap.
"""

from collections.abc import Mapping
from typing import Literal, NamedTuple

import numpy as np
import xarray as xr

from ..stats.right_model import LEVEL
from .leakage.run import Leakage
from .remedy_scores import BeliefEvidence, Measured, Scored
from .variance.causes import CAUSES, FEWEST_CLASSES, part_words, suspect_part, tells
from .variance.causes import first_cause as largest_cause

type Calibration = Literal["overconfident", "right", "cautious", "not enough data to tell"]

NOT_ENOUGH: Calibration = "not enough data to tell"
MEASURING = "the measuring session"

_LITTLE, _MUCH = 0.01, 99.0  # factors beyond which their size says nothing
_WIDE = 4.0  # ratio of the ends of an interval around 1 that leaves everything open
_WORSE = 0.1  # of the error as it is: what a remedy may add to it
_TEST_LEVEL = 0.01  # as sure as causes without a test of their own have to be, see `causes`
LEAKAGE, SPARSE = "leakage", "few samples"
CAUSE_WORDS = {
    LEAKAGE: "classes are inferred without touch",
    SPARSE: "histograms hold too few samples",
    **CAUSES,
}
"""All that can be named first, in words."""
_FOLLOWS = 0.5  # of the variance of a suspect within sessions, from which on it follows the order of taps
_SPARSE = 10.0  # samples per bin that a training histogram uses, below which sampling alone makes beliefs too sure


class Cause(NamedTuple):
    """What is named first.

    Attributes:
        name: A key of `CAUSE_WORDS`, `causes.suspect_part` of a suspect, or `None`.
        sentence: It in words, with numbers.
    """

    name: str | None
    sentence: str


def calibration(judged: BeliefEvidence) -> Calibration:
    """How beliefs compare with outcomes: a Monte Carlo test of the miscalibration factor at `right_model.LEVEL`.

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
    """Remedies by what they buy per tap, the best first; the setting as it is is none."""
    return sorted(measured.scores[1:], key=lambda score: -(score.gain or (-np.inf,))[0])


def worthwhile(measured: Measured, score: Scored) -> bool:
    """Whether a remedy surely buys something and does not surely err more."""
    base = measured.scores[0].error
    allowed = _WORSE * base[0] if base is not None else 0.0
    worse = score.error_change is not None and score.error_change[1] > allowed
    return score.sure_gain is not None and score.sure_gain > 0 and not worse


def recommended(measured: Measured) -> str | None:
    """The remedy to choose; `None` where nothing has to be repaired or nothing surely helps."""
    if calibration(measured.judged) != "overconfident":
        return None
    return next((score.name for score in ranking(measured) if worthwhile(measured, score)), None)


def first_cause(
    leakage: Leakage, split: xr.Dataset | None, session_p: float, samples_per_bin: float, state: Calibration
) -> Cause:
    """What to look at first.

    Leakage where it explains what whole taps tell; else the cause with the largest share of the variance of evidence
    that is surely there; else, where beliefs are too sure all the same, histograms of too few samples.

    Args:
        leakage: Of the training and measuring taps.
        split: From `causes.split_variance`; `None` where there is none.
        session_p: From `causes.session_p`.
        samples_per_bin: Training samples in each bin that a histogram uses.
        state: How beliefs compare with outcomes.
    """
    if leakage.explained:
        return Cause(
            LEAKAGE, f"{next(iter(leakage.sentences))} Recording classes in mixed order comes before any remedy."
        )
    name = None if split is None else largest_cause(split, _unsupported(split, session_p))
    if name is not None and split is not None:
        return Cause(name, _share_sentence(split, name))
    if state == "overconfident" and samples_per_bin < _SPARSE:
        return Cause(
            SPARSE,
            f"Histograms have {samples_per_bin:.0f} samples in each bin that they use, so that they are themselves in "
            "error; more training taps, or a larger --pseudocount, come before any remedy of dependence.",
        )
    return Cause(None, _nothing_sentence(split))


def _unsupported(split: xr.Dataset, session_p: float) -> list[str]:
    """Causes that have a test of their own which does not reject."""
    tested = {"session": session_p, str(split.attrs["covariate"]): float(split.attrs["covariate_p"])}
    suspects = zip(split.attrs["suspects"], split.attrs["suspect_p"], strict=True)
    # A suspect that could not be tested is not accused.
    return [name for name, p in tested.items() if p > _TEST_LEVEL] + [
        suspect_part(name) for name, p in suspects if not p <= _TEST_LEVEL
    ]


def cause_words(name: str | None) -> str:
    """A cause in words."""
    return "nothing" if name is None else CAUSE_WORDS.get(name) or part_words(name)


def _share_sentence(split: xr.Dataset, name: str) -> str:
    at, n = split.sel(part=name), int(split.attrs["taps"])
    share, low, high = (float(at[f"share{end}"]) for end in ("", "_low", "_high"))
    alone = float(split["share"].sel(part="independent"))
    effect = float(split["sequence_effect"])
    return (
        f"First of all {part_words(name)}: {share:.0%} ({low:.0%} to {high:.0%}) of the variance of the evidence of "
        f"{n} taps come from that, {alone:.0%} from what independent samples would have; the whole is {effect:.3g} "
        "times what independence says." + (_followers(split) if name == "order" else "")
    )


def _followers(split: xr.Dataset) -> str:
    """The suspects that go with the order of taps."""
    follows = zip(split.attrs["suspects"], split.attrs["suspect_follows_order"], strict=True)
    names = [f"“{name}”" for name, share in follows if share > _FOLLOWS]
    verb = "follows" if len(names) == 1 else "follow"
    return f" {', '.join(names)} {verb} that order, and cannot be told from drift here." if names else ""


def _nothing_sentence(split: xr.Dataset | None) -> str:
    if split is None or not split.attrs["classes"]:
        return "There are not enough taps per class, with evidence that varies, to say what makes it vary."
    low, value, high = (float(split[f"sequence_effect{end}"]) for end in ("_low", "", "_high"))
    if not tells(split):
        return (
            "There are not enough taps to say what makes evidence vary: shares of its variance scatter beyond 0 and 1."
        )
    told = f"{value:.2f} ({low:.2f} to {high:.2f}) times what independent samples would have"
    n = int(split.attrs["taps"])
    if split.attrs["classes"] < FEWEST_CLASSES or (low <= 1 and high > _WIDE):
        return f"There are not enough data to tell: the variance of the evidence of {n} taps is {told}."
    return f"No cause of dependence is surely there: the variance of the evidence of {n} taps is {told}."


def verdict(
    cause: Cause, measured: Measured, theta: float, titles: Mapping[str, str], unit: str, within: str = MEASURING
) -> list[str]:
    """The verdict, sentence by sentence.

    Args:
        cause: What comes first.
        measured: What remedies buy.
        theta: The threshold.
        titles: Of remedies, by name.
        unit: Of errors.
        within: What decisions were made on.
    """
    state = calibration(measured.judged)
    sentences = [_calibration_sentence(state, measured, theta, within), cause.sentence]
    name = recommended(measured)
    scores = {score.name: score for score in measured.scores}
    if name is not None:
        sentences.append(_remedy_sentence(scores[name], measured, theta, titles[name], unit))
    elif state == "overconfident":
        sentences.append(
            "None of the remedies surely helps on these taps; the table of remedies says by how much each may."
        )
    elif state == "not enough data to tell":
        sentences.append("Nothing is recommended: whether anything has to be repaired cannot be told from these taps.")
    else:
        sentences.append(_unneeded_sentence(measured, titles))
    return sentences


def _calibration_sentence(state: Calibration, measured: Measured, theta: float, within: str) -> str:
    judged, beside = measured.judged, measured.judged.beside
    value = judged.factor[0]
    if value is None or judged.wrong is None:
        return f"Whether beliefs are right cannot be judged: no decision at threshold {theta:g} leaves any doubt."
    beginning = {
        "overconfident": "Beliefs are overconfident",
        "cautious": "Beliefs are cautious",
        "right": "Beliefs are as right as they say",
        "not enough data to tell": "There are not enough data to judge whether beliefs are right",
    }[state]
    told = (
        f"{beginning}: in {within} at threshold {theta:g}, {measured.policy}, {judged.wrong:.1%} of the decisions are "
        "wrong, "
    )
    if np.isinf(value):
        told += "although all beliefs are 1 and leave no doubt, so the factor is infinite"
    else:
        told += f"{_times(value)}{_ends(judged.factor)} times as often as the beliefs say"
    told += f"; a right model on {judged.taps} tap{'s' * (judged.taps > 1)} per class "
    if np.isnan(beside.median):
        told += "makes no wrong decision"
    else:
        told += f"gives {_times(beside.median)} ({_times(beside.low)} to {_times(beside.high)})"
    return f"{told}. {judged.few}".strip()


def _ends(factor: tuple[float | None, float | None, float | None]) -> str:
    """The interval of a factor, if there is one."""
    _, low, high = factor
    return "" if low is None or high is None else f" ({_times(low)} to {_times(high)})"


def _times(factor: float) -> str:
    """A factor to two digits, without those that nobody believes."""
    if 0 < factor < _LITTLE:
        return f"less than {_LITTLE:g}"
    return f"{factor:.2g}" if factor < _MUCH else f"more than {_MUCH:.0f}"


def _remedy_sentence(score: Scored, measured: Measured, theta: float, title: str, unit: str) -> str:
    gain, low, high = score.gain or (np.nan,) * 3
    n = measured.n
    near = [
        f"“{one.name}”"
        for one in ranking(measured)
        if one.name != score.name and worthwhile(measured, one) and one.gain is not None and one.gain[2] > gain
    ]
    close = f" Close to it come {', '.join(near)}." if near else ""
    told = (
        f"The remedy that buys most per tap is “{score.name}” ({title}): {gain / n:.2g} nats of log score per tap "
        f"({low / n:.2g} to {high / n:.2g}, over {n} tap{'s' * (n > 1)})"
    )
    if score.error_change is not None and score.error is not None:
        change, c_low, c_high = score.error_change
        lower = "" if measured.theta == theta else f" at threshold {measured.theta:g}, where the test taps suffice"
        told += (
            f"; at the {measured.taps:.1f} taps that decisions take as it is{lower}, the error changes by "
            f"{change:+.2g} {unit} ({c_low:+.2g} to {c_high:+.2g}) to {score.error[0]:.3g}"
        )
    if score.taps is not None and score.factor[0] is not None:
        told += (
            f"; at threshold {theta:g} it takes {score.taps:.1f} taps, with a factor of {_times(score.factor[0])}"
            f"{_ends(score.factor)}"
        )
    if score.factor[1] is not None and score.factor[1] > max(1.0, measured.judged.beside.high):
        return told + ". Beliefs stay overconfident with it." + close
    return told + "." + close


def _unneeded_sentence(measured: Measured, titles: Mapping[str, str]) -> str:
    helps = [score for score in ranking(measured) if worthwhile(measured, score)]
    if not helps:
        return "Nothing is recommended: nothing has to be repaired, and no remedy surely buys anything."
    best = helps[0]
    gain = (best.gain or (0.0,))[0] / measured.n
    return (
        f"Nothing has to be repaired. “{best.name}” ({titles[best.name]}) would still buy {gain:.2g} nats of log score "
        "per tap."
    )
