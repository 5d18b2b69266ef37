"""Runs the unfinished cells of a sweep and writes each as it finishes."""

import json
import os
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from ...models.errors import InputError
from ...models.io.recording import naming
from ...models.taps import TapSet
from ...models.threads import one_blas_thread
from ..stats.resampled_units import spread_of_taps, unit_factor
from ..tasks.code import code, differences
from ..tasks.task import Outcome, Runner
from .cell import run_cell
from .cells import CellGrid, Effort
from .data import DataSet, Sources
from .store import DONE, FAILED, PENDING, SweepStore, create_store, locked, read_about
from .study import StudyFile, load_study, parse_study

_CAUSES = 3


class SweepProgress(NamedTuple):
    """How far a sweep is, in cells that differ.

    Attributes:
        cells: How many there are.
        done: How many are done.
        failed: How many failed.
        causes: The last lines of the first few different tracebacks that came since the start.
    """

    cells: int
    done: int
    failed: int
    causes: tuple[str, ...] = ()

    @property
    def ended(self) -> int:
        """How many are done or failed."""
        return self.done + self.failed

    @property
    def counts(self) -> str:
        """The numbers as a phrase."""
        failed = f", {self.failed} failed" if self.failed else ""
        return f"{self.done} of {self.cells} cells{failed}"


def sweep(
    path: Path,
    out: Path,
    run: Runner,
    *,
    retry_failed: bool = False,
    progress: Callable[[SweepProgress], object] = lambda tally: None,  # noqa: ARG005
    note: Callable[[str], object] = lambda line: None,  # noqa: ARG005
) -> SweepProgress:
    """Begins a study, or continues it.

    Args:
        path: The study file.
        out: The store; made if nothing is there.
        run: Where to compute.
        retry_failed: Whether cells that failed before are tried again.
        progress: Called with the progress at the start and after every cell.
        note: Called with sentences about the data, such as taps that were left out.

    Returns:
        How far it came.

    Raises:
        InputError: The study or its data cannot be used, the store belongs to another study, other data or other
            software, or it cannot be written.
    """
    study = load_study(path)
    with naming(path):
        sources = Sources(study, path.parent)
        grid = CellGrid.of(study, tuple(sources.keys))
        store = _store(path, out, study, sources, grid)
    for line in (*sources.notes, read_about(out).get("few")):
        if line:
            note(line)
    with locked(out), one_thread():
        status = store.status()[grid.distinct]
        wanted = (status == PENDING) | (retry_failed & (status == FAILED))
        done, failed = np.count_nonzero(status == DONE), np.count_nonzero((status == FAILED) & ~wanted)
        tally = SweepProgress(len(status), int(done), int(failed))
        progress(tally)
        effort = Effort(study.trials, tuple(study.thresholds), study.deadline)
        cells = (grid.cell(int(number)) for number in grid.distinct[wanted])
        with closing(run(cells, partial(run_cell, effort=effort), sources.load)) as outcomes:
            for outcome in outcomes:
                store.write(outcome)
                tally = _counted(tally, outcome)
                progress(tally)
    return tally


def kept(out: Path) -> SweepProgress:
    """How far the sweep of a store is.

    Raises:
        InputError: There is no such store, or it is damaged.
    """
    if not out.exists():
        raise InputError(f"{out}: no such store.")
    about = read_about(out)
    with naming(out):
        grid = CellGrid.of(parse_study(about["study"]), tuple(about["data_keys"]))
    status = SweepStore(out, grid).status()[grid.distinct]
    done, failed = (int(np.count_nonzero(status == state)) for state in (DONE, FAILED))
    return SweepProgress(len(status), done, failed)


def _counted(tally: SweepProgress, outcome: Outcome) -> SweepProgress:
    if not outcome.traceback:
        return tally._replace(done=tally.done + 1)
    cause = outcome.traceback.strip().rpartition("\n")[2]
    causes = tally.causes if cause in tally.causes else (*tally.causes, cause)[:_CAUSES]
    return tally._replace(failed=tally.failed + 1, causes=causes)


def _store(path: Path, out: Path, study: StudyFile, sources: Sources, grid: CellGrid) -> SweepStore:
    settings = json.loads(msgspec.json.encode(study))
    if out.is_dir() and any(out.iterdir()):
        about = read_about(out)
        _check_study(path, out, settings, about["settings"])
        _check_data(out, sources.keys, about["data_keys"])
        if different := differences(about["code"], code()):
            raise InputError(f"{out} was begun with other software; now there is {', '.join(different)}.")
        return SweepStore(out, grid)
    about = {
        "title": study.name,
        "study": path.read_text(encoding="utf-8"),
        "settings": json.dumps(settings),
        "data_keys": json.dumps(sources.keys),
        "code": json.dumps(code()),
    }
    if study.resamples:
        about |= _resampled(sources, study.resamples)
    for name, classes in sources.grids.items():
        _check_fixation(name, study.grid.fixation, classes.L)
    units = {name: (classes.what_error_unit, classes.where_unit) for name, classes in sources.grids.items()}
    return create_store(out, grid, study.thresholds, units, about)


def _of_trained_classes(data: DataSet) -> TapSet:
    """The test taps that can be played."""
    trained = np.zeros(data.grid.shape, dtype=bool)
    where, what = data.fold.train.indices(data.grid)
    inside = np.minimum(where, what) >= 0
    trained[where[inside], what[inside]] = True
    where, what = data.fold.test.indices(data.grid)
    return data.fold.test.select((np.minimum(where, what) >= 0) & trained[where, what])


def _resampled(sources: Sources, resamples: int) -> dict[str, Any]:
    """How resamples of the test taps turn into intervals, as `over_data` reads it."""
    if len(sources.keys) > 1:
        raise InputError(f"resamples: with {len(sources.keys)} data sets these are the units of intervals.")
    data = sources.load(*sources.keys)
    how = spread_of_taps(_of_trained_classes(data), data.grid)
    if np.isnan(how.factor):
        raise InputError("resamples: there is one test tap of most classes, too few to be resampled.")
    if resamples < how.sessions:
        raise InputError(
            f"resamples: {how.sessions} sessions test, each of which is left out in turn, so it takes {how.sessions} "
            "or more."
        )
    return {"resample_factor": unit_factor(how), "resample_sessions": how.sessions, "few": how.few}


def _check_fixation(name: str, fixation: Any, L: int) -> None:
    outside = [point for point in fixation if point >= L] if isinstance(fixation, tuple) else []
    if outside:
        raise InputError(f"grid.fixation: {outside[0]} lies outside the positions 0 to {L - 1} of the data set {name}.")


def _check_study(path: Path, out: Path, mine: dict[str, Any], theirs: dict[str, Any]) -> None:
    mine, theirs = ({"resamples": 0, **part, **part["grid"]} for part in (mine, theirs))
    for key in mine:
        if key != "grid" and mine[key] != theirs.get(key):
            raise InputError(
                f"{out} holds another study: {key} is {_short(theirs.get(key))} there and {_short(mine[key])} in "
                f"{path.name}; another --out begins anew."
            )


def _check_data(out: Path, mine: dict[str, str], theirs: dict[str, str]) -> None:
    for name, key in mine.items():
        if theirs.get(name) != key:
            raise InputError(f"{out} was begun with other taps in the data set {name}; another --out begins anew.")


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) < 80 else f"{text[:77]}..."


_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


@contextmanager
def one_thread() -> Iterator[None]:
    """Limits linear algebra to one thread, also in libraries loaded and processes started within the block."""
    before = {name: os.environ.get(name) for name in _VARIABLES}
    os.environ.update(dict.fromkeys(_VARIABLES, "1"))
    try:
        with one_blas_thread():
            yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
