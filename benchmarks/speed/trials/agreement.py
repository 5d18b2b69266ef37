"""Compares the decisions of other methods with those of the reference equations."""

import numpy as np
from numpy.typing import NDArray
from solidtouch.inference import reference

from benchmarks.speed.trials.job import Decisions, Job, no_decisions

NEAR = 1e-6


def by_reference(job: Job) -> tuple[Decisions, NDArray[np.bool_]]:
    """The decisions by the reference equations on log beliefs, and which trials were near a tie.

    Near means that a belief came within 1e-6 of a threshold, or the two largest marginals of one kind that close to
    each other where that decided something.
    """
    L, _ = job.prior.shape
    found = no_decisions(job)
    near = np.zeros(len(job.number), dtype=bool)
    for i, (start, held, fixation) in enumerate(zip(job.plan.where, job.plan.what, job.plan.fixation, strict=True)):
        at, log_belief, decided = int(start), job.table.log_prior, 0
        for t in range(job.deadline):
            tap = job.tap[at, held, job.number[i, t]]
            log_belief, _ = reference.update_log(log_belief, job.table.log_likelihood[tap])
            what, where = (
                marginal(np.exp(log_belief)) for marginal in (reference.what_marginal, reference.where_marginal)
            )
            last = t == job.deadline - 1
            crossed = len(job.thresholds) if last else int((job.thresholds < what.max()).sum())
            near[i] |= bool((np.abs(job.thresholds[decided:] - what.max()) <= NEAR).any())
            if crossed > decided:
                near[i] |= _tied(what) or _tied(where)
                for values, value in zip(found, (t + 1, what.argmax(), where.argmax()), strict=True):
                    values[i, decided:crossed] = value
                decided = crossed
            if decided == len(job.thresholds):
                break
            if job.active:
                near[i] |= _tied(where)
                delta = reference.fixation_move(int(where.argmax()), int(fixation))
                at = min(max(at + delta, 0), L - 1)
                log_belief = reference.shift_log(log_belief, delta)
    return found, near


def differing(found: Decisions, expected: Decisions) -> NDArray[np.bool_]:
    """Which of the trials in `expected` were decided differently, at any threshold, shape (n,)."""
    n = len(expected.taps)
    return np.any([(one[:n] != other).any(axis=1) for one, other in zip(found, expected, strict=True)], axis=0)


def _tied(marginal: NDArray[np.float64]) -> bool:
    second, first = np.sort(marginal)[-2:] if len(marginal) > 1 else (0.0, 1.0)
    return bool(first - second <= NEAR)
