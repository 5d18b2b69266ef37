"""Likely mistake of a program, from all cases in which its answers differ.

A mistake that explains one case may explain many; the likeliest cause of a case is the one that explains most.
One that would fail a case which the program passes is none.
That numbers are rounded is seen in their digits.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from functools import partial
from typing import Any

import numpy as np

from .answers import ARRAYS, OPTIONAL, Answer
from .case import Case
from .catalogue import expected
from .comparison import first_difference, is_later
from .exact import Exact
from .mistakes import MISTAKES, Mistake, explains
from .tolerance import Precision, Tolerance, tolerances
from .verdict import Verdict

_CHEAP = 20_000  # steps of a case for which every mistake is tried
_NUMBERS = ("edges", *ARRAYS, "log_evidence", "information")
_FORMS = ("significant digits", "decimals")
_FEWEST_DIGITS = 2  # one that fits is no evidence
_MOST_DIGITS = 15  # a double keeps them


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
    digits = _rounded(wrong, cases, precision)
    causes: dict[str, set[str]] = {}
    counts: Counter[str] = Counter()
    for verdict in wrong:
        ranked = sorted(MISTAKES, key=lambda mistake: -counts[mistake.name])
        every = _steps(cases[verdict.case], verdict) <= _CHEAP
        causes[verdict.case] = _causes(cases[verdict.case], verdict, ranked, every, precision, without, witnesses)
        if verdict.case in digits:
            causes[verdict.case].add("rounded")
        counts.update(causes[verdict.case])
        told(1)
    order = [mistake.name for mistake in MISTAKES]

    def likeliest(verdict: Verdict) -> str:
        names = causes.get(verdict.case, set())
        return min(names, key=lambda name: (-counts[name], order.index(name)), default=verdict.cause)

    chosen = [replace(verdict, cause=likeliest(verdict)) for verdict in verdicts]
    return [replace(v, digits=digits[v.case]) if v.cause == "rounded" else v for v in chosen]


def _rounded(wrong: Sequence[Verdict], cases: Mapping[str, Case], precision: Precision) -> dict[str, str]:
    """The digits to which numbers are rounded, by case, where that explains what is wrong.

    No number of the quantity has more; of several forms the one that explains most cases counts.
    """
    most = {name: digits for name in _NUMBERS if (digits := _most_digits(wrong, name))[0] <= _MOST_DIGITS}
    forms = {(form, n) for digits in most.values() for form, n in zip(_FORMS, digits, strict=True)}
    fits = {
        verdict.case: [
            (form, n)
            for form, n in forms
            if n >= max(most[verdict.quantity][_FORMS.index(form)], _FEWEST_DIGITS)
            and _rounds(cases[verdict.case], verdict, form, n, precision)
        ]
        for verdict in wrong
        if verdict.quantity in most
    }
    counts = Counter(form for found in fits.values() for form in found)
    likeliest = {case: max(found, key=lambda form: (counts[form], form)) for case, found in fits.items() if found}
    return {case: f"{n} {form}" for case, (form, n) in likeliest.items()}


def _most_digits(wrong: Sequence[Verdict], quantity: str) -> tuple[int, int]:
    """Most significant digits and decimals of a quantity, up to the first number with more than rounding leaves."""
    significant = decimals = 0
    told = (a for v in wrong if v.quantity == quantity for a in v.answers if a.tap <= v.found.tap)
    for number in (x for a in told for x in np.ravel(a.values.get(quantity, [])).tolist() if np.isfinite(x)):
        _, digits, exponent = Decimal(repr(number)).normalize().as_tuple()
        significant, decimals = max(significant, len(digits)), max(decimals, -int(exponent))
        if significant > _MOST_DIGITS:
            break
    return significant, decimals


def _rounds(case: Case, verdict: Verdict, form: str, n: int, precision: Precision) -> bool:
    """Whether the first wrong quantity is the right one, rounded to so many digits."""
    tap, quantity = verdict.found.tap, verdict.quantity
    right = np.asarray(_answer(expected(case), tap)[quantity])
    given = np.asarray(_answer(verdict.answers, tap).get(quantity, []))
    if given.shape != right.shape:
        return False
    with np.errstate(divide="ignore", invalid="ignore"):
        first = np.floor(np.log10(np.abs(given))) + 1 if form == _FORMS[0] else 0
        allowed = tolerances(case, expected(case), precision)[quantity]
        off = np.abs(given - right) - allowed.absolute - allowed.relative * np.abs(right)
    return bool(((given == right) | (off <= 0.5 * 10.0 ** (first - n))).all())


def _is_right(case: Case, verdict: Verdict, allowed: dict[str, Tolerance], without: Sequence[str]) -> bool:
    """Whether what differs from a file is what this version computes, so that mistakes without effect give it too."""
    own = [*Exact(case, max(verdict.found.tap, 1)).answers()]
    return is_later(first_difference(case, own, verdict.answers, allowed, without), verdict.found)


def _answer(answers: Sequence[Answer], tap: int) -> Mapping[str, Any]:
    """The values of the answer to a tap."""
    return next(answer.values for answer in answers if answer.tap == tap)


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
    if case.pinned is not None and _is_right(case, verdict, allowed, without):
        return found
    for mistake in ranked:
        refuted = partial(witnesses.refute, mistake, case.border)
        if explains(mistake, case, verdict.answers, verdict.found, allowed, without, refuted):
            found.add(mistake.name)
            if not every:
                break
    return found
