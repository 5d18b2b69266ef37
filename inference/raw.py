"""Independent route from raw taps to beliefs, decisions and moves by `reference` alone, for checks.

Every other route starts from a fitted model: its counts, edges, exponent, prior and trained classes. This one starts
from the samples of the training taps and their class labels, and does each step by an equation of `reference`, so an
error in the fit cannot hide by being in all routes alike. It serves as a check; loops are plain and slow.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from . import reference
from .reference import Border, Power, ValueRange


class Options(NamedTuple):
    """Options of the route.

    Attributes:
        bins: Number of bins.
        value_range: Whether they span the range of all taxels together or of each.
        pseudocount: Added to every bin, in counts.
        power: Root of Eq. 1.
        border: Reading of Eq. 9.
        saturation: How many taps the taps of an episode count for at most.
    """

    bins: int = 100
    value_range: ValueRange = "global"
    pseudocount: float = 0.01
    power: Power = "J"
    border: Border = "uniform"
    saturation: float = np.inf


class LabelledTaps(NamedTuple):
    """Taps with labels, as recorded and preprocessed.

    Attributes:
        samples: Shape (N, J, K).
        where: Where class of each tap, -1 outside the grid, shape (N,).
        what: What class of each tap, likewise.
    """

    samples: NDArray[np.floating]
    where: NDArray[np.intp]
    what: NDArray[np.intp]


class Decision(NamedTuple):
    """End of a trial at one threshold.

    Attributes:
        taps: Reaction time.
        what: Decided object.
        where: Decided position, at the place of the last tap.
        true_where: Where the sensor stands.
        stopped: Whether the belief exceeded the threshold; otherwise the deadline came, or no class was left.
        no_class_left: Whether the last tap was impossible under every class still believed in.
        belief: Largest what marginal.
    """

    taps: int
    what: int
    where: int
    true_where: int
    stopped: bool
    no_class_left: bool
    belief: float


@dataclass(frozen=True)
class RawFilter:
    """The paper's filter, trained on raw taps.

    Attributes:
        options: What the user chose.
        edges: Bin edges, shape (B + 1,) or (K, B + 1).
        log_prob: Eq. 2 in logs, -inf for untrained classes, shape (L, M, K, B).
        trained: Which classes have a training tap, shape (L, M).
        exponent: That of Eq. 1.
    """

    options: Options
    edges: NDArray[np.float64]
    log_prob: NDArray[np.float64]
    trained: NDArray[np.bool_]
    exponent: float

    @classmethod
    def learn(cls, taps: LabelledTaps, shape: tuple[int, int], options: Options) -> Self:
        """Trained filter by Eq. 2; taps outside the grid of `shape` (L, M) are left out."""
        inside = (taps.where >= 0) & (taps.what >= 0)
        samples, where, what = (part[inside] for part in taps)
        edges = reference.bin_edges(samples, options.bins, options.value_range)
        counts = reference.histogram_counts(samples, edges, where, what, shape)
        log_prob = reference.log_histograms(counts, options.pseudocount)
        exponent = reference.exponent(options.power, *samples.shape[1:])
        return cls(options, edges, log_prob, reference.trained_classes(counts), exponent)

    @property
    def log_prior(self) -> NDArray[np.float64]:
        """Log belief before the first tap, shape (L, M)."""
        return reference.log_flat_prior(self.trained)

    def update(self, log_belief: NDArray[np.float64], tap: NDArray[np.floating]) -> tuple[NDArray[np.float64], float]:
        """Log belief (L, M) after a tap (J, K), and the log evidence of the tap; Eq. 1, 3 and 4."""
        bins = reference.tap_bins(tap, self.edges)
        return reference.update_log(log_belief, reference.tap_log_likelihood(bins, self.log_prob, self.exponent))

    def shift(self, log_belief: NDArray[np.float64], delta: int) -> NDArray[np.float64]:
        """Log belief (L, M) after a move by `delta` positions; Eq. 9."""
        return reference.shift_log(log_belief, delta, self.options.border, self.trained)

    def trial(
        self,
        taps: LabelledTaps,
        start: tuple[int, int],
        fixation: int,
        uniforms: Iterator[float],
        thresholds: Sequence[float],
        deadline: int,
    ) -> list[Decision]:
        """Decisions of a trial of active perception on recorded taps, at every threshold; Eq. 7, 8 and 10.

        Args:
            taps: Test taps.
            start: Where class that the sensor starts in and object, which has a tap.
            fixation: Where class that the sensor aims for.
            uniforms: A number in [0, 1) for each tap, which picks it from those of the class.
            thresholds: theta_W, increasing.
            deadline: Taps after which the most probable classes are taken.
        """
        decisions: list[Decision] = []
        log_belief, what = self.log_prior, start[1]
        here, read = _nearest_with_tap(taps, *start), self.log_prior
        for number in range(1, deadline + 1):
            ended = False
            try:
                log_belief, _ = self.update(log_belief, _pick(taps, here, what, next(uniforms)))
                read = reference.saturated(log_belief, number, self.options.saturation)
            except reference.ZeroEvidenceError:
                ended = True  # what was believed before the tap is all there is
            belief = np.exp(read)
            where_map, what_map = (
                int(reference.where_marginal(belief).argmax()),
                int(reference.what_marginal(belief).argmax()),
            )
            for theta in thresholds[len(decisions) :]:
                stopped = not ended and reference.what_decision(belief, theta) is not None
                if not (stopped or ended) and number < deadline:
                    break
                largest = float(reference.what_marginal(belief).max())
                decisions.append(Decision(number, what_map, where_map, here, stopped, ended, largest))
            if len(decisions) == len(thresholds):
                break
            delta = reference.fixation_move(where_map, fixation)
            log_belief = self.shift(log_belief, delta)
            read = reference.saturated(log_belief, number, self.options.saturation)
            here = _nearest_with_tap(taps, min(max(here + delta, 0), len(self.trained) - 1), what)
        return decisions


def _nearest_with_tap(taps: LabelledTaps, where: int, what: int) -> int:
    """Position nearest to `where` with a tap of the object, the lower of two."""
    places = np.unique(taps.where[taps.what == what])
    return min((place for place in places.tolist() if place >= 0), key=lambda place: (abs(place - where), place))


def _pick(taps: LabelledTaps, where: int, what: int, uniform: float) -> NDArray[np.floating]:
    """Tap of a class that a uniform number in [0, 1) selects, in recorded order."""
    own = np.flatnonzero((taps.where == where) & (taps.what == what))
    return taps.samples[own[int(uniform * len(own))]]
