"""Runs all cases through the engines of this software, a program or a Python function."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from functools import cache
from itertools import islice
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

from ...inference.reference import ZeroEvidenceError
from ...models.errors import InputError
from . import routes
from .answers import ZERO_EVIDENCE, Answer, BadAnswerError, given_answer
from .case import Case
from .catalogue import expected
from .program import Ended, check_command, printable, read_answers, run_program
from .tolerance import Precision, tolerances
from .trials import trial_difference
from .verdict import Verdict, judge, judge_broken, judge_output, left_out, misplaced

_CASE = re.compile(rb'"case"[ \t]*:[ \t]*"[^"\n]*"')

type Implementation = Callable[[Case], Iterable[Mapping[str, Any]]]
"""An implementation under test: gives the answers to the taps of a case, one after the other."""


class Asked(NamedTuple):
    """What is asked of a foreign program.

    Attributes:
        precision: Of its numbers.
        without: Quantities that it does not answer.
        timeout: Seconds that it has for a case.
        causes: Whether likely causes are looked for.
    """

    precision: Precision = "double"
    without: tuple[str, ...] = ()
    timeout: float = 10.0
    causes: bool = True


def run_route(route: str, cases: Sequence[Case]) -> Iterator[Verdict]:
    """The verdicts on an engine of this software, one of `engines.ROUTES`."""
    return (_own(route, case) for case in cases)


def _own(route: str, case: Case) -> Verdict:
    begin = perf_counter()
    try:
        answers = list(routes.answers(route, case))
    except InputError as error:
        return Verdict(case.name, "left out", str(error))
    seconds = perf_counter() - begin
    verdict = replace(judge(case, answers, "double"), seconds=seconds)
    if verdict.status != "pass" or route != "montecarlo":
        return verdict
    right = expected(case)
    found = trial_difference(case, right, tolerances(case, right, "double"))
    if found is None:
        return verdict
    return Verdict(case.name, "differs", found.sentence, found.tap, found.quantity, seconds=seconds)


def check_program(words: list[str], cases: Sequence[Case], asked: Asked, together: bool = False) -> Iterator[Verdict]:
    """The verdicts on a foreign program.

    Args:
        words: The program and its arguments.
        cases: Which ones.
        asked: How it is judged.
        together: Whether it is started once for all cases, in place of once for each.

    Raises:
        InputError: There is no such program.
    """
    check_command(words)
    if together:
        return _together(words, cases, asked)
    return _each(cases, asked, lambda case: run_program(words, case.lines(), asked.timeout), timed=True)


def _together(words: list[str], cases: Sequence[Case], asked: Asked) -> Iterator[Verdict]:
    due = [case for case in cases if left_out(case, asked.precision) is None]
    lines = (line for case in due for line in case.lines())
    ended = run_program(words, lines, asked.timeout * max(1, len(due)))
    parts = _by_case(ended, due)
    yield from _each(cases, asked, lambda case: parts[case.name])


def check_function(implementation: Implementation, cases: Sequence[Case], asked: Asked) -> Iterator[Verdict]:
    """The verdicts on a Python function."""
    return (left_out(case, asked.precision) or _called(implementation, case, asked) for case in cases)


def _called(implementation: Implementation, case: Case, asked: Asked) -> Verdict:
    """The verdict on a Python function in one case; it is given a copy, which it may change."""
    answers: list[Answer] = []
    broken, raised = "", None
    first = 0 if case.training is not None else 1
    due = len(case.taps) + 1 - first
    begin = perf_counter()
    try:
        made = implementation(deepcopy(case))
        if isinstance(made, Iterable):
            for given in islice(made, due + 1):
                tap = first + len(answers)
                answers.append(given_answer(given, case, tap))
                if answers[-1].tap != tap:
                    answer = answers.pop()
                    broken = misplaced(case, answer.tap, tap)
                    break
        else:
            broken = f"returns {type(made).__name__}, where an answer to each tap is due"
    except ZeroEvidenceError:
        answers.append(Answer(first + len(answers), error=ZERO_EVIDENCE))
    except BadAnswerError as error:
        broken = f"gives an answer to tap {first + len(answers)} that {error}"
    except Exception as error:
        broken, raised = f"raises {printable(repr(error)[:200])}", error
    seconds = perf_counter() - begin
    return replace(judge_broken(case, answers, broken, asked.precision, asked.without), error=raised, seconds=seconds)


def check_answers(folder: Path, cases: Sequence[Case], asked: Asked) -> Iterator[Verdict]:
    """The verdicts on answers that are files already, `NAME.jsonl` for each case."""
    return _each(cases, asked, lambda case: read_answers(folder, case.name))


def _each(
    cases: Sequence[Case], asked: Asked, output: Callable[[Case], Ended], timed: bool = False
) -> Iterator[Verdict]:
    """The verdicts on the outputs, with the seconds that each took where the program is run for it alone."""
    for case in cases:
        if (verdict := left_out(case, asked.precision)) is None:
            begin = perf_counter()
            ended = output(case)
            seconds = perf_counter() - begin if timed else None
            verdict = replace(judge_output(case, ended, asked.precision, asked.without), seconds=seconds)
        yield verdict


def _by_case(ended: Ended, cases: Sequence[Case]) -> dict[str, Ended]:
    """The output of a program cut into that of each case; what failed, failed in the last one that it began."""
    parts = {case.name: bytearray() for case in cases}
    current = cases[0].name if cases else ""
    begin, line, whole = 0, 0, memoryview(ended.output)
    while named := _other_name(current, *parts).search(ended.output, line):
        start = ended.output.rfind(b"\n", 0, named.start()) + 1
        line = ended.output.find(b"\n", named.end()) + 1 or len(ended.output)
        if _CASE.search(ended.output, start, named.start()) is None:
            parts[current] += whole[begin:start]
            begin, current = start, named[1].decode()
    if parts:
        parts[current] += whole[begin:]
    order = list(parts)
    after = order.index(current) if current else 0
    if ended.late and after + 1 < len(cases) and _complete(cases[after], parts[current]):
        after += 1
    return {
        name: Ended(
            part,
            ended.failure if order.index(name) >= after else "",
            left=ended.left if name == order[-1] else "",
            said=ended.said,
        )
        for name, part in parts.items()
    }


@cache
def _other_name(current: str, *names: str) -> re.Pattern[bytes]:
    """A pattern of the name of another case than the current one."""
    others = "|".join(re.escape(name) for name in names if name != current)
    return re.compile(rb'"case"[ \t]*:[ \t]*"(' + (others or "(?!)").encode() + rb')"')


def _complete(case: Case, output: bytearray) -> bool:
    """Whether a program has written all that is due, so that it is stuck in a later case."""
    due = len(case.taps) + (case.training is not None)
    lines = [line for _, line in islice(Ended(output, "").lines(), due)]
    return len(lines) >= due or (bool(lines) and '"error"' in lines[-1])
