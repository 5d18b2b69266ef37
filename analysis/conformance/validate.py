"""The kit as a check of this installation: the engines of this software on all cases."""

from collections.abc import Iterator

from ..page.stages import Check, Progress, timed_check
from .catalogue import catalogue
from .routes import ROUTES
from .run import run_route
from .verdict import Verdict, described


def check_engines(progress: Progress) -> Iterator[Check]:
    """All cases on each engine, one after the other.

    Args:
        progress: Told the name and size of every stage.
    """
    for route in ROUTES:
        yield timed_check(f"engine {route}", "60-digit arithmetic", lambda route=route: _conformance(progress, route))


def _conformance(progress: Progress, route: str) -> tuple[str, bool]:
    cases = list(catalogue().values())
    advance = progress(f"Conformance, {route}", len(cases))
    verdicts = run_route(route, cases, lambda _: advance(1))
    wrong = [verdict for verdict in verdicts if verdict.status not in ("pass", "left out")]
    passed, left = _count(verdicts, "pass"), _count(verdicts, "left out")
    asked = f"{passed} of {len(verdicts) - left} cases pass"
    first = f"; {wrong[0].case}: {described(wrong[0])}" if wrong else ""
    return f"{asked}{f', {left} do not apply' if left else ''}{first}", not wrong and passed > 0


def _count(verdicts: list[Verdict], status: str) -> int:
    return sum(verdict.status == status for verdict in verdicts)
