"""Checks of this installation that need no data: engines against exact cases, calibration of beliefs."""

from collections.abc import Callable, Iterator

from ...hardware.simulator.session import simulate_session
from ...hardware.simulator.settings import preset
from ...models.measurement.histogram import fit
from ...models.progress import Progress
from ..conformance.catalogue import catalogue
from ..conformance.routes import ROUTES
from ..conformance.run import run_route
from ..conformance.verdict import Verdict, described
from ..correctness.sbc import LEVEL, SHORT, calibrate
from ..experiment.crosscheck import CrossCheck, crosscheck_model
from ..experiment.sources import right_model
from ..page.stages import Check, counted, timed_check

_EPISODES, _TAPS = 4, 20
_CALLED = {"arrays": "Monte Carlo in arrays", "cpu": "Monte Carlo trials"}


def check_routes(progress: Progress, seed: int = 0) -> Check:
    """All routes on simulated taps of preset `paper`, compared."""
    return timed_check("all routes", "each other, on simulated taps", lambda: _routes(progress, seed))


def check_engines(progress: Progress) -> Iterator[Check]:
    """All cases on each engine, one after the other."""
    for route in ROUTES:
        yield timed_check(f"engine {route}", "60-digit arithmetic", lambda route=route: _conformance(progress, route))


def check_beliefs(progress: Progress, seed: int = 0) -> Iterator[Check]:
    """A short calibration of each route in `SHORT`."""
    for route, trials in SHORT.items():
        work = _calibration(progress, route, trials, seed)
        yield timed_check(f"beliefs, {_CALLED.get(route, f'engine {route}')}", "truth, on drawn episodes", work)


def _routes(progress: Progress, seed: int) -> tuple[str, bool]:
    train, test = (simulate_session(preset("paper"), seed, session) for session in (0, 1))
    model = fit(train, train.grid())
    advance = progress("Cross-check", _EPISODES)
    found = crosscheck_model(
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


def _calibration(progress: Progress, route: str, trials: int, seed: int) -> Callable[[], tuple[str, bool]]:
    def work() -> tuple[str, bool]:
        advance = progress(f"Calibration, {route}", 2 * trials)
        found = calibrate(right_model(seed), {route: trials}, level=LEVEL / len(SHORT), seed=seed, progress=advance)
        return f"{len(found.failed)} of {found.tests} tests on {2 * trials} episodes fail", found.passed

    return work


def _conformance(progress: Progress, route: str) -> tuple[str, bool]:
    cases = list(catalogue().values())
    advance = progress(f"Conformance, {route}", len(cases))
    verdicts = list(counted(run_route(route, cases), advance))
    wrong = [verdict for verdict in verdicts if verdict.status not in ("pass", "left out")]
    passed, left = _count(verdicts, "pass"), _count(verdicts, "left out")
    asked = f"{passed} of {len(verdicts) - left} cases pass"
    first = f"; {wrong[0].case}: {described(wrong[0])}" if wrong else ""
    return f"{asked}{f', {left} do not apply' if left else ''}{first}", not wrong and passed > 0


def _count(verdicts: list[Verdict], status: str) -> int:
    return sum(verdict.status == status for verdict in verdicts)
