"""Hypotheses beyond position and object: each object in each of S states that last for an episode.

A state is something unknown that all taps of an episode share, such as the gain of the sensor that day, or what a
model's latent variables of sessions are in that session. The belief is
carried over where and hypothesis, shape (L, H) with H = S M; hypothesis s M + m is object m in state s. Without states
S is 1 and the hypotheses are the objects.
"""

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray


class States(NamedTuple):
    """Gains and offsets that may apply to all samples of an episode: multiplied by a gain, then shifted by an offset.

    Attributes:
        gain: Shape (S,).
        offset: In the unit of the samples, shape (S,).
        log_prior: Logs of probabilities that sum to one, shape (S,).
    """

    gain: NDArray[np.float64]
    offset: NDArray[np.float64]
    log_prior: NDArray[np.float64]

    @classmethod
    def alike(cls, number: int) -> Self:
        """States of gain 1 and offset 0 that differ in something else."""
        return cls.weighted(np.zeros(number))

    @classmethod
    def weighted(cls, log_weight: NDArray[np.float64]) -> Self:
        """States of gain 1 and offset 0 that differ in something else, in proportion to these weights."""
        number = len(log_weight)
        return cls(np.ones(number), np.zeros(number), log_weight - np.logaddexp.reduce(log_weight))

    def apart(self) -> Self:
        """States of different gain or offset, each with the probability of all that are like it."""
        (gain, offset), number = np.unique(np.stack(self[:2]), axis=1, return_inverse=True)
        if len(gain) == len(self.gain):
            return self
        log_prior = np.full(len(gain), -np.inf)
        np.logaddexp.at(log_prior, number.ravel(), self.log_prior)
        return type(self)(gain, offset, log_prior)


ONE_STATE = States(np.ones(1), np.zeros(1), np.zeros(1))
