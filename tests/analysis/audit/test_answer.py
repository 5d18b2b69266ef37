"""The verdict of an audit in short."""

import pytest
from solidtouch.analysis.audit.answer import answer

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
