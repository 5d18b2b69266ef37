"""Checks of this installation that need no data: engines against exact cases, calibration of beliefs."""

import os
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from ..conformance.dataset.version import KIT_VERSION
from ..conformance.engines import ROUTES
from ..page.stages import Check, timed_check

if TYPE_CHECKING:
    from ..conformance.verdict import Verdict
    from ..experiment.crosscheck import CrossCheck

SHORT = {"numpy": 300, "numpyro": 200, "filter": 300, "arrays": 1000, "cpu": 1000}
"""Trials of each route and policy of a calibration of some seconds. `xla-cpu` compiles anew for every number of taps,
which takes half a minute, and what it does to a belief is what `arrays` does."""

_EPISODES, _TAPS = 4, 20
_SUMMED = 8  # first taps of each in the sum over all paths, whose time to compile grows with them
_CALLED = {"arrays": "Monte Carlo in arrays", "cpu": "Monte Carlo trials"}


class Planned(NamedTuple):
    """A check that is to be done, and what finds its answer with a random seed."""

    name: str
    against: str
    find: Callable[[int], tuple[str, bool]]


def checks() -> list[Planned]:
    """All routes compared, all cases on each engine, and a short calibration of each route in `SHORT`.

    The two that take longest come first, so that two processes end together.
    """
    return [
        Planned("all routes", "each other, on simulated taps", _routes),
        *(
            Planned(f"engine {route}", f"60-digit arithmetic, kit {KIT_VERSION}", partial(_conformance, route))
            for route in sorted(ROUTES, key="numpyro".__ne__)
        ),
        *(
            Planned(f"beliefs, {_CALLED.get(route, f'engine {route}')}", "truth, on drawn episodes", work)
            for route, work in ((route, partial(_calibration, route, trials)) for route, trials in SHORT.items())
        ),
    ]


def checked(check: Planned, seed: int) -> Check:
    """Does a check."""
    return timed_check(check.name, check.against, partial(check.find, seed))


def checked_beside(check: Planned, seed: int) -> Check:
    """Does a check in a process that has one core, on which threads of XLA would only take turns with it."""
    os.environ.setdefault("NPROC", "1")
    return checked(check, seed)


def _routes(seed: int) -> tuple[str, bool]:
    from ...hardware.simulator.session import simulate_session
    from ...hardware.simulator.settings import preset
    from ...models.measurement.histogram import fit
    from ..experiment.crosscheck import crosscheck_model

    train, test = (simulate_session(preset("paper"), seed, session) for session in (0, 1))
    model = fit(train, train.grid())
    usable = model.usable(test)
    found = crosscheck_model(
        model, usable, train=train, episodes=_EPISODES, length=_TAPS, sequence_taps=_SUMMED, seed=seed
    )
    return _differences(found), found.passed


def _differences(found: "CrossCheck") -> str:
    choices = found.differing_decisions + found.differing_moves
    largest = max(row.largest for row in found.rows if row.quantity == "posterior")
    return f"posteriors within {largest:.1e}, {choices} decisions and moves differ"


def _calibration(route: str, trials: int, seed: int) -> tuple[str, bool]:
    from ..correctness.sbc import LEVEL, calibrate
    from ..experiment.sources import right_model

    found = calibrate(right_model(seed), {route: trials}, level=LEVEL / len(SHORT), seed=seed)
    return f"{len(found.failed)} of {found.tests} tests on {2 * trials} episodes fail", found.passed


def _conformance(route: str, _seed: int) -> tuple[str, bool]:
    from ..conformance.catalogue import catalogue
    from ..conformance.run import run_route
    from ..conformance.verdict import described

    verdicts = list(run_route(route, list(catalogue().values())))
    wrong = [verdict for verdict in verdicts if verdict.status not in ("pass", "left out")]
    passed, left = _count(verdicts, "pass"), _count(verdicts, "left out")
    asked = f"{passed} of {len(verdicts) - left} cases pass"
    first = f"; {wrong[0].case}: {described(wrong[0])}" if wrong else ""
    return f"{asked}{f', {left} do not apply' if left else ''}{first}", not wrong and passed > 0


def _count(verdicts: list["Verdict"], status: str) -> int:
    return sum(verdict.status == status for verdict in verdicts)
