"""Whether this installation computes what the paper says: all checks that take no data, in two minutes at most."""

import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

from ...hardware.data_collection import simulate_session
from ...hardware.presets import preset
from ...models.histogram import fit
from ..conformance.catalogue import catalogue
from ..conformance.routes import ROUTES
from ..conformance.run import run_route
from ..conformance.verdict import Verdict, described
from .crosscheck import CrossCheck, crosscheck
from .sbc import LEVEL, SHORT, calibrate
from .sbc_chain import right_model

_EPISODES, _TAPS = 4, 20
_CALLED = {"arrays": "Monte Carlo in arrays", "cpu": "Monte Carlo trials"}

type Stage = Callable[[str, int], Callable[[int], None]]
"""Starts the progress of a stage of so many steps and gives the function that advances it."""


class Check(NamedTuple):
    """One line of the table.

    Attributes:
        name: What was checked.
        against: Against what.
        found: What came out, in words.
        passed: Whether it is as it must be.
        seconds: How long it took.
    """

    name: str
    against: str
    found: str
    passed: bool
    seconds: float


def validate(stage: Stage, seed: int = 0) -> Iterator[Check]:
    """The checks, one after the other.

    Args:
        stage: Told of progress.
        seed: Of simulated taps and drawn episodes.
    """
    yield _timed("all routes", "each other, on simulated taps", lambda: _routes(stage, seed))
    for route in ROUTES:
        yield _timed(f"engine {route}", "60-digit arithmetic", lambda route=route: _conformance(stage, route))
    for route, trials in SHORT.items():
        work = _calibration(stage, route, trials, seed)
        yield _timed(f"beliefs, {_CALLED.get(route, f'engine {route}')}", "truth, on drawn episodes", work)


def _timed(name: str, against: str, work: Callable[[], tuple[str, bool]]) -> Check:
    began = time.monotonic()
    found, passed = work()
    return Check(name, against, found, passed, time.monotonic() - began)


def _routes(stage: Stage, seed: int) -> tuple[str, bool]:
    train, test = (simulate_session(preset("paper"), seed, session) for session in (0, 1))
    model = fit(train, train.grid())
    advance = stage("Cross-check", _EPISODES)
    found = crosscheck(
        model,
        model.usable(test),
        train=train,
        episodes=_EPISODES,
        length=_TAPS,
        seed=seed,
        progress=lambda: advance(1),
    )
    return _differences(found), found.passed


def _differences(found: CrossCheck) -> str:
    choices = found.differing_decisions + found.differing_moves
    largest = max(row.largest for row in found.rows if row.quantity == "posterior")
    return f"posteriors within {largest:.1e}, {choices} decisions and moves differ"


def _conformance(stage: Stage, route: str) -> tuple[str, bool]:
    cases = list(catalogue().values())
    advance = stage(f"Conformance, {route}", len(cases))
    verdicts = run_route(route, cases, lambda _: advance(1))
    wrong = [verdict for verdict in verdicts if verdict.status not in ("pass", "left out")]
    passed, left = _count(verdicts, "pass"), _count(verdicts, "left out")
    asked = f"{passed} of {len(verdicts) - left} cases pass"
    first = f"; {wrong[0].case}: {described(wrong[0])}" if wrong else ""
    return f"{asked}{f', {left} do not apply' if left else ''}{first}", not wrong and passed > 0


def _count(verdicts: list[Verdict], status: str) -> int:
    return sum(verdict.status == status for verdict in verdicts)


def _calibration(stage: Stage, route: str, trials: int, seed: int) -> Callable[[], tuple[str, bool]]:
    def work() -> tuple[str, bool]:
        advance = stage(f"Calibration, {route}", 2 * trials)
        found = calibrate(right_model(seed), {route: trials}, level=LEVEL / len(SHORT), seed=seed, progress=advance)
        return f"{len(found.failed)} of {found.tests} tests on {2 * trials} episodes fail", found.passed

    return work
