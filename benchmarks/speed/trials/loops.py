"""Trials as a NumPy loop over trials and taps as a researcher would write it, and a tuned version.

Both get the likelihood table and the draws. The tuned loop works in place, calls methods instead of functions and
indexes taps directly, which halves its time; the arithmetic is the same.
"""

import numpy as np
from numpy.typing import NDArray

from benchmarks.speed.trials.job import Decisions, Job, no_decisions


def loop(job: Job) -> Decisions:
    """One trial after another, one tap after another; every threshold answered by the same trajectory."""
    L, M = job.prior.shape
    found = no_decisions(job)
    for i in range(len(job.number)):
        x, w = job.plan.where[i], job.plan.what[i]
        belief = np.full((L, M), 1 / (L * M))
        decided = 0
        for t in range(job.deadline):
            tap = job.tap[x, w, job.number[i, t]]
            belief = belief * job.likelihood[tap]
            belief = belief / np.sum(belief)
            where, what = np.sum(belief, axis=1), np.sum(belief, axis=0)
            x_map, w_map = np.argmax(where), np.argmax(what)
            while decided < len(job.thresholds) and (what[w_map] > job.thresholds[decided] or t == job.deadline - 1):
                found.taps[i, decided], found.what[i, decided], found.where[i, decided] = t + 1, w_map, x_map
                decided += 1
            if decided == len(job.thresholds):
                break
            if job.active:
                delta = job.plan.fixation[i] - x_map
                x = min(max(x + delta, 0), L - 1)
                belief = rolled(belief, delta)
    return found


def rolled(belief: NDArray[np.float64], delta: int) -> NDArray[np.float64]:
    """A belief of shape (L, M) after a move; what leaves the range is spread evenly over the vacated cells."""
    if delta == 0:
        return belief
    moved = np.roll(belief, delta, axis=0)
    vacated = moved[:delta] if delta > 0 else moved[delta:]
    vacated[:] = np.sum(vacated) / vacated.size
    return moved


def tuned_loop(job: Job) -> Decisions:
    """The same as `loop`, sooner."""
    L, _ = job.prior.shape
    found = no_decisions(job)
    H = len(job.thresholds)
    for i, (start, w, fixation) in enumerate(zip(job.plan.where, job.plan.what, job.plan.fixation, strict=True)):
        x, belief, decided = start, job.prior.copy(), 0
        for t in range(job.deadline):
            belief *= job.likelihood[job.tap[x, w, job.number[i, t]]]
            belief /= belief.sum()
            where, what = belief.sum(axis=1), belief.sum(axis=0)
            x_map, w_map = where.argmax(), what.argmax()
            last = t == job.deadline - 1
            if what[w_map] > job.thresholds[decided] or last:
                crossed = H if last else job.thresholds.searchsorted(what[w_map])
                for values, value in zip(found, (t + 1, w_map, x_map), strict=True):
                    values[i, decided:crossed] = value
                decided = crossed
                if decided == H:
                    break
            if job.active:
                delta = fixation - x_map
                if delta:
                    x = min(max(x + delta, 0), L - 1)
                    belief = _sliced(belief, delta)
    return found


def _sliced(belief: NDArray[np.float64], delta: int) -> NDArray[np.float64]:
    """`rolled`, sooner."""
    moved = np.empty_like(belief)
    if delta > 0:
        moved[delta:] = belief[:-delta]
        moved[:delta] = belief[-delta:].sum() / (delta * belief.shape[1])
    else:
        moved[:delta] = belief[-delta:]
        moved[delta:] = belief[:-delta].sum() / (-delta * belief.shape[1])
    return moved
