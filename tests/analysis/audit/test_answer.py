"""The verdict of an audit in short."""

import pytest
from solidtouch.analysis.audit.answer import answer
from solidtouch.analysis.audit.page import cautions, remedy_table

BESIDE = {"median": 1.0, "low": 0.5, "high": 2.0}


@pytest.mark.parametrize(
    ("judged", "words"),
    [
        (
            {"factor": [2.0, 1.5, 3.0]},
            "wrong, 2.0 [1.5, 3.0] times as often as the beliefs imply (a correct model: 1.0 [",
        ),
        ({"unbounded": True}, "wrong, although all beliefs are 1 (a correct model: 1.0 ["),
        ({"unbounded": True, "beside": {"median": None}}, "(a correct model: no wrong one)."),
        ({"wrong": None}, "**Calibration cannot be assessed**: at threshold 0.9 every decision has belief 1."),
    ],
    ids=["finite", "infinite", "none wrong beside", "nothing to judge"],
)
def test_calibration_is_a_sentence(judged, words):
    """Also where a decision is wrong and no belief has a doubt."""
    evidence = {"wrong": 0.1, "factor": [None] * 3, "unbounded": False, "beside": BESIDE} | judged
    summary = {
        "verdict": {"state": "overconfident", "evidence": {"judged": evidence}, "sentences": ["No remedy."]},
        "first_cause": {"name": None, "sentence": "No cause.", "evidence": {"variance": None}},
        "remedy": {"chosen": None, "evidence": {"ranking": []}},
        "threshold": 0.9,
    }
    first, *others = answer(summary)

    assert words in first
    assert others == ["No cause.", "No remedy."]


@pytest.mark.parametrize(
    ("compared_at", "taps", "end"),
    [
        (0.9, 3.891, "of the current setting, 3.89 taps."),
        (0.7, 3.891, "of the current setting at threshold 0.7, 3.89 taps."),
        (0.9, 1.0, "of the current setting, 1 tap."),
    ],
    ids=["as used", "lower", "a single tap"],
)
def test_the_reaction_time_of_a_remedy_says_at_which_threshold_it_is(compared_at, taps, end):
    """If the test taps do not suffice for that in use; the caption of the table says it, too."""
    row = {"name": "exponent", "title": "what it does", "error_change": [-0.1, -0.2, -0.05], "gain_per_tap": None}
    row |= {"error": None, "taps": 11.4, "stopped": 1.0, "factor": None, "unbounded": False, "assumes": ""}
    remedies = {"ranking": [row], "as_it_is": row, "compared_at": compared_at, "reaction_time": taps}
    judged = {"wrong": 0.1, "factor": [2.0, 1.5, 3.0], "unbounded": False, "beside": BESIDE}
    summary = {
        "verdict": {"state": "overconfident", "evidence": {"judged": judged}, "sentences": ["Recommended."]},
        "first_cause": {"name": None, "sentence": "No cause.", "evidence": {"variance": None}},
        "remedy": {"chosen": "exponent", "evidence": remedies},
        "threshold": 0.9,
        "units": {"what": "mm"},
    }

    assert answer(summary)[-1].endswith(f" mm at the mean reaction time {end}")
    caption = remedy_table(summary).caption
    assert f"errors at {end.split(', ')[-1][:-1]}" in caption
    assert ("at threshold 0.7; taps and factor at threshold 0.9" in caption) == (compared_at == 0.7)


def test_only_what_calls_for_care_is_a_warning():
    """That classes were not recorded in blocks stands with the other findings of leakage."""
    unjudged, apart = "Leakage cannot be assessed: taps may begin in contact.", "The subtracted offsets differ."
    good = ["The subtracted offsets do not differ between classes.", "Classes were not recorded in blocks."]

    def warned(judged, *sentences):
        evidence = {"leakage": {"judged": judged, "sentences": list(sentences)}}
        return cautions(
            {
                "verdict": {"evidence": {"judged": {"few": "Too few taps."}}},
                "first_cause": {"evidence": evidence},
                "warnings": ["Some were left out."],
            }
        )

    assert warned(False, unjudged, apart, *good) == ["Too few taps.", unjudged, apart, "Some were left out."]
    assert warned(True, *good) == ["Too few taps.", "Some were left out."]
