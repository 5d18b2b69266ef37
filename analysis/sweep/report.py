"""Sweep over a grid of settings: the function `solidtouch.sweep` and its report."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import xarray as xr

from ...models.progress import Progress, no_progress
from ...models.threads import cores
from ..page.page import Brief, Page, Table
from ..page.report import Report
from ..tasks.crew import PATIENCE_S, cluster
from ..tasks.local import in_processes, in_this_process
from ..tasks.task import Runner
from .result import AVERAGED, open_sweep, over_data
from .run import SweepProgress, kept
from .run import sweep as run_sweep


@dataclass(frozen=True, eq=False, repr=False)
class SweepReport(Report):
    """The cells of a study that are done.

    Attributes:
        path: The Zarr store that holds them.
        found: Numbers of cells, and why some failed.
    """

    path: Path
    found: SweepProgress

    def _page(self) -> Page:
        results = self.results
        axes = [[str(name), _shown(results[name].values.tolist())] for name in results.dims]
        axes = Table(("axis", "values"), axes, words={1})
        return Page(f"Sweep {results.attrs['title']}", [*map(Brief, self.sentences), Brief(axes)], [])

    @property
    def sentences(self) -> list[str]:
        """The numbers of cells and the causes of failures."""
        counted = f"{self.path}: {self.found.counts}."
        if not self.found.failed:
            return [counted]
        causes = (f"Failed with: {cause}" for cause in self.found.causes)
        return [counted, *causes, "The tracebacks are in the store; run these cells again with --retry-failed."]

    @property
    def results(self) -> xr.Dataset:
        """All quantities, read when they are used.

        The dims are the axes of the study and theta; `status` and `traceback` lack theta. Cells that are pending or
        failed are NaN.
        """
        return open_sweep(self.path)

    def over_data(self, results: xr.Dataset | None = None, names: Sequence[str] = AVERAGED) -> xr.Dataset:
        """Means over data sets, or over resamples of one, with 95% t-intervals.

        Args:
            results: Selection of `results`, or differences of them; `None` for all.
            names: Quantities of it.

        Returns:
            Each quantity with `<name>_low` and `<name>_high`, and `units`, the number of data sets or resamples.

        Raises:
            InputError: There is one data set without resamples.
        """
        return over_data(self.results if results is None else results, names)

    @classmethod
    def open(cls, path: str | Path) -> Self:
        """The cells in a store, finished or not.

        Raises:
            InputError: There is no such store, or it is damaged.
        """
        return cls(Path(path), kept(Path(path)))


def sweep(
    study: str | Path,
    out: str | Path | None = None,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    patience: float = PATIENCE_S,
    retry_failed: bool = False,
    progress: Progress = no_progress,
    hear: Callable[[SweepProgress], object] = lambda found: None,  # noqa: ARG005
    note: Callable[[str], object] = lambda sentence: None,  # noqa: ARG005
) -> SweepReport:
    """Runs the cells of a study that are not in its store yet; each is written when it finishes.

    The same call resumes after an interruption.

    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import solidtouch as st
    >>> text = '''
    ... name = "smoothing"
    ... trials = 100
    ... thresholds = [0.5, 0.95]
    ... [[data]]
    ... name = "ideal"
    ... preset = "ideal"
    ... [grid]
    ... pseudocount = [0.01, 1.0]
    ... '''
    >>> with TemporaryDirectory() as folder:
    ...     study = Path(folder, "study.toml")
    ...     _ = study.write_text(text)
    ...     report = st.sweep(study, workers=1)
    ...     taps = report.results["taps"].sel(policy="active", theta=0.95).squeeze(drop=True).load()
    >>> taps.dims
    ('pseudocount',)

    Args:
        study: The study file, see docs/how-to/sweep.md.
        out: Zarr store to write or to resume; `None` for the name of the study file with `.zarr`.
        workers: Processes on this machine; `None` for one per core. One is this process itself.
        scheduler: Address of a Dask scheduler, to run on its cluster instead.
        patience: Seconds to wait for a lost scheduler or lost workers.
        retry_failed: Whether to retry cells that failed before.
        progress: Called with the name and size of every stage; returns the function that advances it.
        hear: Called with the numbers of cells, at the start and after every cell.
        note: Called with warnings about the data and lost connections.

    Raises:
        InputError: The study, its data or the store cannot be used.
    """
    path = Path(study)
    store = path.with_suffix(".zarr") if out is None else Path(out)
    counted: list[Callable[[int], None]] = []
    ended = 0

    def tell(found: SweepProgress) -> None:
        nonlocal ended
        if not counted:
            counted.append(progress("Cells", found.cells))
        counted[0](found.ended - ended)
        ended = found.ended
        hear(found)

    runner = _runner(scheduler, workers, patience, note)
    return SweepReport(store, run_sweep(path, store, runner, retry_failed=retry_failed, progress=tell, note=note))


def _runner(scheduler: str | None, workers: int | None, patience: float, note: Callable[[str], object]) -> Runner:
    if scheduler is not None:
        return cluster(scheduler, workers, patience, note)
    workers = cores(workers)
    return in_this_process if workers == 1 else in_processes(workers)


def _shown(values: Sequence[object]) -> str:
    return ", ".join(f"{value:g}" if isinstance(value, float) else str(value) for value in values)
