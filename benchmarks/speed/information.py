"""Time of one decision that compares moves by the expected information of the next tap.

Every position is a candidate. The beliefs are taken from the middle of episodes, and each has its own moves.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from solidtouch.inference import reference
from solidtouch.inference.information import (
    ABOUT,
    TapOutcomes,
    information_of_moves,
    moves_to_all,
    tap_outcomes,
)
from solidtouch.inference.moves.control import MovePolicy
from solidtouch.inference.moves.information import informative

from benchmarks.speed.rows import Row, interleaved, per_unit
from benchmarks.speed.trials.job import SEED, paper_table

UNIT = "decision"
BATCH = 100


def rows(quick: bool = False) -> list[Row]:
    """Seconds of one decision, for the whole pool of taps of one session."""
    log_likelihood = paper_table().log_likelihood[:: 40 if quick else 1]
    outcomes, beliefs, rounds = tap_outcomes(log_likelihood), _beliefs(log_likelihood), 2 if quick else 9
    N, (L, M) = len(log_likelihood), beliefs.shape[1:]
    work = f"expected information of {L} moves over a pool of {N} taps, {L * M} classes"
    deltas = moves_to_all(beliefs)
    expected = _loop(outcomes, beliefs[0], deltas[0])
    found = information_of_moves(outcomes, beliefs[0], deltas[0])
    note = f"within {np.abs(found - expected).max():.0e} nat of the loop"
    ways: dict[str, tuple[Callable[[], object], int]] = {
        "Python, posterior after each tap": (lambda: _loop(outcomes, beliefs[0], deltas[0]), 1),
        "solidtouch, one decision, about where and what": (
            lambda: information_of_moves(outcomes, beliefs[0], deltas[0]),
            1,
        ),
    }
    for about in ABOUT:
        name = "where and what" if about == "joint" else about
        ways[f"solidtouch, {BATCH} at a time, about {name}"] = (
            lambda about=about: information_of_moves(outcomes, beliefs, deltas, about=about),
            BATCH,
        )
    for name, policy in _on_line(outcomes).items():
        ways[f"solidtouch, online, {name}"] = (lambda policy=policy: policy(beliefs[0], np.asarray(0.5)), 1)
    for run, _ in ways.values():
        run()
    seconds = interleaved({method: run for method, (run, _) in ways.items()}, rounds)
    return [
        Row(work, method, per_unit(seconds[method], units), UNIT, note if "one decision" in method else "")
        for method, (_, units) in ways.items()
    ]


def _on_line(outcomes: TapOutcomes) -> dict[str, MovePolicy]:
    """Strategies as a rig asks them: one belief in, one move out."""
    return {f"about {'where and what' if about == 'joint' else about}": informative(outcomes, about) for about in ABOUT}


def _beliefs(log_likelihood: NDArray[np.float64]) -> NDArray[np.float64]:
    """Beliefs after one to five random taps of the pool, shape (BATCH, L, M)."""
    rng = np.random.default_rng(SEED)
    flat = np.full(log_likelihood.shape[1:], 1 / log_likelihood[0].size)
    beliefs = []
    for n in range(BATCH):
        belief = flat
        for tap in rng.integers(len(log_likelihood), size=1 + n % 5):
            belief, _ = reference.update(belief, log_likelihood[tap])
        beliefs.append(belief)
    return np.array(beliefs)


def _loop(outcomes: TapOutcomes, belief: NDArray[np.float64], deltas: NDArray[np.intp]) -> NDArray[np.float64]:
    """The same for one belief: entropy now less the mean entropy of the posteriors, tap by tap."""
    taps = np.moveaxis(outcomes.given, -1, 0)
    values = []
    for delta in deltas:
        prior = reference.shift(belief, int(delta))
        value = _entropy(prior)
        for tap in taps:
            joint = prior * tap
            evidence = joint.sum()
            if evidence > 0:
                value -= evidence * _entropy(joint / evidence)
        values.append(value)
    return np.array(values)


def _entropy(p: NDArray[np.float64]) -> float:
    positive = p[p > 0]
    return float(-(positive * np.log(positive)).sum())
