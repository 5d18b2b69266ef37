"""Labelled tables of an audit, from a summary with the keys that they read."""

import numpy as np
from solidtouch.analysis.audit.report import AuditReport

BESIDE = {"value": 2.0, "median": 1.0, "low": 0.5, "high": 1.5, "above": 0.01, "below": 1.0}
WHOLE = {"name": "as it is", "log_score": [-2, -3, -1], "gain": None, "sure_gain": None, "gain_per_tap": None}
WHOLE |= {"error": [0.5, 0.4, 0.6], "error_change": None, "where_error_change": None, "taps": 7.0, "stopped": 0.9}
WHOLE |= {"factor": [None, 0.5, None], "unbounded": True, "title": "nothing changed"}
BETTER = {**WHOLE, "name": "exponent", "gain": [3, 2, 4], "sure_gain": 1.0, "gain_per_tap": [0.3, 0.2, 0.4]}
BETTER |= {"error_change": [-0.1, -0.2, 0.0], "where_error_change": [0.0, -1.0, 1.0], "worthwhile": True}
PARTS = [{"name": name, "words": name, "share": 0.5, "ratio": 1.0} for name in ("session", "place", "covariate heat")]
VARIANCE = {"parts": PARTS, "session_p": 0.002, "covariate": "place", "covariate_p": None}
VARIANCE |= {"suspects": [{"name": "heat", "p": 0.3, "follows_order": 0.1}]}
TAXEL = {"test": "rank", "effect": 0.2, "effect_low": 0.1, "effect_high": 0.3, "family_p": 0.01, "drift_p": 0.5}
TOLD = [{"quantity": "what", "verdict": "leaks", "chance": 0.2, "offset": [0.4, 0.3, 0.5], "taps": [0.9, 0.8, 1.0]}]
SUMMARY = {
    "threshold": 0.95,
    "units": {"what": "mm", "where": "m"},
    "verdict": {"state": "overconfident"},
    "first_cause": {
        "name": "session",
        "evidence": {
            "variance": VARIANCE,
            "taxels": {"tests": [TAXEL]},
            "times": {"p": {"lag1": 0.02}},
            "predictive_checks": [{"statistic": "lag", "observed": 0.6, "low": 0.0, "high": 0.1, "p": 0.03}],
            "leakage": {"told": TOLD},
        },
    },
    "miscalibration": {
        "evidence": {
            "judged": {
                "factor": [2.0, 1.5, 3.0],
                "unbounded": False,
                "beside": BESIDE,
                "each": {"rod": {"factor": [None, None, None], "unbounded": True, "beside": BESIDE}},
            },
            "after_taps": [{"taps": 5, "all": {"wrong": [0.1, 0.0, 0.2]}, "rod": {"wrong": [0.3, None, None]}}],
        }
    },
    "remedy": {"chosen": None, "evidence": {"as_it_is": WHOLE, "ranking": [BETTER], "policy": "active"}},
}
REPORT = AuditReport(None, SUMMARY)  # pyright: ignore[reportArgumentType]


def numbers(table, *names, **at):
    return [float(table[name].sel(at)) for name in names]


def test_miscalibration_stands_beside_a_right_model():
    table = REPORT.calibration
    names = "factor", "factor_low", "factor_high", "right_factor", "right_factor_low", "right_factor_high", "p_above"

    assert numbers(table, *names, what="all") == [2.0, 1.5, 3.0, 1.0, 0.5, 1.5, 0.01]
    assert np.isnan(numbers(table, "factor", what="rod"))
    assert table["unbounded"].values.tolist() == [False, True]
    assert table.attrs == {"verdict": "overconfident", "theta": 0.95}


def test_causes_have_the_p_values_of_their_tests():
    """None where a cause has no test of its own, or it gave no number."""
    table = REPORT.causes
    assert table is not None
    np.testing.assert_array_equal(table["p"], [0.002, np.nan, 0.3])
    assert table["first"].values.tolist() == [True, False, False]
    without = {**SUMMARY, "first_cause": {"evidence": {"variance": None}}}
    assert AuditReport(None, without).causes is None  # pyright: ignore[reportArgumentType]


def test_tests_of_taxels_and_times_are_in_one_table():
    table = REPORT.independence
    assert numbers(table, "effect", "effect_low", "effect_high", "p", test="taxels: rank") == [0.2, 0.1, 0.3, 0.01]
    assert numbers(table, "p", test="times: lag1") == [0.02]
    assert numbers(REPORT.checks, "observed", "p", statistic="lag") == [0.6, 0.03]


def test_leakage_has_a_verdict_for_each_quantity():
    table = REPORT.leakage
    assert numbers(table, "accuracy", "accuracy_low", "accuracy_high", quantity="what", source="offset") == [
        *(0.4, 0.3, 0.5)
    ]
    assert table["verdict"].sel(quantity="what").item() == "leaks"
    assert table["chance"].dims == ("quantity",)


def test_scores_are_of_all_objects_and_each():
    assert numbers(REPORT.after_taps, "wrong", "wrong_low", "wrong_high", taps=5, what="all") == [0.1, 0.0, 0.2]
    assert np.isnan(numbers(REPORT.after_taps, "wrong_low", taps=5, what="rod"))


def test_remedies_are_compared_with_the_present_setting():
    table = REPORT.remedies
    assert table["remedy"].values.tolist() == ["as it is", "exponent"]
    assert numbers(table, "gain", "gain_low", "gain_high", remedy="exponent") == [3, 2, 4]
    assert np.isnan(numbers(table, "gain", "what_error_difference", remedy="as it is")).all()
    assert numbers(table, "what_error_difference_low", "where_error_difference_high", remedy="exponent") == [-0.2, 1.0]
    assert table["worthwhile"].values.tolist() == [False, True]
    assert table["what_error_difference_low"].attrs["units"] == "mm"
    assert table["where_error_difference"].attrs["units"] == "m"
    assert table["gain_per_tap"].attrs["units"] == "nats"
    assert table.attrs == {"chosen": "none", "policy": "active"}
