"""Hidden Markov models as taps: the place counts the observations, the object is the path of states.

The state of this project's models does not change between taps. A path of states does not change either, so a model
with S states and T observations is one with S^T objects, whose prior is the probability of the path. The finger begins
at place 0 and moves on by one place after each tap; under object p, taps at place t are those of state p_t. Beliefs in
paths then give everything about states: filtered, predicted, smoothed, in pairs, and the most probable path.
"""

from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from solidtouch.inference.engines.engine import Engine, make_engine
from solidtouch.models.grid import ClassGrid
from solidtouch.models.measurement.model import TapModel
from solidtouch.models.measurement.table import TableModel
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.taps import TapSet

import solidtouch as st
from benchmarks.peers.examples import Active, Example


class States(NamedTuple):
    """Beliefs in the states of an example.

    Attributes:
        belief: Given all observations so far, shape (T, S).
        predicted: Given those before, shape (T, S).
        forward: Joint probability of the state and all observations so far, shape (T, S).
        smoothed: Given all observations, shape (T, S).
        backward: Probability of the observations to come, given the state, shape (T, S).
        pairs: Of two successive states, given all observations, shape (T - 1, S, S).
        log_evidence: Of all observations.
        path: Most probable sequence of states, shape (T,).
        log_path: Log joint probability of that path and the observations.
    """

    belief: NDArray[np.float64]
    predicted: NDArray[np.float64]
    forward: NDArray[np.float64]
    smoothed: NDArray[np.float64]
    backward: NDArray[np.float64]
    pairs: NDArray[np.float64]
    log_evidence: float
    path: NDArray[np.intp]
    log_path: float

    @property
    def changes(self) -> NDArray[np.float64]:
        """Expected number of changes from state to state, given all observations, shape (S, S)."""
        return self.pairs.sum(axis=0)

    @property
    def path_probability(self) -> float:
        """Joint probability of the most probable path and the observations."""
        return float(np.exp(self.log_path))


def paths(S: int, T: int) -> NDArray[np.intp]:
    """All sequences of states, shape (S^T, T)."""
    return np.indices((S,) * T).reshape(T, -1).T


def path_model(example: Example) -> tuple[TapModel, NDArray[np.float64], float]:
    """A model of places and paths, the taps that are seen, and the log of what its likelihoods are multiplied by.

    It is fitted to training taps where the example has probabilities of symbols.
    """
    T, every = len(example.taps), paths(len(example.start), len(example.taps))
    if example.trained is not None:
        return fitted(example.trained[every.T], example.taps, example.power), example.taps, 0.0
    assert example.likelihood is not None  # noqa: S101 - as `Example` says
    scale = 1 / example.likelihood.max(axis=1, keepdims=True)
    seen = np.take_along_axis(scale * example.likelihood, every.T, axis=1)  # the symbol that is seen, and another
    grid = ClassGrid(np.arange(T), "tap", None, tuple((f"path {p}",) for p in range(len(every))))
    tables = np.stack([seen, 1 - seen], axis=-1)[:, :, None]
    model = TableModel(grid, np.arange(3.0) - 0.5, "none", Preprocessing(samples=1), tables)
    return model, np.zeros((T, 1, 1)), float(np.log(scale).sum())


def fitted(counts: NDArray[np.int64], taps: NDArray[np.float64], power: str) -> TapModel:
    """A histogram fitted to taps of every place and object with these numbers of samples, shape (L, M, K, B)."""
    (L, M, _, B), J = counts.shape, taps.shape[1]
    total = counts.sum(axis=-1).max()
    times = J // np.gcd(J, total)
    samples = np.array([[[np.repeat(np.arange(B), row * times) for row in one] for one in of] for of in counts])
    training = np.moveaxis(samples, 2, 3).reshape(-1, J, counts.shape[2])
    where, what = (index.ravel().repeat(times * total // J) for index in np.indices((L, M)))
    names = [f"object {m}" for m in range(M)]
    training_taps = TapSet.from_arrays(training, what, names, preprocessing=Preprocessing(samples=J), where=where)
    return st.fit(training_taps, edges=np.arange(B + 1) - 0.5, pseudocount=0.0, power=power)


def by_paths(example: Example, engine: str = "filter", border: Any = "uniform") -> States:
    """The states of an example, from beliefs in its paths."""
    model, taps, log_scale = path_model(example)
    every, T = paths(len(example.start), len(example.taps)), len(taps)
    log_prior = np.full(model.grid.shape, -np.inf)
    with np.errstate(divide="ignore"):
        steps = [np.log(matrix)[every[:, t], every[:, t + 1]] for t, matrix in enumerate(example.transitions)]
        log_prior[0] = sum(steps, np.log(example.start)[every[:, 0]])
    carrier = make_engine(engine, model, border)
    log_belief, evidence, before, after = log_prior, [], [], []
    for t, tap in enumerate(taps):
        log_belief = carrier.shift(log_belief, 1) if t else log_belief
        before.append(np.exp(log_belief[t]))
        log_belief, log_evidence = carrier.update(log_belief, tap)
        after.append(np.exp(log_belief[t]))
        evidence.append(log_evidence)
    in_state = partial(_in_states, every, len(example.start))
    log_evidence = sum(evidence) - log_scale
    parts = np.cumsum(evidence)
    belief = np.array([in_state(t, after[t]) for t in range(T)])
    smoothed = np.array([in_state(t, after[-1]) for t in range(T)])
    scales = np.exp(parts)[:, None] if log_scale == 0 else np.full((T, 1), np.nan)  # of single taps it is not known
    best = int(np.argmax(log_belief[T - 1]))
    with np.errstate(divide="ignore", invalid="ignore"):
        backward = smoothed / (belief * scales) * np.exp(parts[-1])
    return States(
        belief=belief,
        predicted=np.array([in_state(t, before[t]) for t in range(T)]),
        forward=belief * scales,
        smoothed=smoothed,
        backward=backward,
        pairs=_pairs(every, len(example.start), after[-1]),
        log_evidence=log_evidence,
        path=every[best],
        log_path=float(log_belief[T - 1, best] + log_evidence),
    )


def _in_states(every: NDArray[np.intp], S: int, t: int, belief: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.bincount(every[:, t], belief, minlength=S)


def _pairs(every: NDArray[np.intp], S: int, belief: NDArray[np.float64]) -> NDArray[np.float64]:
    steps = pairwise(every.T)
    pairs = [np.bincount(a * S + b, belief, minlength=S * S).reshape(S, S) for a, b in steps]
    return np.array(pairs).reshape(-1, S, S)


def by_steps(example: Example, engine: str = "filter") -> tuple[NDArray[np.float64], float]:
    """Beliefs (T, S) and log evidence with updates of this project, between which the state changes by matrices.

    For sequences too long for their paths. A state that stays needs no matrix.
    """
    model, taps = state_model(example)
    carrier, stays = make_engine(engine, model), np.array_equal(example.transition, np.eye(len(example.start)))
    log_belief, found, total = np.log(example.start)[None], [], 0.0
    for t, tap in enumerate(taps):
        if t and not stays:
            log_belief = np.log(np.exp(log_belief) @ example.transitions[t - 1])
        log_belief, log_evidence = carrier.update(log_belief, tap)
        found.append(np.exp(log_belief[0]))
        total += log_evidence
    return np.array(found), total


def state_model(example: Example) -> tuple[TapModel, NDArray[np.float64]]:
    """A model of one place, whose objects are the states, and the taps that are seen."""
    if example.trained is not None:
        return fitted(example.trained[None], example.taps, example.power), example.taps
    assert example.likelihood is not None  # noqa: S101 - one of the two is given
    T, S = example.likelihood.shape
    grid = ClassGrid([0.0], "", None, tuple((f"state {s}",) for s in range(S)))
    tables = example.likelihood.T[None, :, None]
    model = TableModel(grid, np.arange(T + 1) - 0.5, "none", Preprocessing(samples=1), tables)
    return model, np.arange(T, dtype=np.float64)[:, None, None]  # each tap is a symbol of its own


def by_moves(example: Active, engine: str = "filter", border: Any = "circular") -> NDArray[np.float64]:
    """Beliefs (T, L, M) of an example with actions, each a move from one place to another."""
    carrier: Engine = make_engine(engine, fitted(example.trained, example.taps, "none"), border)
    log_belief, found = np.full(carrier.model.grid.shape, -np.inf), []
    log_belief[example.start] = -np.log(len(example.objects))
    moves = np.diff([example.start, *example.visited])
    for tap, move in zip(example.taps, moves.tolist(), strict=True):
        log_belief, _ = carrier.update(carrier.shift(log_belief, move), tap)
        found.append(np.exp(log_belief))
    return np.array(found)
