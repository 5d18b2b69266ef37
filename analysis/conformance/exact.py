"""Exact answers to a case in 60-digit arithmetic, straight from the paper's equations.

It shares no code with the reference and the engines. Numbers of this arithmetic have no smallest one, so beliefs are
plain probabilities, whatever their size. Every step is a method, so that a usual mistake is a class in which one step
is another, see `mistakes`.
"""

from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .answers import ZERO_EVIDENCE, Answer
from .arithmetic import MP, Matrix, Number, log
from .case import Case
from .information import Outcomes, best_move, information, outcomes

_SAME = MP.mpf(10) ** -50  # beliefs that differ by less, in proportion, are equal but for the rounding here

type Bins = tuple[tuple[int | None, ...], ...]


@lru_cache(maxsize=1024)
def _likelihoods(case: Case, steps: tuple[Any, ...]) -> dict[int, Matrix]:  # noqa: ARG001 - they are the key
    """Log-likelihoods of a case by tap, as far as known, those of its pool by negative numbers.

    Most mistakes share those of the equations.
    """
    return {}


@lru_cache(maxsize=512)
def _log_products(case: Case, steps: tuple[Any, ...]) -> dict[Bins, Matrix]:  # noqa: ARG001 - they are the key
    """Log products of a case by the bins of a tap, as far as known.

    They take the most time, and mistakes in bins, the exponent or the order of samples share them.
    """
    return {}


class NoEvidence(ArithmeticError):
    """A tap is impossible under every class."""


class Exact:
    """The equations, one method each.

    Args:
        case: What is given.
        taps: How many of its taps are answered, default all.
    """

    LIKELIHOOD = (
        "edges",
        "range_edges",
        "counts",
        "bin",
        "log_probability",
        "probability",
        "normal_probability",
        "bounds",
        "scale",
        "exponent",
        "log_likelihood",
        "log_products",
    )
    """The steps that lead to the log-likelihoods of a tap."""
    PRODUCT = ("log_probability", "probability", "normal_probability", "bounds", "scale")
    """The steps that lead from its bins to their log products; in a case with training taps also all of the above."""

    def __init__(self, case: Case, taps: int | None = None) -> None:
        self.case = case
        self._taps = taps
        self.L, self.M, self.K, self.J, self.B = case.sizes.values()
        self.prior: Matrix = [[MP.mpf(p) for p in row] for row in case.prior.tolist()]
        self._log_probability = lru_cache(maxsize=None)(self.log_probability)
        self._exp = lru_cache(maxsize=4096)(MP.exp)  # long episodes repeat few taps
        # Belief, and what a tap would tell after each move from it.
        self._gains: tuple[Matrix, list[Number]] | None = None
        self._of_bins = lru_cache(maxsize=None)(self.of_bins)
        self._likelihoods = _likelihoods(case, self._steps(self.LIKELIHOOD))
        self._log_products = _log_products(
            case, self._steps(self.PRODUCT if case.training is None else self.LIKELIHOOD)
        )

    def _steps(self, names: Sequence[str]) -> tuple[Any, ...]:
        return tuple(getattr(type(self), name) for name in names)

    def answers(self) -> Iterator[Answer]:
        """One answer after the other; it ends with a tap that is impossible."""
        if self.case.training is not None:
            yield Answer(0, {"edges": self.edges_told(), "counts": np.array(self.counts, dtype=np.float64)})
        belief = self.prior
        for t, move in enumerate(self.case.moves[: self._taps].tolist()):
            log_likelihood = self._likelihood(t, self.case.taps[t].tolist())
            try:
                before, belief, log_evidence = self.step(belief, move, log_likelihood)
            except NoEvidence:
                yield Answer(t + 1, error=ZERO_EVIDENCE)
                return
            if self.case.expects(t + 1):
                seen = self.seen(before, belief)
                where, what = self.where_marginal(seen), self.what_marginal(seen)
                values = {
                    "log_likelihood": _floats(log_likelihood),
                    "log_evidence": float(log_evidence),
                    "posterior": _floats(belief),
                    "log_posterior": np.array([[float(log(p)) for p in row] for row in belief]),
                    "where": _floats(where),
                    "what": _floats(what),
                    "decisions": np.array([self.decide(seen, what, theta) for theta in self.case.thresholds]),
                    "move": self.own_move(seen, where),
                }
                if self.case.strategy:
                    values["information"] = _floats(self.gains(seen, where))
                yield Answer(t + 1, values)

    @cached_property
    def edges(self) -> Matrix:
        """Bin edges of each taxel."""
        if self.case.training is not None:
            return [self.range_edges(self.case.training.taps.ravel().tolist())] * self.K
        return np.broadcast_to(np.asarray(self.case.edges), (self.K, self.B + 1)).tolist()

    def range_edges(self, samples: list[float]) -> list[Number]:
        """B bins of equal width over the range of the samples."""
        low, high = MP.mpf(min(samples)), MP.mpf(max(samples))
        return [low + (high - low) * b / self.B for b in range(self.B + 1)]

    @cached_property
    def counts(self) -> list[Any]:
        """h_k(b) of every class, [L][M][K][B]."""
        training = self.case.training
        if training is None:
            return [] if self.case.counts is None else self.case.counts.tolist()
        counts = np.zeros((self.L, self.M, self.K, self.B), dtype=np.int64)
        for tap, l, m in zip(training.taps.tolist(), training.where.tolist(), training.what.tolist(), strict=True):
            for sample in tap:
                for k, value in enumerate(sample):
                    counts[l, m, k, self.bin(value, k)] += 1
        return counts.tolist()

    def bin(self, sample: float, k: int) -> int | None:
        """The bin of a sample; half-open, the last one closed, values outside go to the end bins."""
        return bisect_right(self.edges[k], sample, 1, self.B) - 1

    def log_probability(self, l: int, m: int, k: int, b: int) -> Number:
        """Log P_k(b | l, m)."""
        if self.case.mean is not None:
            return log(self.normal_probability(l, m, k, b))
        if self.case.probabilities is not None:
            return log(MP.mpf(float(self.case.probabilities[l, m, k, b])))
        return log(self.probability(self.counts[l][m][k], b))

    def probability(self, counts: list[int], b: int) -> Number:
        """Eq. 2 for one bin of a histogram."""
        pseudocount = MP.mpf(self.case.pseudocount)
        return (counts[b] + pseudocount) / (sum(counts) + pseudocount * len(counts))

    def normal_probability(self, l: int, m: int, k: int, b: int) -> Number:
        """The integral of a normal distribution over a bin."""
        mean, sd = self.normal(l, m, k)
        lower, upper = ((edge - mean) / self.scale(sd) for edge in self.bounds(k, b))
        if lower + upper > 0:  # as tails lose no digits at the lower end
            lower, upper = -upper, -lower
        return MP.ncdf(upper) - (MP.ncdf(lower) if lower > MP.ninf else 0)

    def normal(self, l: int, m: int, k: int) -> list[Number]:
        """Mean and standard deviation of a class and taxel."""
        return [MP.mpf(float(array[l, m, k])) for array in (self.case.mean, self.case.sd) if array is not None]

    def scale(self, sd: Number) -> Number:
        """What distances from the mean are divided by."""
        return sd

    def bounds(self, k: int, b: int) -> tuple[Number, Number]:
        """Edges of a bin; the end bins reach to infinity."""
        last = self.B - 1
        return self.edges[k][b] if b > 0 else MP.ninf, self.edges[k][b + 1] if b < last else MP.inf

    @cached_property
    def exponent(self) -> Number:
        """The root of Eq. 1."""
        named = {"J": MP.mpf(1) / self.J, "JK": MP.mpf(1) / (self.J * self.K), "none": MP.mpf(1)}
        power = self.case.power
        return named[power] if isinstance(power, str) else MP.mpf(power)

    def _likelihood(self, key: int, tap: list[list[float]]) -> Matrix:
        if key not in self._likelihoods:
            self._likelihoods[key] = self.log_likelihood(tap)
        return self._likelihoods[key]

    def log_likelihood(self, tap: list[list[float]]) -> Matrix:
        """Log P(z | x_l, w_m); Eq. 1."""
        return self._of_bins(tuple(tuple(self.bin(value, k) for k, value in enumerate(sample)) for sample in tap))

    def of_bins(self, bins: Bins) -> Matrix:
        """Log-likelihoods of all classes; no bin is no factor. Taps of a long episode may all be of a few kinds."""
        return [[self.exponent * value for value in row] for row in self.log_products(bins)]

    def log_products(self, bins: Bins) -> Matrix:
        """Logs of the products over samples and taxels of all classes."""
        if bins not in self._log_products:
            times = Counter((k, b) for sample in bins for k, b in enumerate(sample) if b is not None)
            cells = [[(l, m) for m in range(self.M)] for l in range(self.L)]
            self._log_products[bins] = [[self._log_product(*cell, times) for cell in row] for row in cells]
        return self._log_products[bins]

    def _log_product(self, l: int, m: int, times: Counter[tuple[int, int]]) -> Number:
        return MP.fdot((n, self._log_probability(l, m, k, b)) for (k, b), n in times.items())

    def step(self, belief: Matrix, move: int, log_likelihood: Matrix) -> tuple[Matrix, Matrix, Number]:
        """Beliefs before and after a tap that follows a move, and the log evidence."""
        before = self.shift(belief, move) if move else belief
        return before, *self.update(before, log_likelihood)

    def update(self, belief: Matrix, log_likelihood: Matrix) -> tuple[Matrix, Number]:
        """Posterior and log evidence; Eq. 3 and 4."""
        joint = [
            [p * self._exp(log_l) for p, log_l in zip(*rows, strict=True)]
            for rows in zip(belief, log_likelihood, strict=True)
        ]
        return self.divided(joint)

    def divided(self, joint: Matrix) -> tuple[Matrix, Number]:
        """A joint over its sum, and the log of the sum."""
        evidence = MP.fsum(p for row in joint for p in row)
        if not evidence > 0:
            raise NoEvidence
        return [[p / evidence for p in row] for row in joint], MP.log(evidence)

    def seen(self, before: Matrix, posterior: Matrix) -> Matrix:  # noqa: ARG002 - a usual mistake looks at the other
        """The belief that marginals, decisions and moves are taken from."""
        return posterior

    def where_marginal(self, belief: Matrix) -> list[Number]:
        """Eq. 5."""
        return [MP.fsum(row) for row in belief]

    def what_marginal(self, belief: Matrix) -> list[Number]:
        """Eq. 6."""
        return [MP.fsum(column) for column in zip(*belief, strict=True)]

    def largest(self, marginal: list[Number]) -> int:
        """Index of the largest, the lowest of equal ones."""
        top = max(marginal)
        return next(i for i, p in enumerate(marginal) if p >= top - top * _SAME)

    def what_index(self, belief: Matrix, what: list[Number]) -> int:  # noqa: ARG002 - a usual mistake asks the joint
        """The what class to decide for."""
        return self.largest(what)

    def where_index(self, belief: Matrix, where: list[Number]) -> int:  # noqa: ARG002
        """The where class to move from."""
        return self.largest(where)

    def exceeds(self, belief: Number, threshold: float) -> bool:
        """Whether a belief is greater than a threshold; never greater than 1."""
        return threshold < 1 and belief - threshold > _SAME

    def decide(self, belief: Matrix, what: list[Number], threshold: float) -> int:
        """The decided what class, -1 for none; Eq. 7."""
        index = self.what_index(belief, what)
        return index if self.exceeds(what[index], threshold) else -1

    def own_move(self, belief: Matrix, where: list[Number]) -> int:
        """Eq. 8 and 10, or the move of most expected information."""
        index = self.where_index(belief, where)
        if self.case.strategy:
            return best_move(self.gains(belief, where), index)
        return self.case.fixation - index if self.exceeds(where[index], self.case.theta_x) else 0

    def gains(self, belief: Matrix, where: list[Number]) -> list[Number]:
        """The information of `information`, computed once for each belief."""
        if self._gains is None or self._gains[0] is not belief:
            self._gains = belief, self.information(belief, where)
        return self._gains[1]

    def information(self, belief: Matrix, where: list[Number]) -> list[Number]:
        """Expected information of a tap at each position after the move there."""
        here = self.where_index(belief, where)
        moves = (self.move_to(l, here) for l in range(self.L))
        return [self.of_belief(self.shift(belief, move) if move else belief) for move in moves]

    def move_to(self, l: int, here: int) -> int:
        """The move after which a tap comes from a position."""
        return l - here

    def of_belief(self, belief: Matrix) -> Number:
        """Expected information of a tap under the belief after a move."""
        return information(self.pool, belief, self.case.strategy)

    @cached_property
    def pool(self) -> Outcomes:
        """The taps that may come."""
        return outcomes(self.pool_likelihoods)

    @property
    def pool_likelihoods(self) -> list[Matrix]:
        """Log-likelihoods of the taps that may come."""
        return [self._likelihood(~n, tap) for n, tap in enumerate(np.asarray(self.case.pool).tolist())]

    @cached_property
    def trained(self) -> list[list[bool]]:
        """Which classes belief may be in; those whose probabilities are all 0 were never trained."""
        if self.case.probabilities is None:
            return [[True] * self.M for _ in range(self.L)]
        return [[any(p > 0 for taxel in cell for p in taxel) for cell in row] for row in self.case.probabilities]

    def shift(self, belief: Matrix, move: int) -> Matrix:
        """Eq. 9."""
        shifted: Matrix = [[MP.mpf(0)] * self.M for _ in range(self.L)]
        lost, vacated = [MP.mpf(0)] * self.M, [list[int]() for _ in range(self.M)]
        for m in range(self.M):
            known = [l for l in range(self.L) if self.trained[l][m]]
            lands = self.landing(known, move)
            vacated[m] = [l for l in known if l not in lands]
            if self.border == "circular":
                free = iter(vacated[m])
                lands = [next(free) if place is None else place for place in lands]
            for l, place in zip(known, lands, strict=True):
                if place is None:
                    lost[m] += belief[l][m]
                else:
                    shifted[place][m] += belief[l][m]
        if self.border in ("uniform", "uniform_what", "prior"):
            for m, places in enumerate(vacated):
                for l in places:
                    shifted[l][m] = self.vacated_cell(lost, [len(places) for places in vacated], m)
        return self.divided(shifted)[0]

    def landing(self, known: list[int], move: int) -> list[int | None]:
        """Where belief about each known position of an object comes to lie, `None` where it would be no such one."""
        if self.border == "clamp":
            ends = [min(max(l + move, 0), self.L - 1) for l in known]
            return [min(known, key=lambda l, end=end: (abs(l - end), l)) for end in ends]
        targets = [(l + move) % self.L if self.border == "circular" else l + move for l in known]
        return [place if place in known else None for place in targets]

    @property
    def border(self) -> str:
        """The reading of Eq. 9."""
        return self.case.border

    def vacated_cell(self, lost: list[Number], vacated: list[int], m: int) -> Number:
        """What a vacated class of object m gets, from what each object lost and how many classes it has vacated."""
        if self.border == "uniform":
            return MP.fsum(lost) / sum(vacated)
        if self.border == "uniform_what":
            return lost[m] / vacated[m]
        return MP.mpf(1) / sum(map(sum, self.trained))

    def edges_told(self) -> NDArray[np.float64]:
        """Edges as an answer has them: once where they are the same for all taxels."""
        rows = _floats(self.edges)
        return rows[0] if (rows == rows[0]).all() else rows


def _floats(values: Any) -> Any:
    """The nearest doubles."""
    return np.array([[float(p) for p in row] if isinstance(row, list) else float(row) for row in values])
