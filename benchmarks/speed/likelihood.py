"""Time of the log-likelihood table of many taps, from their samples and from precomputed counts.

All methods agree to 1e-10, those in single precision to its rounding error.
"""

from collections.abc import Callable
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.special import logsumexp
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import preset
from solidtouch.models.measurement.histogram import HistogramModel, fit
from solidtouch.models.measurement.likelihood.bins import SparseCounts, count_taps
from solidtouch.models.measurement.likelihood.counting import multiply
from solidtouch.models.measurement.likelihood.forecasts import log_normal_probability
from solidtouch.models.measurement.likelihood.forms import GaussianForm, bin_gaps
from solidtouch.models.measurement.likelihood.mixture import MixtureForm
from solidtouch.models.measurement.model import TapModel
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import TapSet

from benchmarks.speed.rows import Row, interleaved
from benchmarks.speed.trials.job import SEED

UNIT = "table"

type _Ways = dict[str, Callable[[], NDArray[np.floating]]]


def rows(quick: bool = False) -> list[Row]:
    """Seconds of the table of simulated taps, and of taps whose samples scatter over all bins."""
    train, test = (simulate_session(preset("paper"), SEED, session) for session in (0, 1))
    model, taps = fit(train, train.grid()), test.taps[: 20 if quick else None].astype(np.float32)
    scattered = np.random.default_rng(SEED).uniform(taps.min(), taps.max(), taps.shape).astype(np.float32)
    rounds = 2 if quick else 9
    tables = [
        row
        for samples, which in ((taps, "simulated"), (scattered, "scattered"))
        for row in (*_from_samples(model, samples, which, rounds), *_from_counts(model, samples, which, rounds))
    ]
    return [*tables, *_integrated(train, test.taps[:1], 10 if quick else 100, rounds)]


def _from_samples(model: HistogramModel, taps: NDArray[np.floating], which: str, rounds: int) -> list[Row]:
    bins = _bins(model, taps)
    ways: _Ways = {
        "one tap at a time, bins given": lambda: _one_by_one(model, bins),
        "one tap at a time": lambda: _one_by_one(model, _bins(model, taps)),
        "NumPy searchsorted, bincount and BLAS": lambda: _dense(model, taps) @ model.prepared.table * model.exponent,
        "solidtouch": lambda: model.log_likelihood(taps),
    }
    return _measured(f"log-likelihoods of {which} samples: {_size(model, taps)}", ways, "", rounds)


def _from_counts(model: HistogramModel, taps: NDArray[np.floating], which: str, rounds: int) -> list[Row]:
    table, counts, listed = model.prepared.table, _dense(model, taps), _listed(model, taps)
    small_table, small_counts = table.astype(np.float32), counts.astype(np.float32)
    sparse = csr_array((listed.times, listed.cell, listed.first), counts.shape)
    out = np.empty((len(taps), table.shape[1]))

    def occupied() -> NDArray[np.float64]:
        multiply(*listed, table, model.exponent, out)
        return out

    ways: _Ways = {
        "BLAS, double precision": lambda: counts @ table * model.exponent,
        "BLAS, single precision": lambda: small_counts @ small_table * np.float32(model.exponent),
        "scipy.sparse": lambda: sparse @ table * model.exponent,
        "solidtouch": occupied,
    }
    note = f"{len(listed.cell) / len(taps):.0f} of {table.shape[0]} cells of a tap are occupied"
    return _measured(f"log-likelihoods of {which} samples, counts given: {_size(model, taps)}", ways, note, rounds)


def _integrated(train: TapSet, tap: NDArray[np.floating], draws: int, rounds: int) -> list[Row]:
    """One tap under every class, a mean over draws from the posterior of a Gaussian model."""
    model = fit_model("profile", train, train.grid(), FitSettings(integrate=draws)).model
    parts = cast(tuple[GaussianForm, ...], cast(MixtureForm, model.form).parts)
    samples, below, above = bin_gaps(tap, model.edges)

    def plain() -> NDArray[np.float64]:
        each = []
        for part in parts:
            error = samples - part.mean
            inside = log_normal_probability((below + error) / part.scale, (above + error) / part.scale)
            each.append(logsumexp(part.log_weight[:, None, None] + inside.sum((-2, -1)), axis=0))
        return model.exponent * (logsumexp(each, axis=0) - np.log(draws))

    ways: _Ways = {"SciPy log_ndtr": plain, "solidtouch": lambda: model.log_likelihood(tap)}
    work = f"log-likelihood of one tap, {draws} draws of a Gaussian model: {_size(model, tap)}"
    return _measured(work, ways, "", rounds)


def _measured(work: str, ways: _Ways, note: str, rounds: int) -> list[Row]:
    expected = next(iter(ways.values()))().reshape(-1)
    notes = {}
    for method, way in ways.items():
        difference = np.abs(way().reshape(-1) - expected).max()  # compiles, too
        notes[method] = "; ".join(filter(None, (note, f"within {difference:.0e} of the first row")))
    seconds = interleaved(ways, rounds)
    return [Row(work, method, seconds[method], UNIT, notes[method]) for method in ways]


def _size(model: TapModel, taps: NDArray[np.floating]) -> str:
    N, J, K = taps.shape
    return f"{N} taps x {model.grid.L * model.grid.M} classes x {J * K} samples"


def _bins(model: HistogramModel, taps: NDArray[np.floating]) -> NDArray[np.intp]:
    return np.clip(np.searchsorted(model.edges, taps, side="right") - 1, 0, model.counts.shape[3] - 1)


def _one_by_one(model: HistogramModel, bins: NDArray[np.intp]) -> NDArray[np.float64]:
    """Eq. 1 for one tap after another, by indexing the table with its bins."""
    taxel = np.arange(bins.shape[2])
    return np.array([model.exponent * model.log_prob[:, :, taxel, tap].sum(axis=(2, 3)) for tap in bins])


def _dense(model: HistogramModel, taps: NDArray[np.floating]) -> NDArray[np.float64]:
    """Counts of each tap with their zeros, shape (N, K B)."""
    (N, _, K), B = taps.shape, model.counts.shape[3]
    cells = _bins(model, taps) + B * np.arange(K) + K * B * np.arange(N)[:, np.newaxis, np.newaxis]
    return np.bincount(cells.ravel(), minlength=N * K * B).reshape(N, K * B).astype(np.float64)


def _listed(model: HistogramModel, taps: NDArray[np.floating]) -> SparseCounts:
    """Counts of each tap as lists of occupied cells."""
    first, cell, times = [np.zeros(1, dtype=np.int64)], [], []
    for _, part in count_taps(taps, model.edges):
        end = part.first[-1]
        first.append(part.first[1:] + first[-1][-1])
        cell.append(part.cell[:end].copy())
        times.append(part.times[:end].copy())
    return SparseCounts(np.concatenate(first), np.concatenate(cell), np.concatenate(times))
