"""Coverage of the intervals of `compare` for log probabilities of taps of sessions left out.

Each session shifts the levels of its taxels, alike in all classes: not at all, each taxel by itself, or all alike.
Shifts have a standard deviation of 1, as the noise of a sample has. Test sessions are drawn anew in every data set.
Either models fitted to `TRAINED` sessions, the same in all data sets, predict them (truth: the mean over `MANY`
sessions), or each session is left out in turn and predicted by models fitted to the others (truth: the mean of all data
sets). Beside them the intervals of Student's t, which do not allow for skewness over sessions.

`--document docs/explanation/intervals.md` updates the table of that page.
"""

from collections.abc import Iterator
from functools import cache, partial
from typing import Any

import numpy as np
from scipy import stats
from solidtouch.analysis.compare.groups import folds_of, scorer
from solidtouch.analysis.compare.taps import join_scores, mean_scores
from solidtouch.models import seeds
from solidtouch.models.measurement.model import Fitted
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import TapSet, concatenate

from benchmarks.page import share_interval, table
from benchmarks.studies.intervals.coverage import Seen, coverage, seen
from benchmarks.studies.intervals.places import taps_of
from benchmarks.studies.intervals.sessions import measure_and_write
from benchmarks.study import processes

M, TAXELS, TRAINED, MANY = 6, 8, 6, 4000
SESSIONS = (2, 3, 5, 10)
SKEWED = (5, 10)
"""Sessions of which skewness is allowed for."""
SHIFTS = {"none": (0.0, TAXELS), "each taxel": (1.0, TAXELS), "all taxels": (1.0, 1)}
"""Standard deviation and number of the shifts of a session."""
MODELS = ("gaussian", "session:gaussian")
QUANTITIES = {
    "gaussian": (MODELS[0], "integrated"),
    "session:gaussian": (MODELS[1], "integrated"),
    "difference": (MODELS[1], "integrated_difference"),
}
FIXED, REFITTED = "TEST from TRAIN", "each in turn"
BLOCK = "left-out-sessions"
_SETTINGS = FitSettings(power="none", bins=60, edges=np.linspace(-15, 15, 61))  # bins that all data sets share
_LEVEL = 2 * np.random.default_rng(0).normal(size=(1, M, TAXELS))


def draw(sessions: int, shifts: str, seed: int, first: int = 0) -> TapSet:
    """Taps of new sessions, numbered from `first`."""
    apart, number = SHIFTS[shifts]
    generator = seeds.generator(seed, seeds.Purpose.STUDY, sessions, int(100 * apart))
    shift = apart * generator.normal(size=(sessions, number))
    return concatenate([taps_of(_LEVEL + one, first + s, generator) for s, one in enumerate(shift)])


@cache
def trained(shifts: str) -> tuple[TapSet, dict[str, Fitted]]:
    """Training taps, the same for all data sets, and what is fitted to them."""
    train = draw(TRAINED, shifts, 0)
    return train, {name: fit_model(name, train, train.grid(), _SETTINGS) for name in MODELS}


def measured(how: str, sessions: int, shifts: str, seed: int) -> dict[tuple[str, bool], Seen]:
    """Each quantity in one data set with its interval, by whether it is that of Student's t."""
    if how == FIXED:
        train, test, most = trained(shifts)[0], draw(sessions, shifts, seed, first=TRAINED), 1
    else:
        whole, most = draw(sessions, shifts, seed), sessions
        train, test = (whole.select((whole.session == 0) == first) for first in (True, False))
    grid = train.grid()
    folds, _ = folds_of("session", train, test, grid, most, one_recording=True)
    score, parts = scorer("session", folds, grid, seed), {name: [] for name in MODELS}
    for fold in folds:
        for name in MODELS:
            fitted = trained(shifts)[1][name] if how == FIXED else fit_model(name, fold.train, grid, _SETTINGS)
            parts[name].append(score(fitted, fold.test, 1.0)["integrated"])
    scores = {name: join_scores(of) for name, of in parts.items()}
    means = mean_scores(scores, MODELS[0], "integrated")
    per_session = [np.bincount(one.cluster, one.values) / np.bincount(one.cluster) for one in scores.values()]
    by_session = dict(zip(QUANTITIES, (*per_session, per_session[1] - per_session[0]), strict=True))
    found = {}
    for key, (model, name) in QUANTITIES.items():
        value, error = by_session[key].mean(), stats.sem(by_session[key])
        found[key, False] = seen(means.sel(model=model), name)
        found[key, True] = Seen(value, *stats.t.interval(0.95, sessions - 1, value, error))
    return found


def run(data_sets: int, seed: int) -> Iterator[tuple[Any, ...]]:
    """How sessions are left out, their shifts, how many, a quantity, whether by Student's t, and its coverage."""
    own = [seeds.derived_seed(seed, seeds.Purpose.STUDY, number) for number in range(data_sets)]
    with processes() as workers:
        for how in (FIXED, REFITTED):
            for shifts in SHIFTS:
                truth = workers.submit(measured, how, MANY, shifts, seed) if how == FIXED else None
                for sessions in SESSIONS if how == FIXED else SESSIONS[1:]:
                    sets = list(workers.map(partial(measured, how, sessions, shifts), own, chunksize=10))
                    for key in sets[0]:
                        values = [one[key] for one in sets]
                        right = truth.result()[key].value if truth else float(np.mean([one.value for one in values]))
                        yield how, shifts, sessions, *key, coverage(values, right)


def document(rows: list[tuple[Any, ...]]) -> str:
    """The table of the page: a row for each quantity, coverages by the number of sessions."""
    cells: dict[tuple[Any, ...], dict[Any, str]] = {}
    for how, shifts, sessions, quantity, student, found in rows:
        cell = cells.setdefault((how, shifts, quantity), {})
        cell[sessions, student] = share_interval(found.hits, found.n)
        cell["width", sessions, student] = f"{found.width:.2f}"
    columns: dict[str, tuple[Any, ...]] = {f"covers, {sessions} sessions": (sessions, False) for sessions in SESSIONS}
    for sessions in SKEWED:
        columns[f"width, {sessions} sessions"] = "width", sessions, False
    for sessions in SKEWED:
        columns[f"Student's t, {sessions} sessions"] = sessions, True
        columns[f"its width, {sessions} sessions"] = "width", sessions, True
    return table(
        ["left out", "shift", "log probability", *columns],
        [[*key, *(cell.get(column, "–") for column in columns.values())] for key, cell in cells.items()],
    )


def main() -> None:
    """Measures and writes."""
    measure_and_write(__doc__, BLOCK, "intervals-left-out", run, document)


if __name__ == "__main__":
    main()
