"""One perception episode with any sensor and any engine: tap, update, decide or move."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..hardware.sensor import TouchSensor
from ..models.errors import InputError
from . import reference
from .control import MovePolicy
from .engine import Engine

DEADLINE = 100


class Episode(NamedTuple):
    """What happened; tap t counts from 0 and `log_beliefs[t]` is the belief after it, before the move that follows.

    Attributes:
        log_beliefs: Log belief after every tap, shape (T, L, M).
        log_evidence: Log evidence of every tap given those before, shape (T,).
        moves: Commanded moves between the taps in where classes, shape (T - 1,).
        realised: Moves really made, clipped at the ends of the range, shape (T - 1,).
        what: The decided what class.
        where: The decided where class, at the place of the last tap.
        stopped: Whether the threshold ended the episode; otherwise the deadline did, and the decisions are the
            most probable classes at that time.
    """

    log_beliefs: NDArray[np.float64]
    log_evidence: NDArray[np.float64]
    moves: NDArray[np.int64]
    realised: NDArray[np.int64]
    what: int
    where: int
    stopped: bool

    @property
    def taps(self) -> int:
        """Reaction time: the number of taps made."""
        return len(self.log_beliefs)


def perceive(
    sensor: TouchSensor, engine: Engine, theta_w: float, move: MovePolicy, deadline: int = DEADLINE
) -> Episode:
    """Taps until the belief in one object exceeds the threshold; Fig. 2 of the paper.

    After each tap come the update (Eq. 3, 4), the stop test (Eq. 7) and, if it goes on, the move (Eq. 8, 10) with the
    shift of the belief (Eq. 9). The stop test comes first because the shift may change the what marginal. The belief
    is shifted by the commanded move: the realised one would tell where the sensor stood.

    Args:
        sensor: Where taps come from.
        engine: How beliefs are computed.
        theta_w: Threshold on the what belief; 1 or more never stops.
        move: Control strategy.
        deadline: Taps after which the most probable classes are taken.

    Raises:
        InputError: The deadline is below one tap, or the sensor prepares its taps otherwise than the model's.
        ZeroEvidenceError: A tap is impossible under every class.
    """
    if deadline < 1:
        raise InputError(f"The deadline must be at least one tap, got {deadline}.")
    engine.model.check_taps(sensor.preprocessing)
    log_belief = engine.model.log_prior
    log_beliefs, log_evidence, moves, realised = [], [], [], []
    while True:
        log_belief, evidence = engine.update(log_belief, sensor.tap())
        log_beliefs.append(log_belief)
        log_evidence.append(evidence)
        belief = np.exp(log_belief)
        decision = reference.what_decision(belief, theta_w)
        if decision is not None or len(log_beliefs) == deadline:
            break
        delta = move(belief)
        moves.append(delta)
        realised.append(sensor.move(delta))
        log_belief = engine.shift(log_belief, delta)
    return Episode(
        log_beliefs=np.array(log_beliefs),
        log_evidence=np.array(log_evidence),
        moves=np.array(moves, dtype=np.int64),
        realised=np.array(realised, dtype=np.int64),
        what=int(np.argmax(reference.what_marginal(belief))),
        where=int(np.argmax(reference.where_marginal(belief))),
        stopped=decision is not None,
    )
