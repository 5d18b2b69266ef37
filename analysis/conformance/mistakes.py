"""Common mistakes, each as the exact equations with one wrong step, and the search for one that explains an answer."""

from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .answers import LOGS, Answer
from .arithmetic import MP, Matrix, Number
from .case import Case
from .comparison import Difference, first_difference, is_later
from .exact import Bins, Exact
from .level_mistakes import FORMS
from .tolerance import Tolerance

_ROUNDING = 1e-12


class Mistake(NamedTuple):
    """A usual mistake.

    Attributes:
        name: In one word.
        about: What is done, as the end of a sentence; `{digits}` stands for what a verdict says.
        rules: Forms in which it occurs; none where `causes` sees it in the numbers.
        key: Of the header, without which it does not show.
    """

    name: str
    about: str
    rules: tuple[type[Exact], ...]
    key: str = "prior"

    def shows(self, case: Case) -> bool:
        """Whether the case has what it is about."""
        return getattr(case, self.key) is not None


class _ShiftDirection(Exact):
    def shift(self, belief: Matrix, move: int) -> Matrix:
        return super().shift(belief, -move)


class _MoveIgnored(Exact):
    def shift(self, belief: Matrix, move: int) -> Matrix:  # noqa: ARG002
        return belief


class _MeanOverTaxels(Exact):
    @cached_property
    def exponent(self) -> Number:
        return super().exponent / self.K


class _NoRoot(Exact):
    @cached_property
    def exponent(self) -> Number:
        return MP.mpf(1)


def _reaches(belief: Number, threshold: float) -> bool:
    return bool(belief + _ROUNDING >= threshold)


class _GreaterOrEqual(Exact):
    def exceeds(self, belief: Number, threshold: float) -> bool:
        return _reaches(belief, threshold)


class _DecidesWhenEqual(Exact):
    """Only the decision is wrong."""

    def decide(self, belief: Matrix, what: list[Number], threshold: float) -> int:
        index = self.what_index(belief, what)
        return index if _reaches(what[index], threshold) else -1


class _MovesWhenEqual(_GreaterOrEqual):
    """Only the move is wrong."""

    def decide(self, belief: Matrix, what: list[Number], threshold: float) -> int:
        index = self.what_index(belief, what)
        return index if Exact.exceeds(self, what[index], threshold) else -1


class _BeforeUpdate(Exact):
    def seen(self, before: Matrix, posterior: Matrix) -> Matrix:  # noqa: ARG002
        return before


class _TaxelRange(Exact):
    @cached_property
    def edges(self) -> Matrix:
        training = self.case.training
        if training is None:
            return super().edges
        return [self.range_edges(training.taps[..., k].ravel().tolist()) for k in range(self.K)]


class _TaxelRangeFirst(_TaxelRange):
    """Only the edges of one taxel are told."""

    told = 0

    def edges_told(self) -> NDArray[np.float64]:
        return super().edges_told()[self.told]


class _TaxelRangeLast(_TaxelRangeFirst):
    told = -1


class _OneBasedDecision(Exact):
    def decide(self, belief: Matrix, what: list[Number], threshold: float) -> int:
        index = super().decide(belief, what, threshold)
        return index if index < 0 else index + 1


class _LowFixation(Exact):
    off = -1

    def own_move(self, belief: Matrix, where: list[Number]) -> int:
        index = self.where_index(belief, where)
        aim = self.case.fixation + self.off
        return aim - index if self.exceeds(where[index], self.case.theta_x) else 0


class _HighFixation(_LowFixation):
    off = 1


class _Renormalised(Exact):
    def vacated_cell(self, lost: list[Number], vacated: list[int], m: int) -> Number:
        return super().vacated_cell(lost, vacated, m) if self.border == "prior" else MP.mpf(0)


class _HolesEntered(Exact):
    @cached_property
    def trained(self) -> list[list[bool]]:
        return [[True] * self.M for _ in range(self.L)]


class _LinearBelief(Exact):
    def divided(self, joint: Matrix) -> tuple[Matrix, Number]:
        posterior, log_evidence = super().divided(joint)
        return [[MP.mpf(float(p)) for p in row] for row in posterior], log_evidence


class _LinearProduct(Exact):
    def log_products(self, bins: Bins) -> Matrix:
        return [[x if float(MP.exp(x)) > 0 else MP.ninf for x in row] for row in super().log_products(bins)]


class _MoveSign(Exact):
    def own_move(self, belief: Matrix, where: list[Number]) -> int:
        return -super().own_move(belief, where)


class _JointMaximum(Exact):
    def what_index(self, belief: Matrix, what: list[Number]) -> int:  # noqa: ARG002
        return self._best(belief) % self.M

    def where_index(self, belief: Matrix, where: list[Number]) -> int:  # noqa: ARG002
        return self._best(belief) // self.M

    def _best(self, belief: Matrix) -> int:
        return self.largest([p for row in belief for p in row])


class _JointObject(_JointMaximum):
    """The place is that of the marginal."""

    where_index = Exact.where_index


class _JointPlace(_JointMaximum):
    """The object is that of the marginal."""

    what_index = Exact.what_index


class _NoClipping(Exact):
    def bin(self, sample: float, k: int) -> int | None:
        return super().bin(sample, k) if self.edges[k][0] <= sample <= self.edges[k][-1] else None


class _RightClosed(Exact):
    def bin(self, sample: float, k: int) -> int | None:
        return bisect_left(self.edges[k], sample, 1, self.B) - 1


class _Replaced(Exact):
    def probability(self, counts: list[int], b: int) -> Number:
        return MP.mpf(counts[b] or self.case.pseudocount) / MP.mpf(sum(counts) or 1)


class _PriorEveryTap(Exact):
    def update(self, belief: Matrix, log_likelihood: Matrix) -> tuple[Matrix, Number]:
        weighed = [[p * q for p, q in zip(*rows, strict=True)] for rows in zip(belief, self.prior, strict=True)]
        return super().update(weighed, log_likelihood)


class _PriorEveryTapOnce(_PriorEveryTap):
    """The same, but the first tap has the prior once."""

    def answers(self) -> Iterator[Answer]:
        self._first = True
        yield from super().answers()

    def update(self, belief: Matrix, log_likelihood: Matrix) -> tuple[Matrix, Number]:
        first, self._first = self._first, False
        return Exact.update(self, belief, log_likelihood) if first else super().update(belief, log_likelihood)


class _LogTen(Exact):
    def answers(self) -> Iterator[Answer]:
        for answer in super().answers():
            tens = {name: answer.values[name] / np.log(10) for name in (*LOGS, "log_evidence") if name in answer.values}
            yield replace(answer, values={**answer.values, **tens})


class _ShiftAfterUpdate(Exact):
    def step(self, belief: Matrix, move: int, log_likelihood: Matrix) -> tuple[Matrix, Matrix, Number]:
        posterior, log_evidence = self.update(belief, log_likelihood)
        return belief, self.shift(posterior, move), log_evidence


class _Forgotten(Exact):
    def step(self, belief: Matrix, move: int, log_likelihood: Matrix) -> tuple[Matrix, Matrix, Number]:  # noqa: ARG002
        return self.prior, *self.update(self.prior, log_likelihood)


class _HighestTie(Exact):
    def largest(self, marginal: list[Number]) -> int:
        return len(marginal) - 1 - super().largest(marginal[::-1])


class _Transposed(Exact):
    def log_likelihood(self, tap: list[list[float]]) -> Matrix:
        flat = [value for sample in tap for value in sample]
        return super().log_likelihood([flat[j :: self.J] for j in range(self.J)])


class _StaysWhenAnyDecided(Exact):
    quorum = staticmethod(any)

    def own_move(self, belief: Matrix, where: list[Number]) -> int:
        what = self.what_marginal(belief)
        decided = self.quorum(self.decide(belief, what, theta) >= 0 for theta in self.case.thresholds)
        return 0 if decided else super().own_move(belief, where)


class _StaysWhenAllDecided(_StaysWhenAnyDecided):
    quorum = staticmethod(all)


class _StaysWhenFirstDecided(_StaysWhenAnyDecided):
    quorum = staticmethod(next)


def _with_border(border: str) -> type[Exact]:
    return type(f"_Border_{border}", (Exact,), {"border": border})


MISTAKES = (
    Mistake("shift-direction", "the belief is shifted in the wrong direction", (_ShiftDirection,)),
    Mistake("move-ignored", "the belief stays where it is when the finger moves", (_MoveIgnored,)),
    Mistake("mean-over-taxels", "log-likelihoods are averaged over taxels in place of added", (_MeanOverTaxels,)),
    Mistake(
        "greater-or-equal",
        "a belief that equals the threshold decides, >= in place of >",
        (_GreaterOrEqual, _DecidesWhenEqual, _MovesWhenEqual),
    ),
    Mistake("marginal-before-update", "marginals are taken from the belief before the update", (_BeforeUpdate,)),
    Mistake(
        "taxel-range",
        "each taxel has a range of its own in place of one for all",
        (_TaxelRange, _TaxelRangeFirst, _TaxelRangeLast),
    ),
    Mistake(
        "one-based",
        "an index counts from 1 in place of 0",
        (
            _OneBasedDecision,
            _LowFixation,
            _HighFixation,
            type("_OneBasedLow", (_OneBasedDecision, _LowFixation), {}),
            type("_OneBasedHigh", (_OneBasedDecision, _HighFixation), {}),
        ),
    ),
    Mistake(
        "renormalised-border",
        "belief that leaves the range is dropped and the rest divided by its sum",
        (_Renormalised,),
    ),
    Mistake(
        "linear-underflow",
        "beliefs are carried as plain numbers, and a class that underflowed to 0 cannot come back",
        (_LinearBelief,),
    ),
    Mistake("linear-likelihood", "a product of plain probabilities underflows to 0", (_LinearProduct,)),
    Mistake("no-root", "the root of Eq. 1 is left out", (_NoRoot,)),
    Mistake("move-sign", "the move has the wrong sign", (_MoveSign,)),
    Mistake(
        "joint-maximum",
        "the most probable joint class decides in place of the marginals",
        (_JointMaximum, _JointObject, _JointPlace),
    ),
    Mistake("no-clipping", "samples outside the range are left out in place of put into the end bins", (_NoClipping,)),
    Mistake("right-closed-bins", "a sample on an edge goes into the lower bin", (_RightClosed,)),
    Mistake(
        "pseudocount-unnormalised", "the pseudocount replaces zeros only, and nothing is normalised again", (_Replaced,)
    ),
    Mistake(
        "other-border",
        "the border is another than the one asked for",
        tuple(_with_border(border) for border in ("uniform", "uniform_what", "prior", "clamp", "circular")),
    ),
    Mistake("prior-every-tap", "the prior comes in at every tap", (_PriorEveryTap, _PriorEveryTapOnce)),
    Mistake("log10", "logarithms are to base 10 in place of natural", (_LogTen,)),
    Mistake("shift-after-update", "the belief is shifted after the update in place of before it", (_ShiftAfterUpdate,)),
    Mistake("belief-forgotten", "every tap begins from the prior in place of the belief so far", (_Forgotten,)),
    Mistake("ties-to-highest", "of equal beliefs the highest index counts in place of the lowest", (_HighestTie,)),
    Mistake("transposed-tap", "the samples of a tap are read as [K][J] in place of [J][K]", (_Transposed,)),
    Mistake("holes-entered", "belief moves into untrained classes, where the next tap destroys it", (_HolesEntered,)),
    Mistake(
        "stays-when-decided",
        "there is no move any more once an object is decided",
        (_StaysWhenAnyDecided, _StaysWhenAllDecided, _StaysWhenFirstDecided),
    ),
    Mistake("density", "a density takes the place of the integral over a bin", FORMS["density"], "mean"),
    Mistake("closed-ends", "the end bins end at the outer edges in place of infinity", FORMS["closed-ends"], "mean"),
    Mistake("variance", "the standard deviation is used as the variance, or the other way", FORMS["variance"], "mean"),
    Mistake("plain-integral", "the integral over a bin in a tail underflows to 0", FORMS["plain-integral"], "mean"),
    Mistake(
        "other-information",
        "the information is about something else than asked for",
        FORMS["other-information"],
        "pool",
    ),
    Mistake(
        "information-units",
        "the information is to base 2 or 10 in place of in nats",
        FORMS["information-units"],
        "pool",
    ),
    Mistake(
        "information-move",
        "the information is that of the opposite move, or of none",
        FORMS["information-move"],
        "pool",
    ),
    Mistake(
        "pool-without-root", "likelihoods of the pool are without the root of Eq. 1", FORMS["pool-without-root"], "pool"
    ),
    Mistake(
        "impossible-pool",
        "the belief that is left, where no tap of the pool is possible in some classes, is not divided by its sum",
        FORMS["impossible-pool"],
        "pool",
    ),
    Mistake(
        "strategy-ignored",
        "the move is that of Eq. 8 and 10 in place of the strategy's",
        FORMS["strategy-ignored"],
        "pool",
    ),
    Mistake("rounded", "numbers are rounded to {digits}, where 17 digits are due", ()),
)


def explains(
    mistake: Mistake,
    case: Case,
    actual: Sequence[Answer],
    found: Difference,
    tolerances: dict[str, Tolerance],
    without: Sequence[str] = (),
    refuted: Callable[[type[Exact]], bool] = lambda _: False,
) -> bool:
    """Whether a mistake gives what a program answered, up to and including what is wrong with it.

    Args:
        mistake: The mistake.
        case: The case.
        actual: The program's answers.
        found: The first difference from the right ones.
        tolerances: Of the case.
        without: Quantities that are not compared.
        refuted: Whether the program answers other cases as a form of the mistake would not.
    """
    if not found.quantity or not mistake.shows(case):
        return False
    taps = max(found.tap, 1)
    forms = (rules for rules in mistake.rules if _explains(rules(case, taps), actual, found, tolerances, without))
    return any(not refuted(rules) for rules in forms)


def _explains(
    rules: Exact,
    actual: Sequence[Answer],
    found: Difference,
    tolerances: dict[str, Tolerance],
    without: Sequence[str],
) -> bool:
    other = None
    for predicted in rules.answers():
        other = first_difference(rules.case, [predicted], actual, tolerances, without)
        if other is not None:
            break
    return is_later(other, found)
