"""Inputs and outputs of trials, as records of arrays for compiled loops."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...hardware.replay import TapPool


class TapTable(NamedTuple):
    """Test taps with their log-likelihoods.

    Attributes:
        log_likelihood: log P(z | class) of every tap, shape (N, L, S M): hypothesis s M + m is object m in state s of
            the episode, see `models.measurement.states`; without states S is 1.
        pool: Which taps belong to which class; its arrays have the shape (L, M).
        log_prior: Log belief before the first tap, shape (L, S M).
        saturation: How many taps' evidence a sequence of them carries at most, see `saturation`.
        session: Session of each tap, shape (N,); `None` where all are of one.
        given_trained: Which classes belief may move into, shape (L, M); `None` for those with a prior above 0.
    """

    log_likelihood: NDArray[np.float64]
    pool: TapPool
    log_prior: NDArray[np.float64]
    saturation: float = np.inf
    session: NDArray[np.integer] | None = None
    given_trained: NDArray[np.bool_] | None = None

    @property
    def trained(self) -> NDArray[np.bool_]:
        """Mask of the classes that may have belief, shape (L, M)."""
        if self.given_trained is not None:
            return self.given_trained
        L, M = self.pool.nearest.shape
        return (self.log_prior > -np.inf).reshape(L, -1, M).any(axis=1)


class TrialPlan(NamedTuple):
    """Plan of n trials.

    Attributes:
        where: Class in which the sensor starts, shape (n,).
        what: Class of the object, shape (n,).
        fixation: Class that the sensor aims for, shape (n,).
        stream: Random stream, shape (n,); trials of one stream see the same random numbers.
    """

    where: NDArray[np.intp]
    what: NDArray[np.intp]
    fixation: NDArray[np.intp]
    stream: NDArray[np.intp]


class Rule(NamedTuple):
    """Moving and stopping of trials, in the form of the compiled loops.

    Attributes:
        thresholds: theta_W in increasing order, infinity for those that never stop, shape (H,).
        column: Where each stands in the results, shape (H,).
        theta_x: Threshold for a move.
        border: Number of the border, see `engines.compiled.border_number`.
        deadline: Taps after which the most probable classes are taken.
        key0: First key word of the seed.
        key1: Second key word.
        fresh: Whether no tap is drawn twice in a trial. A trial that has had all stored taps of the class where it
            stands then ends with the most probable classes, as at the deadline. Otherwise taps are drawn with
            replacement. The move to that class is no part of the trial: it brought no tap.
    """

    thresholds: NDArray[np.float64]
    column: NDArray[np.int64]
    theta_x: float
    border: int
    deadline: int
    key0: np.uint64
    key1: np.uint64
    fresh: bool = False


class Trials(NamedTuple):
    """Decisions of n trials at H thresholds; all arrays of shape (n, H).

    Attributes:
        taps: Reaction time.
        what: Decided what class.
        where: Decided where class, at the place of the last tap.
        true_where: Class in which the sensor stood then.
        stopped: Whether the threshold was crossed; otherwise the deadline came.
        clamped: Moves before the last tap that the end of the range cut short.
        substituted: Times before the last tap that a class without a tap was replaced by the nearest with one.
        belief: Belief in the decided what class.
        used_up: Whether a trial on fresh taps ended because it had had all stored taps of the class, see `Rule.fresh`.
        no_class_left: Whether the trial ended undecided with a tap that was impossible under every class still believed
            in; the decision is what was most probable before that tap, which `taps` counts.
    """

    taps: NDArray[np.int64]
    what: NDArray[np.int64]
    where: NDArray[np.int64]
    true_where: NDArray[np.int64]
    stopped: NDArray[np.bool_]
    clamped: NDArray[np.int64]
    substituted: NDArray[np.int64]
    belief: NDArray[np.float64]
    used_up: NDArray[np.bool_]
    no_class_left: NDArray[np.bool_]


class Likelihoods(NamedTuple):
    """Likelihoods of N taps relative to the largest of each, as scaled numbers z 2^(-256 k).

    Attributes:
        rows: z, 0 where the tap is impossible, shape (N, S M, L).
        least: The smallest z above 0 of each tap, shape (N,).
        wide: Whether some k is not 0, shape (N,).
        units: k, shape (N, S M, L), or (0, S M, L) where no tap is wide.
    """

    rows: NDArray[np.float64]
    least: NDArray[np.float64]
    wide: NDArray[np.bool_]
    units: NDArray[np.int64]


class ScaledBelief(NamedTuple):
    """Belief relative to its largest class, as scaled numbers.

    Attributes:
        z: Shape (S M, L).
        k: Shape (S M, L).
        least: The smallest z above 0.
    """

    z: NDArray[np.float64]
    k: NDArray[np.int64]
    least: float


class Classes(NamedTuple):
    """Mask of the classes that may have belief.

    Attributes:
        holes: Whether some may hold none.
        trained: Which may, shape (M, L).
        nearest: The nearest such position of the same object, shape (M, L).
    """

    holes: bool
    trained: NDArray[np.bool_]
    nearest: NDArray[np.int64]
