"""Likely mistake of a program, from all cases in which its answers differ.

A mistake that explains one case may explain many; the likeliest cause of a case is the one that explains most.
One that would fail a case which the program passes is none.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

from .answers import OPTIONAL
from .case import Case
from .catalogue import expected
from .comparison import first_difference
from .exact import Exact
from .mistakes import MISTAKES, Mistake, explains
from .tolerance import Precision, tolerances
from .verdict import Verdict

_CHEAP = 20_000  # steps of a case for which every mistake is tried


def with_causes(
    verdicts: Sequence[Verdict],
    cases: Mapping[str, Case],
    precision: Precision,
    without: Sequence[str] = (),
    told: Callable[[int], None] = lambda _: None,
) -> list[Verdict]:
    """The same verdicts with the likeliest cause of each.

    In large cases those mistakes are tried first that explain small ones, and no other if one does.

    Args:
        verdicts: Of one program.
        cases: By name.
        precision: Of its numbers.
        without: Quantities that are not compared.
        told: Called with each verdict.
    """
    wrong = sorted((v for v in verdicts if v.quantity), key=lambda v: _steps(cases[v.case], v))
    passed = [cases[v.case] for v in verdicts if v.status == "pass"]
    told_of = {name for v in verdicts for answer in v.answers for name in answer.values}
    silent = (*without, *(name for name in OPTIONAL if name not in told_of))
    witnesses = _Witnesses([case for case in passed if _size(case, len(case.taps)) <= _CHEAP], precision, silent)
    causes: dict[str, set[str]] = {}
    counts: Counter[str] = Counter()
    for verdict in wrong:
        ranked = sorted(MISTAKES, key=lambda mistake: -counts[mistake.name])
        every = _steps(cases[verdict.case], verdict) <= _CHEAP
        causes[verdict.case] = _causes(cases[verdict.case], verdict, ranked, every, precision, without, witnesses)
        counts.update(causes[verdict.case])
        told(1)
    order = [mistake.name for mistake in MISTAKES]

    def likeliest(verdict: Verdict) -> str:
        names = causes.get(verdict.case, set())
        return min(names, key=lambda name: (-counts[name], order.index(name)), default=verdict.cause)

    return [replace(verdict, cause=likeliest(verdict)) for verdict in verdicts]


def _steps(case: Case, verdict: Verdict) -> int:
    """About how many multiplications lead to the tap that is wrong."""
    return _size(case, max(verdict.tap or 1, 1))


def _size(case: Case, taps: int) -> int:
    L, M, K, J, _ = case.sizes.values()
    return L * M * (J * K + 10) * taps


class _Witnesses:
    """Cases that a program passes; a mistake with which it could not pass one is not what it makes.

    Only those with the same border count, as a program may get one border wrong and no other.
    """

    def __init__(self, cases: Sequence[Case], precision: Precision, silent: Sequence[str]) -> None:
        """Keeps the cases, and the quantities that the program did not answer."""
        self._cases = cases
        self._precision: Precision = precision
        self._silent = silent
        self._known: dict[tuple[type[Exact], str], bool] = {}

    def refute(self, mistake: Mistake, border: str, rules: type[Exact]) -> bool:
        """Whether some case says no to a form of a mistake."""
        if (rules, border) not in self._known:
            of_border = (case for case in self._cases if case.border == border and mistake.shows(case))
            self._known[rules, border] = any(self._fails(rules, case) for case in of_border)
        return self._known[rules, border]

    def _fails(self, rules: type[Exact], case: Case) -> bool:
        right = expected(case)
        allowed = tolerances(case, right, self._precision)
        wrong = [answer.without(self._silent) for answer in rules(case).answers()]
        return first_difference(case, right, wrong, allowed, self._silent) is not None


def _causes(
    case: Case,
    verdict: Verdict,
    ranked: Sequence[Mistake],
    every: bool,
    precision: Precision,
    without: Sequence[str],
    witnesses: _Witnesses,
) -> set[str]:
    allowed = tolerances(case, expected(case), precision)
    found: set[str] = set()

    for mistake in ranked:
        refuted = partial(witnesses.refute, mistake, case.border)
        if explains(mistake, case, verdict.answers, verdict.found, allowed, without, refuted):
            found.add(mistake.name)
            if not every:
                break
    return found
