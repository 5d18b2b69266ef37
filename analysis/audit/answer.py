"""The verdict of an audit in a few short sentences; `verdict` has it in full."""

from ..page.numbers import bounded, factor, in_taps, percent
from ..page.page import Row
from .verdict import NOT_ENOUGH

_STATES = {
    "overconfident": "Beliefs are overconfident",
    "cautious": "Beliefs are cautious",
    "right": "Beliefs are calibrated",
    NOT_ENOUGH: "Too few data to assess the calibration of beliefs",
}


def answer(summary: Row) -> list[str]:
    """Calibration, main cause and remedy, a sentence each.

    Args:
        summary: Content of the JSON file with the keys `verdict`, `first_cause`, `remedy`, `units` and `threshold`.
    """
    return [_calibration(summary), _cause(summary["first_cause"]), _remedy(summary)]


def _calibration(summary: Row) -> str:
    judged = summary["verdict"]["evidence"]["judged"]
    if judged["wrong"] is None or (judged["factor"][0] is None and not judged["unbounded"]):
        return f"**Calibration cannot be assessed**: at threshold {summary['threshold']:g} every decision has belief 1."
    often = f"{factor(judged['factor'])} times as often as the beliefs imply"
    if judged["unbounded"]:
        often = "although all beliefs are 1"
    right = judged["beside"]
    beside = factor([right["median"], right["low"], right["high"]]) if right["median"] is not None else "no wrong one"
    return (
        f"**{_STATES[summary['verdict']['state']]}**: {percent(judged['wrong'])} of the decisions at threshold "
        f"{summary['threshold']:g} are wrong, {often} (a correct model: {beside})."
    )


def _cause(cause: Row) -> str:
    variance = cause["evidence"]["variance"]
    shares = {part["name"]: part for part in variance["parts"]} if variance else {}
    if cause["name"] not in shares:
        return f"**{cause['sentence'].split('. ')[0].rstrip('.')}.**" if cause["name"] else cause["sentence"]
    part = shares[cause["name"]]
    share = bounded(*(100 * part[f"share{end}"] for end in ("", "_low", "_high")))
    return f"**Main cause: {cause['words']}**, {share} % of the variance of the evidence of {variance['taps']} taps."


def _remedy(summary: Row) -> str:
    remedy, chosen = summary["remedy"]["evidence"], summary["remedy"]["chosen"]
    found = next((row for row in remedy["ranking"] if row["name"] == chosen), None)
    if found is None:
        return summary["verdict"]["sentences"][-1]
    said = f"**Recommended remedy: “{chosen}”** ({found['title']})"
    if found["error_change"]:
        change = bounded(*found["error_change"])
        lower = f" at threshold {remedy['compared_at']:g}" * (remedy["compared_at"] < summary["threshold"])
        said += (
            f", which changes the object error by {change} {summary['units']['what']} at the mean reaction time of the "
            f"current setting{lower}, {in_taps(remedy['reaction_time'])}"
        )
    kept = summary["verdict"]["sentences"][-1]
    return said + "." + " Beliefs remain overconfident with it." * ("remain overconfident" in kept)
