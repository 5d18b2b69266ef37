"""Other packages on the part of the job they support: beliefs after a fixed number of taps, no moves, no stopping.

Every belief is compared with that of the reference equations.
"""

from collections.abc import Callable
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray
from solidtouch.inference import reference

from benchmarks.speed.c_code import NO_COMPILER
from benchmarks.speed.rows import Row, interleaved, per_unit
from benchmarks.speed.trials.decisions import UNIT, limits
from benchmarks.speed.trials.job import Job, make_job, paper_table, play
from benchmarks.speed.trials.loops import loop
from benchmarks.speed.trials.vectorised import vectorised

TAPS = 60
WORK = f"{TAPS} taps, passive, without stopping"
NEVER = (2.0,)

type Beliefs = Callable[[], NDArray[np.floating]]
"""The last belief of each sequence, shape (n, C)."""


def rows(quick: bool = False) -> list[Row]:
    """Cost of a tap-update and largest difference from the belief of the reference."""
    few, some, many = (3, 4, 8) if quick else (100, 400, 1600)
    job = make_job(paper_table(), many, "passive", NEVER, TAPS)
    sequences = tap_sequences(job)
    expected = np.array([_belief(job, sequence) for sequence in sequences[:few]])
    what = expected.reshape(few, *job.prior.shape).sum(axis=1).max(axis=1)
    ways: dict[str, tuple[Callable[[], object], int, str]] = {
        "NumPy loop over trials and taps": (lambda: loop(job.first(few)), few, ""),
        "NumPy, one batch": (lambda: vectorised(job), many, ""),
        "solidtouch": (lambda: play(job), many, _difference(play(job).belief[:few, 0], what)),
    }
    found = []
    for method, module, make, n in (
        ("dynamax, hmm_filter under jit and vmap", "dynamax", dynamax_filter, many),
        ("hmmlearn, predict_proba", "hmmlearn", hmmlearn_smoother, some),
    ):
        if find_spec(module) is None:
            found.append(Row(WORK, method, [], UNIT, f"{module} is not installed"))
            continue
        beliefs = make(job, sequences[:n])
        ways[method] = beliefs, n, _difference(beliefs()[:few], expected)
    for method, yardstick in limits(job):
        if yardstick is None:
            found.append(Row(WORK, method, [], UNIT, NO_COMPILER))
        else:
            ways[method] = yardstick.play, many, ""
    seconds = interleaved({method: run for method, (run, _, _) in ways.items()}, 2 if quick else 7)
    return [
        Row(WORK, method, per_unit(seconds[method], n * TAPS), UNIT, note) for method, (_, n, note) in ways.items()
    ] + found


def tap_sequences(job: Job) -> NDArray[np.intp]:
    """The taps that the trials of a passive job see, shape (n, T)."""
    return job.tap[job.plan.where[:, np.newaxis], job.plan.what[:, np.newaxis], job.number]


def dynamax_filter(job: Job, sequences: NDArray[np.intp]) -> Beliefs:
    """Filtered beliefs of a hidden Markov model whose state stays; in single precision."""
    import jax  # noqa: PLC0415
    import jax.numpy as jnp  # noqa: PLC0415
    from dynamax.hidden_markov_model import hmm_filter  # noqa: PLC0415

    classes = job.classes
    table = jnp.asarray(job.table.log_likelihood.reshape(-1, classes), dtype=jnp.float32)
    prior, stay = jnp.asarray(job.prior.ravel(), dtype=jnp.float32), jnp.eye(classes, dtype=jnp.float32)

    @jax.jit
    @jax.vmap
    def last(sequence: jax.Array) -> jax.Array:
        return hmm_filter(prior, stay, table[sequence]).filtered_probs[-1]

    taps = jnp.asarray(sequences, dtype=jnp.int32)
    return lambda: np.asarray(last(taps))


def hmmlearn_smoother(job: Job, sequences: NDArray[np.intp]) -> Beliefs:
    """Smoothed beliefs, of which only the last of a sequence is the filtered one that the others give."""
    from hmmlearn.base import BaseHMM  # noqa: PLC0415

    class TapHMM(BaseHMM):
        """Observations are numbers of taps."""

        def _compute_likelihood(self, X):
            return table[X[:, 0]]

    table = job.likelihood.reshape(-1, job.classes)
    model = TapHMM(job.classes, implementation="scaling")
    model.startprob_, model.transmat_ = job.prior.ravel(), np.eye(job.classes)
    taps, lengths = sequences.reshape(-1, 1), [TAPS] * len(sequences)
    return lambda: model.predict_proba(taps, lengths)[TAPS - 1 :: TAPS]


def _belief(job: Job, sequence: NDArray[np.intp]) -> NDArray[np.float64]:
    log_belief = job.table.log_prior
    for tap in sequence:
        log_belief, _ = reference.update_log(log_belief, job.table.log_likelihood[tap])
    return np.exp(log_belief).ravel()


def _difference(found: NDArray[np.floating], expected: NDArray[np.floating]) -> str:
    return f"belief within {np.abs(found - expected).max():.0e} of the reference"
