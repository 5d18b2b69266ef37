"""Common mistakes in the levels continuous and strategies, each as the exact equations with one wrong step."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from itertools import product

from .answers import Answer
from .arithmetic import MP, Matrix, Number
from .exact import Exact
from .information import STRATEGIES, Outcomes, information, outcomes


# Normal distributions
class _Centre(Exact):
    """The density at the centre of the bin, times its width."""

    def normal_probability(self, l: int, m: int, k: int, b: int) -> Number:
        low, high = (MP.mpf(edge) for edge in self.edges[k][b : b + 2])
        return MP.npdf((low + high) / 2, *self.normal(l, m, k)) * (high - low)


class _AtSample(Exact):
    """The density at the sample."""

    def log_likelihood(self, tap: list[list[float]]) -> Matrix:
        values = [(k, MP.mpf(value)) for sample in tap for k, value in enumerate(sample)]
        return [[self.exponent * self._log_density(l, m, values) for m in range(self.M)] for l in range(self.L)]

    def _log_density(self, l: int, m: int, values: list[tuple[int, Number]]) -> Number:
        return MP.fsum(MP.log(MP.npdf(value, *self.normal(l, m, k))) for k, value in values)


class _ClosedEnds(Exact):
    def bounds(self, k: int, b: int) -> tuple[Number, Number]:
        return self.edges[k][b], self.edges[k][b + 1]


class _Root(Exact):
    """The standard deviation is taken for the variance."""

    def scale(self, sd: Number) -> Number:
        return MP.sqrt(sd)


class _Square(Exact):
    """Distances are divided by the variance."""

    def scale(self, sd: Number) -> Number:
        return sd**2


class _PlainIntegral(Exact):
    def normal_probability(self, l: int, m: int, k: int, b: int) -> Number:
        return MP.mpf(float(super().normal_probability(l, m, k, b)))


# Expected information
class _OtherInformation(Exact):
    strategy = ""

    def of_belief(self, belief: Matrix) -> Number:
        return information(self.pool, belief, self.strategy)


_OTHERS = tuple(type(f"_About_{name}", (_OtherInformation,), {"strategy": name}) for name in STRATEGIES)


class _Bits(Exact):
    base = 2

    def of_belief(self, belief: Matrix) -> Number:
        return super().of_belief(belief) / MP.log(self.base)


class _Digits(_Bits):
    base = 10


class _OppositeMove(Exact):
    def move_to(self, l: int, here: int) -> int:
        return here - l


class _NoMove(Exact):
    def move_to(self, l: int, here: int) -> int:  # noqa: ARG002
        return 0


class _PoolWithoutRoot(Exact):
    @cached_property
    def pool(self) -> Outcomes:
        return outcomes([[[value / self.exponent for value in row] for row in tap] for tap in self.pool_likelihoods])


class _ImpossibleKept(Exact):
    """The rest of the belief is not divided by its sum."""

    def of_belief(self, belief: Matrix) -> Number:
        cells = product(range(self.L), range(self.M))
        rest = MP.fsum(belief[l][m] for l, m in cells if self.pool[l][m] is not None)
        return rest * (super().of_belief(belief) - MP.log(rest)) if rest > 0 else MP.mpf(0)


class _Fixation(Exact):
    """With the information all the same."""

    def own_move(self, belief: Matrix, where: list[Number]) -> int:
        index = self.where_index(belief, where)
        return self.case.fixation - index if self.exceeds(where[index], self.case.theta_x) else 0


class _NoInformation(_Fixation):
    def answers(self) -> Iterator[Answer]:
        for answer in super().answers():
            yield replace(answer, values={k: v for k, v in answer.values.items() if k != "information"})


FORMS: dict[str, tuple[type[Exact], ...]] = {
    "density": (_Centre, _AtSample),
    "closed-ends": (_ClosedEnds,),
    "variance": (_Root, _Square),
    "plain-integral": (_PlainIntegral,),
    "other-information": _OTHERS,
    "information-units": (_Bits, _Digits),
    "information-move": (_OppositeMove, _NoMove),
    "pool-without-root": (_PoolWithoutRoot,),
    "impossible-pool": (_ImpossibleKept,),
    "strategy-ignored": (_Fixation, _NoInformation),
}
"""By the name of the mistake."""
