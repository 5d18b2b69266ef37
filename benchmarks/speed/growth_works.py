"""What `growth` measures: tap-updates and fits of any size."""

from collections.abc import Callable

import numpy as np
from solidtouch.analysis.experiment.policies import most_trials, play_policies
from solidtouch.analysis.experiment.settings import ExperimentSettings
from solidtouch.inference.filter import Filter
from solidtouch.inference.fit import fit
from solidtouch.models.grid import ClassGrid
from solidtouch.models.measurement.histogram import HistogramModel
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.seeds import Purpose, generator
from solidtouch.models.taps import TapSet

from benchmarks.speed.memory import stream
from benchmarks.speed.trials.job import SEED, make_job, paper_table, random_table
from benchmarks.speed.trials.job import prepared as prepared_trials
from benchmarks.speed.trials.peers import NEVER

BASE = {"L": 16, "M": 5, "J": 50, "K": 12}
BINS = 100
TAPS_OF_A_CLASS = 2
"""Of a fit, where another size than their number grows."""
_TAPS, _TRIALS, _UPDATES = 40, 400, 50

type Prepare = Callable[[], Callable[[], int]]
"""Makes ready what costs memory; what it returns is timed, and returns how many tap-updates or fits it did."""


def prepared(method: str, axis: str, step: int | tuple[int, int]) -> tuple[int, Prepare]:
    """A size and the work of it, whose input is there already.

    Args:
        method: Of `growth.METHODS`.
        axis: Of `growth.SIZES`.
        step: One of these sizes.
    """
    shape = dict(BASE)
    if isinstance(step, tuple):
        shape["L"], shape["M"] = step
    elif axis in shape:
        shape[axis] = step
    size = step if isinstance(step, int) else step[0] * step[1]
    if method.startswith("trials"):
        policy = method.rpartition(" ")[2]
        return size, _counted(size, policy) if axis == "trials" else _trials(shape["L"], shape["M"], policy)
    if method == "reproduce":
        return _experiment(size)
    if method.startswith("Filter"):
        return size, _updates(**shape)
    return size, _fit(method, size if axis == "N" else TAPS_OF_A_CLASS * shape["L"] * shape["M"], **shape)


def _trials(L: int, M: int, policy: str) -> Prepare:
    """Trials of as many taps each over random likelihoods."""
    job = make_job(random_table(L, M), _TRIALS, policy, NEVER, _TAPS)

    def prepare() -> Callable[[], int]:
        play = prepared_trials(job)
        return lambda: len(play().taps) * _TAPS

    return prepare


def _counted(trials: int, policy: str) -> Prepare:
    """The paper's task to a threshold."""
    paper_table()
    return lambda: lambda: stream(trials, policy)


def _experiment(trials: int) -> tuple[int, Prepare]:
    """All trials of `solidtouch reproduce` on a data set, about so many."""
    table = paper_table()
    L, M = table.log_prior.shape
    grid, fixation = _grid(L, M), (L - 1) // 2
    settings = ExperimentSettings(seed=SEED)
    settings = settings.changed(trials=max(1, settings.trials * trials // most_trials(grid, settings, True, 0)))

    def run() -> int:
        played = play_policies(table, grid, settings, fixation, acts=True)
        others = played.stored.fixations.drop_isel(place=fixation)  # there they are those from every start
        parts = (played.stored.passive, played.stored.active, played.fresh.passive, played.fresh.active, others)
        return round(sum(float((part["taps"].isel(theta=-1) * part["trials"]).sum()) for part in parts))

    return most_trials(grid, settings, True, 0), lambda: run


def _updates(L: int, M: int, J: int, K: int) -> Prepare:
    """Taps, from samples to belief, under a random histogram."""
    rng = generator(SEED, Purpose.STUDY)
    counts = rng.poisson(1.0, size=(L, M, K, BINS))
    counts[..., 0] += 1
    model = HistogramModel(_grid(L, M), np.linspace(-3, 3, BINS + 1), "J", Preprocessing(samples=J), counts, 0.01)
    samples = rng.standard_normal((_UPDATES, J, K), dtype=np.float32)

    def prepare() -> Callable[[], int]:
        belief = Filter(model)

        def run() -> int:
            for tap in samples:
                belief.update(tap)
            return len(samples)

        return run

    return prepare


def _fit(model: str, N: int, *, L: int, M: int, J: int, K: int) -> Prepare:
    """A fit of N taps, in turn of every class."""
    where, what = np.divmod(np.arange(N) % (L * M), M)
    samples = generator(SEED, Purpose.STUDY).standard_normal((N, J, K), dtype=np.float32)
    samples += (where + what)[:, np.newaxis, np.newaxis].astype(np.float32) / 4
    taps = TapSet.from_arrays(
        samples,
        what,
        [f"object {m}" for m in range(M)],
        preprocessing=Preprocessing(samples=J),
        where=1.5 * where,
        where_unit="mm",
    )

    def run() -> int:
        fit(taps, model, bins=BINS)
        return 1

    return lambda: run


def _grid(L: int, M: int) -> ClassGrid:
    return ClassGrid(1.5 * np.arange(L), "mm", None, tuple((f"object {m}",) for m in range(M)))
