"""Checks of this installation: the function `solidtouch.validate` and its report."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...models.progress import Progress, no_progress
from ...models.threads import cores
from ..page.page import Brief, Page, Table
from ..page.report import Report
from ..page.stages import Check
from ..tasks.crew import ONE_BY_ONE, on_runner
from ..tasks.local import in_processes
from .checks import checked, checked_beside, checks

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, eq=False, repr=False)
class ValidationReport(Report):
    """Whether this installation computes what it should.

    Attributes:
        found: All checks.
        seconds: Whether the printed table shows how long each took.
    """

    found: tuple[Check, ...]
    seconds: bool = False

    def _page(self) -> Page:
        head = ["check", "against", "found", "", *(["seconds"] if self.seconds else [])]
        rows = [
            [
                *(check.name, check.against, check.found, "ok" if check.passed else "FAILED"),
                *([f"{check.seconds:.0f}"] if self.seconds else []),
            ]
            for check in self.found
        ]
        failed = [check.name for check in self.found if not check.passed]
        verdict = f"All {len(self.found)} checks passed."
        if failed:
            verdict = f"{len(failed)} of {len(self.found)} checks FAILED: {', '.join(failed)}."
        return Page("Validation", [Brief(Table(head, rows, words={1, 2, 3})), Brief(verdict)], [])

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return all(check.passed for check in self.found)

    @property
    def checks(self) -> "xr.Dataset":
        """Reference, result and duration of each check, dim check."""
        from ..page.labelled import labelled  # noqa: PLC0415 - only programs ask, and xarray takes long to import

        rows = ({"check": check.name, **check._asdict()} for check in self.found)
        return labelled(rows, ["check"], {"seconds": "s"}).drop_vars("name")


def validate(
    seed: int = 0, *, seconds: bool = False, workers: int | None = None, progress: Progress = no_progress
) -> ValidationReport:
    """Cross-check, conformance and a short calibration, in half a minute.

    Args:
        seed: Random seed of simulated taps and drawn episodes.
        seconds: Whether the printed table shows how long each check took.
        workers: Number of processes; 1 is this one, `None` one per core.
        progress: Called with the name and number of the checks; returns the function that advances it.
    """
    processes = cores(workers)
    planned = checks()
    advance = progress("Checks", len(planned))
    if processes == 1:
        found = ONE_BY_ONE(checked, planned, seed, advance)
    else:
        found = on_runner(in_processes(processes))(checked_beside, planned, seed, advance)
    return ValidationReport(tuple(found), seconds)
