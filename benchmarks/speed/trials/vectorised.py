"""Trials in batched NumPy; finished trials leave the batch."""

import numpy as np
from numpy.typing import NDArray

from benchmarks.speed.trials.job import Decisions, Job, no_decisions

FLOOR, FLOOR_LIKELIHOOD = 1e-20, 1e-17  # with these single precision meets no subnormal numbers, which are slow


def vectorised(job: Job, batch: int = 1600) -> Decisions:
    """A batch of trials at a time; trials that have ended leave the arrays."""
    found = no_decisions(job)
    likelihood = np.maximum(job.likelihood, FLOOR_LIKELIHOOD).astype(np.float32)
    for start in range(0, len(job.number), batch):
        _play(job, likelihood, np.arange(start, min(start + batch, len(job.number))), found)
    return found


def _play(job: Job, likelihood: NDArray[np.float32], trial: NDArray[np.intp], found: Decisions) -> None:
    taps, whats, wheres = found
    L, M = job.prior.shape
    belief = np.broadcast_to(job.prior.astype(np.float32), (len(trial), L, M)).copy()
    at, held, fixation = job.plan.where[trial], job.plan.what[trial], job.plan.fixation[trial]
    undecided = np.ones((len(trial), len(job.thresholds)), dtype=bool)
    for t in range(job.deadline):
        belief *= likelihood[job.tap[at, held, job.number[trial, t]]]
        belief /= belief.sum(axis=(1, 2), keepdims=True)
        np.maximum(belief, FLOOR, out=belief)
        what, where = belief.sum(axis=1), belief.sum(axis=2).argmax(axis=1)
        above = (what.max(axis=1)[:, np.newaxis] > job.thresholds) | (t == job.deadline - 1)
        row, h = np.nonzero(above & undecided)
        taps[trial[row], h], whats[trial[row], h], wheres[trial[row], h] = t + 1, what[row].argmax(axis=1), where[row]
        undecided &= ~above
        going = undecided.any(axis=1)
        if not going.all():
            belief, undecided, where = belief[going], undecided[going], where[going]
            trial, at, held, fixation = trial[going], at[going], held[going], fixation[going]
            if not len(trial):
                return
        if job.active:
            delta = fixation - where
            at = np.clip(at + delta, 0, L - 1)
            belief = _shift_each(belief, delta)


def _shift_each(belief: NDArray[np.float32], delta: NDArray[np.intp]) -> NDArray[np.float32]:
    """Each belief, first axis, after a move of its own."""
    _, L, M = belief.shape
    source = np.arange(L) - delta[:, np.newaxis]
    target = np.arange(L) + delta[:, np.newaxis]
    lost = ((target < 0) | (target >= L)) * belief.sum(axis=2)
    spread = lost.sum(axis=1) / (np.maximum(np.minimum(np.abs(delta), L), 1) * M)
    moved = np.take_along_axis(belief, np.clip(source, 0, L - 1)[:, :, np.newaxis], axis=1)
    vacated = ((source < 0) | (source >= L))[:, :, np.newaxis]
    return np.where(vacated, spread[:, np.newaxis, np.newaxis], moved).astype(np.float32)
