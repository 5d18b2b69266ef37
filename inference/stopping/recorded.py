"""Stopping rules applied to trials that were recorded up to their deadline."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..trials.lockstep import Record
from .stopping import GO_ON, Moment, StopRule


class Stops(NamedTuple):
    """Stopping of n trials.

    Attributes:
        taps: Reaction time in taps, shape (n,).
        answer: `DECIDE`, `GIVE_UP`, or `GO_ON` if the record ended before, shape (n,).
    """

    taps: NDArray[np.int64]
    answer: NDArray[np.int8]


def stops(rule: StopRule, record: Record) -> Stops:
    """Stopping of recorded trials by a rule; trials that it never stops end with the record.

    Rules are not evaluated at taps that left no possible class.
    """
    T = record.where.shape[1]
    gain = record.watched.get("gain", np.full(record.where.shape, np.nan))
    number = np.broadcast_to(np.arange(1, T + 1), record.where.shape)
    said = np.asarray(rule(Moment(record.what_marginal, record.where_belief, number, gain)))
    said = np.where(number > (record.length - record.no_class_left)[:, np.newaxis], GO_ON, said)
    stopped = said != GO_ON
    first = np.where(stopped.any(axis=1), stopped.argmax(axis=1), record.length - 1)
    return Stops(first + 1, said[np.arange(len(first)), first].astype(np.int8))
