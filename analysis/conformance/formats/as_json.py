"""A report as an object of JSON, by `report.schema.json`."""

from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any, NamedTuple

from ..case import Case
from ..levels import LevelResult
from ..verdict import Verdict

REPORT_FORMAT = 1


class Claim(NamedTuple):
    """What was checked, and how.

    Attributes:
        kit: Version of the kit.
        precision: Of the program's numbers.
        without: Quantities that were not compared.
    """

    kit: str
    precision: str
    without: tuple[str, ...]


def report_object(
    title: str,
    claim: Claim,
    levels: Sequence[LevelResult],
    verdicts: Sequence[Verdict],
    cases: Mapping[str, Case],
    sentences: Sequence[str],
    passed: bool,
) -> dict[str, Any]:
    """All that a report says.

    Args:
        title: What was checked.
        claim: How.
        levels: Results of the levels.
        verdicts: Of the cases.
        cases: By name.
        sentences: Likely causes, numbers of cases and levels in words.
        passed: Whether all is well.
    """
    return {
        "format": REPORT_FORMAT,
        "title": title,
        "kit": claim.kit,
        "software": f"solidtouch {version('solidtouch')}",
        "precision": claim.precision,
        "without": list(claim.without),
        "passed": passed,
        "levels": [level._asdict() | {"passes": level.passes} for level in levels],
        "cases": [_verdict(verdict, cases[verdict.case]) for verdict in verdicts],
        "sentences": list(sentences),
    }


def _verdict(verdict: Verdict, case: Case) -> dict[str, Any]:
    """A verdict; what there is not is left out."""
    known = {
        "about": case.about,
        "tap": verdict.tap,
        "quantity": verdict.quantity,
        "sentence": verdict.sentence,
        "cause": verdict.cause,
        "about_cause": verdict.about,
        "seconds": None if verdict.seconds is None else round(verdict.seconds, 3),
    }
    start = {"case": case.name, "level": case.level, "status": verdict.status}
    return start | {name: value for name, value in known.items() if value not in (None, "")}
