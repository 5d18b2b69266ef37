"""What of an audit goes into `audit.json`: objects with the names of their fields."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from solidtouch.analysis.audit.guarantees import PromiseTest
from solidtouch.analysis.audit.remedy_scores import BeliefEvidence
from solidtouch.analysis.audit.summary import _after_taps, _clean, _judged, _other_sessions, _tuned
from solidtouch.analysis.audit.variance.causes import seen, unseen_parts
from solidtouch.analysis.stats.reliability import COUNTED
from solidtouch.analysis.stats.right_exponent import Tuned
from solidtouch.analysis.stats.right_model import Beside


def test_what_stands_beside_a_factor_has_names():
    """Of all objects and of each; without a number there is none."""
    every, own = Beside(3.2, 2.9, 1.9, 4.4, 0.2, 0.9), Beside(np.nan, 1.0, 0.5, 2.0, 1.0, 1.0)
    judged = BeliefEvidence((3.2, 2.0, 5.0), 0.1, every, True, {"rod": ((None, None, None), own)}, 60, "Few.")
    found = _clean(_judged(judged))
    assert found == {
        "factor": [3.2, 2.0, 5.0],
        "unbounded": False,
        "wrong": 0.1,
        "beside": {"value": 3.2, "median": 2.9, "low": 1.9, "high": 4.4, "above": 0.2, "below": 0.9},
        "exact": True,
        "each": {
            "rod": {
                "factor": [None, None, None],
                "unbounded": False,
                "beside": {"value": None, "median": 1.0, "low": 0.5, "high": 2.0, "above": 1.0, "below": 1.0},
            }
        },
        "taps": 60,
        "few": "Few.",
    }
    json.dumps(found, allow_nan=False)


def test_an_infinite_factor_is_said_in_words():
    """JSON has no number for it."""
    beside = Beside(np.inf, np.nan, np.nan, np.nan, 0.005, 1.0)
    judged = BeliefEvidence((np.inf,) * 3, 0.1, beside, True, {"rod": ((np.inf,) * 3, beside)}, 60)
    found = json.loads(json.dumps(_clean(_judged(judged)), allow_nan=False))
    for part in (found, found["each"]["rod"]):
        assert (part["factor"], part["unbounded"]) == ([None, None, None], True)
        assert part["beside"]["above"] == 0.005


@pytest.mark.parametrize(("factor", "held"), [((2.0, 1.0, 3.0), True), ((2.0, None, None), False)])
def test_what_intervals_hold_is_said_where_there_are_any(factor, held):
    """Beside what tuning sessions say."""
    audit = SimpleNamespace(
        recalibrated=SimpleNamespace(tuning=(0.1, 0.25)),
        parts=SimpleNamespace(of_one_session=False, halved=False),
        measured=SimpleNamespace(judged=SimpleNamespace(factor=factor)),
    )
    said = _other_sessions(audit)
    assert said.startswith(" In the 2 tuning sessions, 10.0% to 25.0% of the decisions are wrong")
    assert said.endswith("not other sessions.") == held
    assert ("intervals" in said) == held


def test_scores_after_taps_are_those_of_their_object():
    """Dims may come in any order; settings that stop by themselves are left out."""
    dims, sizes = ("counted", "what", "setting"), (2, 3, 3)
    names = ("wrong", "doubt", "calibration_error", "log_loss", "brier", "factor")
    columns = [f"{name}{end}" for name in names for end in ("", "_low", "_high")]
    numbers = np.random.default_rng(0).random((len(columns), *sizes))
    coords = {
        "what": ["all", "a", "b"],
        "contacts": ("setting", [0, 1, 5]),
        "theta": ("setting", [0.9, np.nan, np.nan]),
    }
    data = xr.Dataset({name: (dims, values) for name, values in zip(columns, numbers, strict=True)}, coords)

    rows = _after_taps(data)

    assert [row["taps"] for row in rows] == [1, 5]
    for row, setting in zip(rows, (1, 2), strict=True):
        for w, what in enumerate(("all", "a", "b")):
            found = [value for name in names for value in row[what][name]]
            assert found == numbers[:, COUNTED.index("all"), w, setting].tolist()


def test_a_promise_says_beside_what_it_is_exceeded():
    """Nothing where nothing was simulated."""
    assert _clean(PromiseTest(exceeded=False)) == {"exceeded": False, "beside": None}
    assert _clean(PromiseTest(True, Beside(2.0, 1.0, 0.5, 1.5, 0.01, 1.0))) == {
        "exceeded": True,
        "beside": {"value": 2.0, "median": 1.0, "low": 0.5, "high": 1.5, "above": 0.01, "below": 1.0},
    }


def test_what_was_tuned_stands_beside_a_right_model():
    """With the sentence of the page; a saturation only where one was tuned."""
    low, inside = Beside(0.4, 0.9, 0.8, 1.0, 1.0, 0.05), Beside(2.0, 3.0, 1.5, 50.0, 0.9, 0.3)
    found = _clean(_tuned(Tuned(low, inside, 20, 19)))
    assert found["power"] == {**low._asdict(), "outside": True}
    assert found["saturation"] == {**inside._asdict(), "outside": False}
    assert (found["taps"], found["simulations"]) == (20, 19)
    assert found["sentence"] == Tuned(low, inside, 20, 19).sentence
    assert _tuned(Tuned(low, None, 20, 19))["saturation"] is None


@pytest.mark.parametrize(
    ("covariate", "sessions", "unseen"), [("order", 2, {"place"}), ("place", 1, {"order", "session", "serial"})]
)
def test_the_figure_of_causes_leaves_out_what_taps_cannot_show(covariate, sessions, unseen):
    """As the table does: no share stands there for what was not tested."""
    parts = ["place", "order", "session", "serial", "covariate heat"]
    split = xr.Dataset(
        {name: ("part", np.ones(5)) for name in ("share", "share_low", "share_high")},
        {"part": parts},
        {"covariate": covariate, "sessions": sessions, "suspects": [], "suspect_p": []},
    )
    assert unseen_parts(split) == unseen
    for values in seen(split).data_vars.values():
        assert set(split["part"].values[np.isnan(values.values)]) == unseen
