"""Labelled tables of an audit, from its summary."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import xarray as xr

from ..page.labelled import interval_columns, labelled
from ..page.page import Row
from .variance.causes import suspect_part


def calibration_table(summary: Row) -> xr.Dataset:
    """Miscalibration of decisions and of a correct model, for all objects and each, dim what."""
    judged = summary["miscalibration"]["evidence"]["judged"]
    parts: Mapping[str, Row] = {"all": judged, **judged["each"]}
    rows = (
        {
            "what": name,
            **interval_columns("factor", part["factor"]),
            "unbounded": part["unbounded"],
            "right_factor": part["beside"]["median"],
            "right_factor_low": part["beside"]["low"],
            "right_factor_high": part["beside"]["high"],
            "p_above": part["beside"]["above"],
            "p_below": part["beside"]["below"],
        }
        for name, part in parts.items()
    )
    table = labelled(rows, ["what"])
    return table.assign_attrs(verdict=summary["verdict"]["state"], theta=summary["threshold"])


def causes_table(summary: Row) -> xr.Dataset | None:
    """Parts of the variance of evidence with their p-values where they have a test, dim cause."""
    variance = summary["first_cause"]["evidence"]["variance"]
    if variance is None:
        return None
    p = _cause_p(variance)
    first = summary["first_cause"]["name"]
    rows = (
        {"cause": row["name"], **row, "p": p.get(row["name"]), "first": row["name"] == first}
        for row in variance["parts"]
    )
    return labelled(rows, ["cause"]).drop_vars("name")


def independence_table(summary: Row) -> xr.Dataset:
    """Tests of the independence of taxels and of samples in time, dim test."""
    evidence = summary["first_cause"]["evidence"]
    taxels = ({**row, "test": f"taxels: {row['test']}", "p": row["family_p"]} for row in evidence["taxels"]["tests"])
    times = ({"test": f"times: {name}", "p": p} for name, p in evidence["times"]["p"].items())
    return labelled([*taxels, *times], ["test"]).drop_vars("family_p")


def checks_table(summary: Row) -> xr.Dataset:
    """Statistics of the taps beside those of replicates from the fitted model, dim statistic."""
    return labelled(summary["first_cause"]["evidence"]["predictive_checks"], ["statistic"])


def leakage_table(summary: Row) -> xr.Dataset:
    """Accuracy of what is inferred without touch, dims quantity and source, and the verdict on each quantity."""
    told = summary["first_cause"]["evidence"]["leakage"]["told"]
    common = "quantity", "verdict", "chance"
    rows = (
        {"quantity": row["quantity"], "source": source, **interval_columns("accuracy", triple)}
        for row in told
        for source, triple in row.items()
        if source not in common
    )
    table = labelled(rows, ("quantity", "source"))
    return table.merge(labelled(({name: row[name] for name in common} for row in told), ["quantity"]))


def after_taps_table(summary: Row) -> xr.Dataset:
    """Scores of beliefs after some taps, dims taps and what."""
    rows = (
        {"taps": row["taps"], "what": what} | _all_columns(scores)
        for row in summary["miscalibration"]["evidence"]["after_taps"]
        for what, scores in row.items()
        if isinstance(scores, Mapping)
    )
    return labelled(rows, ("taps", "what"))


def remedies_table(summary: Row) -> xr.Dataset:
    """Gain of each remedy over the current setting, which comes first, dim remedy."""
    evidence = summary["remedy"]["evidence"]
    units = {
        **dict.fromkeys(("log_score", "gain", "sure_gain", "gain_per_tap"), "nats"),
        "what_error": summary["units"]["what"],
        "where_error": summary["units"]["where"],
        "taps": "taps",
    }
    table = labelled(map(_remedy, (evidence["as_it_is"], *evidence["ranking"])), ["remedy"], units)
    return table.assign_attrs(chosen=summary["remedy"]["chosen"] or "none", policy=evidence["policy"])


def _remedy(row: Row) -> dict[str, Any]:
    return {
        "remedy": row["name"],
        **interval_columns("log_score", row["log_score"]),
        **interval_columns("gain", row["gain"]),
        "sure_gain": row["sure_gain"],
        **interval_columns("gain_per_tap", row["gain_per_tap"]),
        **interval_columns("what_error", row["error"]),
        **interval_columns("what_error_difference", row["error_change"]),
        **interval_columns("where_error_difference", row["where_error_change"]),
        "taps": row["taps"],
        **interval_columns("factor", row["factor"]),
        "unbounded": row["unbounded"],
        "stopped": row["stopped"],
        "worthwhile": row.get("worthwhile", False),
        "title": row["title"],
    }


def _all_columns(scores: Mapping[str, Sequence[float | None]]) -> dict[str, float | None]:
    return {
        column: value for name, triple in scores.items() for column, value in interval_columns(name, triple).items()
    }


def _cause_p(variance: Row) -> dict[str, float | None]:
    """P-values of the causes that have a test of their own."""
    suspects: Iterator[tuple[str, float | None]] = (
        (suspect_part(row["name"]), row["p"]) for row in variance["suspects"]
    )
    return {"session": variance["session_p"], variance["covariate"]: variance["covariate_p"], **dict(suspects)}
