"""The words of an audit follow from its numbers by rules, each of which is a line of a table here."""

from typing import NamedTuple

import numpy as np
import pytest
import xarray as xr
from solidtouch.analysis.audit.remedy_scores import BeliefEvidence, Measured, Scored, factor_of
from solidtouch.analysis.audit.variance.causes import CAUSES, PARTS
from solidtouch.analysis.audit.verdict import (
    CAUSE_WORDS,
    Cause,
    calibration,
    cause_words,
    first_cause,
    ranking,
    recommended,
    unsupported_causes,
    verdict,
    worthwhile,
)
from solidtouch.analysis.stats.right_model import Beside

UNKNOWN = "not enough data to tell"
ABOVE, BELOW, WITHIN, UNTESTED = (0.005, 1.0), (1.0, 0.005), (0.4, 0.6), (1.0, 1.0)
"""P-values of the factor against a right model: that it is not above, not below."""
CALIBRATION = {
    "above a right model": ((3.0, 1.1, 8.0), ABOVE, True, "overconfident"),
    "above it, with an interval that reaches below one": ((3.0, 0.7, 8.0), ABOVE, True, "overconfident"),
    "the same where the reference is not exact": ((3.0, 0.7, 8.0), ABOVE, False, UNKNOWN),
    "not exact, interval above one": ((3.0, 1.1, 8.0), ABOVE, False, "overconfident"),
    "above a cautious reference, but not above one": ((0.9, 0.7, 1.2), ABOVE, True, "right"),
    "interval above one, but a right model gives as much": ((3.0, 2.0, 5.0), WITHIN, True, "right"),
    "the same, and wide": ((3.0, 1.1, 8.0), WITHIN, True, UNKNOWN),
    "just at the level": ((3.0, 2.0, 5.0), (0.025, 0.99), True, "overconfident"),
    "just not": ((3.0, 2.0, 5.0), (0.0251, 0.99), True, "right"),
    "below a right model": ((0.5, 0.2, 0.9), BELOW, True, "cautious"),
    "below it, with an interval that reaches above one": ((0.5, 0.2, 1.1), BELOW, True, "cautious"),
    "below, not exact": ((0.5, 0.3, 1.1), BELOW, False, "right"),
    "below, not exact, interval below one": ((0.5, 0.2, 0.9), BELOW, False, "cautious"),
    "below a bold reference, but above one": ((1.2, 0.9, 1.5), BELOW, True, "right"),
    "interval below one, but a right model gives as little": ((0.5, 0.3, 0.9), WITHIN, True, "right"),
    "below, just at the level": ((0.5, 0.3, 0.9), (0.99, 0.025), True, "cautious"),
    "below, just not": ((0.5, 0.3, 0.9), (0.99, 0.0251), True, "right"),
    "no wrong decision": ((0.0, 0.0, 0.3), BELOW, True, "cautious"),
    "narrow around one": ((1.2, 0.6, 2.3), WITHIN, True, "right"),
    "wide around one": ((1.2, 0.5, 2.3), WITHIN, True, UNKNOWN),
    "from nothing to one": ((0.3, 0.0, 1.0), WITHIN, True, "right"),
    "from nothing to two": ((0.3, 0.0, 2.0), WITHIN, True, UNKNOWN),
    "no doubt": ((None, None, None), UNTESTED, True, UNKNOWN),
    "no doubt, though some are wrong": ((np.inf,) * 3, ABOVE, True, "overconfident"),
    "the same, not exact": ((np.inf,) * 3, ABOVE, False, "overconfident"),
    "the same, as with a right model": ((np.inf,) * 3, WITHIN, True, UNKNOWN),
    "no interval": ((2.0, None, None), ABOVE, True, "overconfident"),
    "no interval, not exact": ((2.0, None, None), ABOVE, False, UNKNOWN),
    "no interval, as with a right model": ((2.0, None, None), WITHIN, True, UNKNOWN),
    "an infinite end": ((2.0, 0.1, np.inf), ABOVE, True, "overconfident"),
    "an infinite end, as with a right model": ((0.9, 0.1, np.inf), WITHIN, True, UNKNOWN),
}


def judged(factor=(3.0, 2.0, 5.0), p=ABOVE, exact=True, wrong: float | None = 0.3, median=1.1, few=""):
    value = np.nan if factor[0] is None else factor[0]
    return BeliefEvidence(factor, wrong, Beside(value, median, 0.6, 1.9, *p), exact, {}, 20, few)


@pytest.mark.parametrize(("factor", "p", "exact", "state"), CALIBRATION.values(), ids=CALIBRATION)
def test_how_beliefs_are_called(factor, p, exact, state):
    """By a test against a right model in either direction, else by how wide the interval is."""
    assert calibration(judged(factor, p, exact)) == state


def score(name, gain=0.5, sure=0.1, change=(-0.1, -0.2, 0.0), error=0.4, factor=(1.0, 0.7, 1.3)):
    """Of a remedy with a gain over ten taps."""
    return Scored(
        name,
        (-1.0, -1.2, -0.8),
        None if gain is None else (gain, gain - 0.2, gain + 0.2),
        sure,
        None if error is None else (error, error - 0.1, error + 0.1),
        change,
        None,
        7.5,
        factor,
    )


BASE = score("current setting", None, None, None, error=1.0)


AS_IT_IS = judged()


def measured(*scores, judged=AS_IT_IS, base=BASE, n=10, theta=0.95):
    return Measured([base, *scores], n, 6.5, theta, "active", judged, None, None, None)


WORTHWHILE = {
    "surely gains, errs less": ({}, True),
    "may gain nothing": ({"sure": 0.0}, False),
    "may lose": ({"sure": -0.1}, False),
    "surely errs more": ({"change": (0.3, 0.11, 0.5)}, False),
    "may err more by less than a tenth": ({"change": (0.3, 0.1, 0.5)}, True),
    "cannot be compared at that reaction time": ({"change": None}, True),
    "has no gain": ({"gain": None, "sure": None}, False),
}


@pytest.mark.parametrize(("changes", "expected"), WORTHWHILE.values(), ids=WORTHWHILE)
def test_what_is_worthwhile(changes, expected):
    """A sure gain in log score without surely more errors than a tenth of those as it is."""
    remedy = score("remedy", **changes)
    assert worthwhile(measured(remedy), remedy) is expected
    assert recommended(measured(remedy)) == ("remedy" if expected else None)


def test_without_errors_as_it_is_none_may_be_added():
    remedy = score("remedy", change=(0.05, 0.01, 0.1))
    assert not worthwhile(measured(remedy, base=BASE._replace(error=(0.0, 0.0, 0.0))), remedy)
    assert not worthwhile(measured(remedy, base=BASE._replace(error=None)), remedy)


def test_the_remedy_that_buys_most_is_chosen_of_those_that_surely_help():
    """Not the largest gain if that is unsure; those without a gain come last."""
    scores = score("small", 0.2), score("unsure", 0.9, sure=-0.1), score("none", None, None), score("large", 0.6)
    assert [one.name for one in ranking(measured(*scores))] == ["unsure", "large", "small", "none"]
    assert recommended(measured(*scores)) == "large"


@pytest.mark.parametrize(
    ("factor", "p"),
    [
        ((1.0, 0.7, 1.5), WITHIN),
        ((0.5, 0.2, 0.9), BELOW),
        ((2.0, 0.5, 9.0), WITHIN),
        ((5.0, 4.0, 6.0), WITHIN),
        ((None, None, None), UNTESTED),
    ],
    ids=["right", "cautious", "?", "as a right model", "no"],
)
def test_nothing_is_recommended_where_nothing_is_surely_wrong(factor, p):
    """However much a remedy would buy."""
    assert recommended(measured(score("remedy", 5.0, sure=4.0), judged=judged(factor, p))) is None


class Leak(NamedTuple):
    """What of a `Leakage` is read."""

    explained: tuple[str, ...] = ()
    sentences: tuple[str, ...] = ("Offsets tell all.", "And more.")


def split(classes=12, effect=(2.0, 1.5, 2.5), covariate_p=0.001, suspects=(), **shares):
    """A split of variance with these shares, each with an interval of 0.1 to either side, and surely there."""
    parts = [*PARTS, *(f"covariate {name}" for name, *_ in suspects)]
    share = np.array([shares.get(part.replace(" ", "_"), 0.0) for part in parts])
    data = xr.Dataset(
        {
            "share": ("part", share),
            "share_low": ("part", share - 0.1),
            "share_high": ("part", share + 0.1),
            "share_sure": ("part", np.where(share > 0.15, 0.01, -0.01)),
        },
        {"part": parts},
        {"classes": classes, "taps": 10, "covariate": "order", "covariate_p": covariate_p}
        | dict(zip(("suspects", "suspect_p", "suspect_follows_order"), zip(*suspects, strict=True), strict=False))
        | ({} if suspects else {"suspects": (), "suspect_p": (), "suspect_follows_order": ()}),
    )
    for end, value in zip(("", "_low", "_high"), (effect[0], effect[1], effect[2]), strict=True):
        data[f"sequence_effect{end}"] = value
    return data


TIRED, RESTED, NO_TEST = ({"suspects": [("grip", p, 0.1)]} for p in (0.001, 0.02, np.nan))
FIRST = {
    "leakage before all": ((Leak(("what",)), split(session=0.9), 0.001, 3.0, "overconfident"), "leakage"),
    "the largest": ((Leak(), split(common=0.3, gain=0.5), 0.5, 50.0, "overconfident"), "gain"),
    "sessions that surely differ": ((Leak(), split(session=0.6, gain=0.3), 0.01, 50.0, "right"), "session"),
    "sessions that may be alike": ((Leak(), split(session=0.6, gain=0.3), 0.011, 50.0, "right"), "gain"),
    "sessions that no test sees": ((Leak(), split(session=0.6), np.nan, 50.0, "right"), "session"),
    "unsure, few samples": ((Leak(), split(common=0.1), 0.5, 9.0, "overconfident"), "few samples"),
    "unsure, enough samples": ((Leak(), split(common=0.1), 0.5, 10.0, "overconfident"), None),
    "few samples that do no harm": ((Leak(), split(), 0.5, 3.0, "right"), None),
    "a cause before few samples": ((Leak(), split(order=0.2), 0.5, 3.0, "overconfident"), "order"),
    "parts that are no causes": ((Leak(), split(independent=0.4, rest=0.6, serial=0.3), 0.5, 50.0, "right"), None),
    "a suspect": ((Leak(), split(**TIRED, gain=0.3, covariate_grip=0.4), 0.5, 50.0, "right"), "covariate grip"),
    "a suspect that may be none": ((Leak(), split(**RESTED, gain=0.3, covariate_grip=0.4), 0.5, 50.0, "right"), "gain"),
    "a suspect without test": ((Leak(), split(**NO_TEST, gain=0.3, covariate_grip=0.4), 0.5, 50.0, "right"), "gain"),
    "few classes": ((Leak(), split(classes=3, order=0.6), 0.5, 50.0, "right"), None),
    "order that may be none": ((Leak(), split(covariate_p=0.02, order=0.7, gain=0.2), 0.5, 50.0, "right"), "gain"),
    "sessions of few classes": ((Leak(), split(classes=3, order=0.7, session=0.6), 0.002, 50.0, "right"), "session"),
    "no split": ((Leak(), None, np.nan, 50.0, "overconfident"), None),
    "no split, few samples": ((Leak(), None, np.nan, 3.0, "overconfident"), "few samples"),
}


@pytest.mark.parametrize(("arguments", "name"), FIRST.values(), ids=FIRST)
def test_what_is_named_first(arguments, name):
    """Leakage, then the largest sure cause, then few samples; the sentence is of what is named."""
    cause = first_cause(*arguments)
    assert cause.name == name
    assert cause_words(name) == ("nothing" if name is None else CAUSE_WORDS.get(name, "“grip”"))
    if name == "leakage":
        assert cause.sentence.startswith("Offsets tell all. Record the classes in random order")
    elif name in CAUSES:
        assert cause.sentence.startswith(f"Main cause of dependence: {CAUSES[name]}. It accounts for ")


def test_causes_whose_own_test_does_not_reject_are_unsupported():
    parts = split(covariate_p=0.02, suspects=[("grip", 0.001, 0.1), ("warmth", 0.02, 0.1), ("speed", np.nan, 0.1)])

    assert unsupported_causes(parts, 0.048) == ["session", "order", "covariate warmth", "covariate speed"]
    assert unsupported_causes(split(), 0.01) == []


def test_the_sentence_of_a_cause_has_its_numbers():
    cause = first_cause(Leak(), split(gain=0.5, independent=0.3), 0.5, 50.0, "overconfident")
    assert "50% (40% to 60%) of the variance of the evidence of 10 taps" in cause.sentence
    assert "independent samples would account for 30%" in cause.sentence
    assert "The variance is 2 times that of independent samples." in cause.sentence


def test_a_suspect_that_follows_the_order_is_said_to():
    """Where the order is named first: the two cannot be told apart."""
    suspects = [("grip", 0.4, 0.9), ("warmth", 0.4, 0.6), ("speed", 0.4, 0.1)]
    sentence = first_cause(Leak(), split(suspects=suspects, order=0.5), 0.5, 50.0, "right").sentence
    assert sentence.startswith("Main cause of dependence: drift or an unlabelled condition. It accounts for 50%")
    assert sentence.endswith("“grip”, “warmth” follow that order and cannot be distinguished from drift here.")
    other = first_cause(Leak(), split(suspects=suspects, gain=0.5), 0.5, 50.0, "right").sentence
    assert "follow" not in other


NOTHING = {
    "no classes": (split(classes=0), "The causes of dependence cannot be estimated: too few classes"),
    "no split": (None, "The causes of dependence cannot be estimated: too few classes"),
    "wide": (
        split(effect=(2.0, 0.9, 4.1)),
        "Too few data to identify a cause of dependence: the variance of the evidence of 10 taps",
    ),
    "few classes": (
        split(classes=3),
        "Too few data to identify a cause of dependence: the variance of the evidence of 10 taps",
    ),
    "narrow": (split(effect=(1.1, 0.9, 1.4)), "No cause of dependence is significant: the variance of the evidence"),
    "effect without cause": (split(effect=(6.0, 3.0, 9.0)), "No cause of dependence is significant"),
}


@pytest.mark.parametrize(("parts", "words"), NOTHING.values(), ids=NOTHING)
def test_where_no_cause_is_named_it_is_said_why(parts, words):
    assert first_cause(Leak(), parts, 0.5, 50.0, "right").sentence.startswith(words)


TITLES = {"remedy": "what it does"}
WORDS = {
    "overconfident, repaired": (
        ((3.0, 2.0, 5.0), ABOVE, {}),
        [
            "Beliefs are overconfident: in the measuring session at threshold 0.95, active, 30.0% of the decisions",
            "Recommended remedy: “remedy” (what it does).",
        ],
    ),
    "overconfident, nothing helps": (
        ((3.0, 2.0, 5.0), ABOVE, {"sure": -1.0}),
        ["Beliefs are overconfident:", "No remedy is recommended: none improves these taps significantly."],
    ),
    "unknown": (
        ((3.0, 0.5, 9.0), WITHIN, {}),
        [
            "Too few data to assess the calibration of beliefs:",
            "No remedy is recommended: these taps are too few to decide whether one is needed. “remedy” (what it does) "
            "would still gain 0.05",
        ],
    ),
    "unknown, nothing helps": (
        ((3.0, 0.5, 9.0), WITHIN, {"sure": -1.0}),
        ["Too few data to assess", "No remedy is recommended: these taps are too few to decide whether one is needed."],
    ),
    "no doubt": (
        ((None, None, None), UNTESTED, {}),
        [
            "Calibration cannot be assessed:",
            "No remedy is recommended: these taps are too few to decide whether one is needed. “remedy” (what it does) "
            "would still gain 0.05",
        ],
    ),
    "right, though more could be had": (
        ((1.0, 0.7, 1.5), WITHIN, {}),
        [
            "Beliefs are calibrated:",
            "No remedy is needed. “remedy” (what it does) would still gain 0.05",
        ],
    ),
    "right, nothing to be had": (
        ((1.0, 0.7, 1.5), WITHIN, {"sure": -1.0}),
        ["Beliefs are calibrated:", "No remedy is needed, and none has a significant gain."],
    ),
    "cautious": (
        ((0.5, 0.2, 0.8), BELOW, {"sure": -1.0}),
        ["Beliefs are cautious:", "No remedy is needed, and none has a significant gain."],
    ),
}


@pytest.mark.parametrize(("given", "words"), WORDS.values(), ids=WORDS)
def test_the_verdict_in_words(given, words):
    """How beliefs are, the cause as it was given, and what follows, in three sentences with their numbers."""
    factor, p, changes = given
    remedies = measured(score("remedy", **changes), judged=judged(factor, p))
    first, cause, last = verdict(Cause(None, "The cause."), remedies, 0.95, TITLES, "mm")
    assert first.startswith(words[0])
    assert cause == "The cause."
    assert last.startswith(words[1])
    assert ("would still gain" in last) == ("would still gain" in words[1])
    if factor[0] is not None:
        assert f"{factor[0]:.1f} ({factor[1]:.1f} to {factor[2]:.1f}) times as often" in first
        assert first.endswith("; a correct model on 20 taps per class gives 1.1 (0.6 to 1.9).")


@pytest.mark.parametrize(
    ("median", "beside"),
    [(1.1, "gives 1.1 (0.6 to 1.9)."), (np.nan, "makes no wrong decision.")],
    ids=["a right model has doubts", "a right model has none"],
)
def test_mistakes_without_a_doubt_are_said_to_be_some(median, beside):
    endless = judged((np.inf,) * 3, median=median)
    first = verdict(Cause(None, ""), measured(score("remedy"), judged=endless), 0.95, TITLES, "mm")[0]
    assert first == (
        "Beliefs are overconfident: in the measuring session at threshold 0.95, active, 30.0% of the decisions are "
        "wrong, although all beliefs are 1, so the miscalibration factor is infinite; a correct model on 20 taps per "
        f"class {beside}"
    )


def test_an_infinite_end_leaves_a_factor_that_can_be_told():
    """As where trials that were cut short might all have been wrong and sure: that is not a lack of doubt."""
    found = {"factor": [0.64, 0.05, None], "doubt": [0.476, 0.4, 0.5], "wrong": [0.3, 0.0, 1.0]}
    factor = factor_of(found)
    assert factor == (0.64, 0.05, np.inf)
    assert factor_of(found | {"factor": [0.64, None, None]}) == (0.64, None, None)
    first = verdict(Cause(None, ""), measured(score("remedy"), judged=judged(factor)), 0.95, TITLES, "mm")[0]
    assert "0.6 (0.1 to >99) times as often" in first
    little = judged((0.5, 0.0002, 2.0))
    assert "0.5 (0.0 to 2.0) times" in verdict(Cause(None, ""), measured(judged=little), 0.9, TITLES, "mm")[0]


def test_the_verdict_says_what_decisions_were_made_on():
    told = verdict(Cause(None, ""), measured(), 0.95, TITLES, "mm", "other taps of the training session")[0]
    assert "overconfident: in other taps of the training session at threshold 0.95, active" in told


def test_the_sentence_of_a_remedy_has_its_numbers():
    """Gain per tap and its interval, error and its change, reaction time and factor; and whether that is enough."""
    remedies = measured(score("remedy", 0.5, change=(-0.1, -0.2, -0.05)))
    last = verdict(Cause(None, ""), remedies, 0.95, TITLES, "mm")[-1]
    for words in (
        "“remedy” (what it does). It gains 0.050 (0.030 to 0.070) nats of log score per tap over 10 taps",
        "at 6.5 taps, the mean reaction time of the current setting, it changes the object error by −0.10 (−0.20 to "
        "−0.05) mm, to 0.4 mm",
        "at threshold 0.95 it takes 7.5 taps, with a miscalibration factor of 1.0 (0.7 to 1.3).",
    ):
        assert words in last
    assert "remain overconfident" not in last
    lower = measured(score("remedy", 0.5, change=(-0.1, -0.2, -0.05)), theta=0.8)
    said = (
        "at 6.5 taps, the mean reaction time of the current setting at threshold 0.8 (the highest at which the test "
        "taps suffice)"
    )
    assert said in verdict(Cause(None, ""), lower, 0.95, TITLES, "mm")[-1]
    for low, stays in ((1.8, False), (2.0, True)):  # a right model gives up to 1.9
        worse = measured(score("remedy", factor=(2.5, low, 3.0)))
        said = verdict(Cause(None, ""), worse, 0.95, TITLES, "mm")[-1]
        assert said.endswith("Beliefs remain overconfident with it.") == stays
    bare = measured(score("remedy", change=None, error=None, factor=(None, None, None)), n=1)
    assert verdict(Cause(None, ""), bare, 0.95, TITLES, "mm")[-1].endswith(
        "(0.30 to 0.70) nats of log score per tap over 1 tap."
    )


def test_too_few_taps_are_named():
    """After the numbers; where a right model leaves neither mistake nor doubt that is said."""
    first = verdict(Cause(None, ""), measured(judged=judged(few="There are too few.", median=np.nan)), 0.95, {}, "mm")[
        0
    ]
    told = (
        "(2.0 to 5.0) times as often as the beliefs imply; a correct model on 20 taps per class makes no wrong "
        "decision."
    )
    assert first.endswith(f"{told} There are too few.")
