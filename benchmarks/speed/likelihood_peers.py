"""Time of the log-likelihood table in scikit-learn's naive Bayes classifiers and in C, with the smoothing used here.

On counts, MultinomialNB is the paper's classifier without the exponent. CategoricalNB has a table for every column, so
all samples of a taxel get the fitted table of that taxel. Both are compared with the log-likelihoods computed here,
after the exponent and up to a constant per tap.
"""

import ctypes
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import preset
from solidtouch.inference import reference
from solidtouch.models.measurement.histogram import HistogramModel, fit
from solidtouch.models.measurement.likelihood.bins import find_bins

from benchmarks.speed.c_code import NO_COMPILER, compiled_c
from benchmarks.speed.rows import LIMIT, Row, interleaved
from benchmarks.speed.trials.job import SEED

UNIT = "table"
SUMMED = f"{LIMIT}C, sums of rows of the table"


def rows(quick: bool = False) -> list[Row]:
    """Seconds of the table of one session's taps; the first row is this project's."""
    train, test = (simulate_session(preset("paper"), SEED, session) for session in (0, 1))
    model, taps = fit(train, train.grid()), test.taps[: 20 if quick else None]
    N, J, K = taps.shape
    work = (
        f"log-likelihoods beside scikit-learn and C: {N} taps x {model.grid.L * model.grid.M} classes x {J * K} samples"
    )
    expected = model.log_likelihood(taps)
    ways: dict[str, tuple[Callable[[], object], str]] = {
        "solidtouch": (lambda: model.log_likelihood(taps), "includes binning and counting"),
    }
    if find_spec("sklearn") is None:
        absent = [
            Row(work, name, [], UNIT, "scikit-learn is not installed") for name in ("MultinomialNB", "CategoricalNB")
        ]
    else:
        absent = []
        for name, score, note in (
            ("scikit-learn MultinomialNB", multinomial(model, taps), "counts precomputed"),
            ("scikit-learn CategoricalNB", categorical(model, taps), "bins precomputed"),
        ):
            difference = _difference(score() / J, expected.reshape(N, -1))
            ways[name] = score, f"{note}; within {difference:.0e} of ours"
    sums = in_registers(model, taps)
    if sums is None:
        absent.append(Row(work, SUMMED, [], UNIT, NO_COMPILER))
    else:
        difference = _difference(sums(), expected.reshape(N, -1))
        ways[SUMMED] = sums, f"single precision, bins precomputed; within {difference:.0e} of ours"
    seconds = interleaved({name: run for name, (run, _) in ways.items()}, 2 if quick else 7)
    return [Row(work, name, seconds[name], UNIT, note) for name, (_, note) in ways.items()] + absent


def multinomial(model: HistogramModel, taps: NDArray[np.floating]) -> Callable[[], NDArray[np.float64]]:
    """Joint log-likelihoods of MultinomialNB, fitted to the class counts, of the taps' counts."""
    from sklearn.naive_bayes import MultinomialNB  # noqa: PLC0415

    classes, (K, B) = model.grid.L * model.grid.M, model.counts.shape[2:]
    classifier = MultinomialNB(alpha=model.pseudocount, fit_prior=False)
    classifier.fit(model.counts.reshape(classes, K * B), np.arange(classes))
    cells = find_bins(taps, model.edges).astype(np.intp) + B * np.arange(K)
    counts = np.array([np.bincount(tap.ravel(), minlength=K * B) for tap in cells], dtype=np.float64)
    return lambda: classifier.predict_joint_log_proba(counts)


def categorical(model: HistogramModel, taps: NDArray[np.floating]) -> Callable[[], NDArray[np.float64]]:
    """Joint log-likelihoods of CategoricalNB with a feature for every sample, tables tied over the samples."""
    from sklearn.naive_bayes import CategoricalNB  # noqa: PLC0415

    classes, (K, B) = model.grid.L * model.grid.M, model.counts.shape[2:]
    N, J, _ = taps.shape
    bins = find_bins(taps, model.edges).astype(np.intp).reshape(N, J * K)
    classifier = CategoricalNB(alpha=model.pseudocount, fit_prior=False, min_categories=B)
    classifier.fit(np.zeros((classes, J * K), dtype=np.intp), np.arange(classes))
    tables = np.log(model.probabilities).reshape(classes, K, B)
    classifier.feature_log_prob_ = [tables[:, k] for k in range(K)] * J
    return lambda: classifier.predict_joint_log_proba(bins)


def in_registers(model: HistogramModel, taps: NDArray[np.floating]) -> Callable[[], NDArray[np.float32]] | None:
    """The log-likelihoods summed up in C, shape (N, classes), or `None` without a compiler."""
    classes, (K, B) = model.grid.L * model.grid.M, model.counts.shape[2:]
    padded = -(-classes // 16) * 16
    library = compiled_c(Path(__file__).with_name("limit_likelihood.c"), f"CLASSES={padded}")
    if library is None:
        return None
    exponent = ctypes.c_float(reference.exponent(model.power, *taps.shape[1:]))
    table, out = np.zeros((K * B, padded), dtype=np.float32), np.empty((len(taps), padded), dtype=np.float32)
    table[:, :classes] = np.log(model.probabilities).reshape(classes, K * B).T
    cells = np.ascontiguousarray(find_bins(taps, model.edges).astype(np.int32) + (B * np.arange(K)).astype(np.int32))
    sizes = ctypes.c_int64(len(taps)), ctypes.c_int64(cells[0].size)
    start, cell, end = (array.ctypes.data_as(ctypes.c_void_p) for array in (table, cells, out))

    def run() -> NDArray[np.float32]:
        library.limit_likelihood(start, cell, *sizes, exponent, end)
        return out[: len(cells), :classes]

    return run


def _difference(found: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    """Largest difference after what is common to the classes of a tap is taken out."""
    difference = found - expected
    return float(np.abs(difference - difference.mean(axis=1, keepdims=True)).max())
