"""Verdict on a program's output for each case: pass, the first difference with its likely cause, or a failure."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from ...models.errors import counted
from .answers import Answer, BadAnswerError, parse_answer
from .case import Case
from .catalogue import expected
from .comparison import Difference, first_difference
from .mistakes import MISTAKES
from .program import Ended
from .tolerance import Precision, needs_double, tolerances

_ABOUT = {mistake.name: mistake.about for mistake in MISTAKES}
type Status = Literal["pass", "differs", "failed", "left out"]


@dataclass(frozen=True, repr=False)
class Verdict:
    """Of one case.

    Attributes:
        case: Its name.
        status: What came of it.
        sentence: What is wrong, why it was left out, or what a program that passes left running.
        tap: The first tap with a difference, counted from 1; 0 is the fit and `None` no tap.
        quantity: What differs there.
        cause: Name of the likeliest mistake, see `causes`.
        digits: To which numbers are rounded, where that is the cause.
        answers: What was answered, where it differs.
        error: What a Python function raised.
        seconds: That it took, without the comparison; `None` where they are unknown, as of answers in files.
    """

    case: str
    status: Status
    sentence: str = ""
    tap: int | None = None
    quantity: str = ""
    cause: str = ""
    digits: str = ""
    answers: tuple[Answer, ...] = ()
    error: Exception | None = None
    seconds: float | None = field(default=None, compare=False)

    def __repr__(self) -> str:
        return f"<Verdict {self.case}: {described(self)}>"

    @property
    def found(self) -> Difference:
        """The first difference."""
        return Difference(self.tap or 0, self.quantity, self.sentence)

    @property
    def about(self) -> str:
        """The likely cause in words."""
        return _ABOUT.get(self.cause, "").format(digits=self.digits)


def left_out(case: Case, precision: Precision) -> Verdict | None:
    """Why a case is not asked of a program of this precision; `None` where it is."""
    reason = needs_double(case, expected(case)) if precision == "single" else ""
    return Verdict(case.name, "left out", f"32 bits cannot do it: {reason}") if reason else None


def judge_output(case: Case, ended: Ended, precision: Precision, without: Sequence[str] = ()) -> Verdict:
    """The verdict on what a program wrote.

    Args:
        case: The case.
        ended: What the program did.
        precision: Of its numbers.
        without: Quantities that it does not answer.
    """
    answers, broken = _read(case, ended.lines())
    verdict = judge_broken(case, answers, broken, precision, without, ended.failure)
    unanswered = verdict.status == "failed" or (verdict.sentence and not verdict.quantity)
    if ended.said and unanswered:
        verdict = replace(verdict, sentence=f"{verdict.sentence}; it said: {ended.said}")
    if not ended.left:
        return verdict
    return replace(verdict, sentence=f"{verdict.sentence}; it {ended.left}" if verdict.sentence else f"it {ended.left}")


def judge_broken(
    case: Case,
    answers: Sequence[Answer],
    broken: str,
    precision: Precision,
    without: Sequence[str] = (),
    failure: str = "",
) -> Verdict:
    """The verdict on answers up to the first that is none.

    Args:
        case: The case.
        answers: Those before it.
        broken: What is wrong with it, as the end of a sentence that begins with "it"; empty where all are answers.
        precision: Of the program's numbers.
        without: Quantities that are not answered.
        failure: How the program failed, likewise.
    """
    verdict = judge(case, answers, precision, without)
    if not (failure or broken):
        return verdict
    good = f" after {counted(len(answers), 'answer')}" if answers else ""
    also = f"; before that, {_place(verdict.tap)}{verdict.sentence}" if verdict.quantity and answers else ""
    no_number = not failure and "nan" in broken.lower()
    cause = "linear-likelihood" if no_number and _all_underflow(case, len(answers) + 1) else ""
    return replace(
        verdict, status="failed", sentence=f"it {failure or broken}{good}{also}", cause=cause or verdict.cause
    )


def _all_underflow(case: Case, tap: int) -> bool:
    """Whether plain products of probabilities are zero under every class at a tap, so that 0 / 0 follows."""
    plain = next(mistake for mistake in MISTAKES if mistake.name == "linear-likelihood").rules[0]
    return any(answer.error is not None for answer in plain(case, tap).answers())


def judge(case: Case, answers: Sequence[Answer], precision: Precision, without: Sequence[str] = ()) -> Verdict:
    """The verdict on answers."""
    right = expected(case)
    allowed = tolerances(case, right, precision)
    found = first_difference(case, right, answers, allowed, without) or _count_differs(case, right, answers)
    if found is None:
        return Verdict(case.name, "pass")
    return Verdict(case.name, "differs", found.sentence, found.tap, found.quantity, answers=tuple(answers))


def _read(case: Case, lines: Iterable[tuple[int, str]]) -> tuple[list[Answer], str]:
    """Answers in order, up to the first line that is none or the first answer too many, and what is wrong."""
    answers: list[Answer] = []
    first = 0 if case.training is not None else 1
    for number, line in lines:
        if len(answers) + first > len(case.taps) + 1:
            break
        try:
            answer = parse_answer(line, case)
        except BadAnswerError as error:
            return answers, f"writes line {number}, which {error}"
        if answer.tap != (due := first + len(answers)):
            return answers, misplaced(case, answer.tap, due, f" in line {number}")
        answers.append(answer)
    return answers, ""


def misplaced(case: Case, tap: int, due: int, place: str = "") -> str:
    """What is wrong with an answer to another tap than the one due, as the end of a sentence that begins with "it"."""
    if due > len(case.taps):
        return f"gives more answers than taps, another to tap {tap}{place}"
    return f"answers tap {tap}{place}, where tap {due} is due"


def _count_differs(case: Case, right: Sequence[Answer], answers: Sequence[Answer]) -> Difference | None:
    """Whether taps between those compared are missing, or answers follow the last one."""
    last = right[-1].tap if right[-1].error else len(case.taps)
    taps = [answer.tap for answer in answers if answer.tap > 0]
    if taps and taps[-1] > last:
        return Difference(taps[-1], "", "there is an answer where none is due")
    if not case.answered and len(taps) < last:
        return Difference(len(taps) + 1, "", "there is no answer")
    return None


def summary(verdicts: Sequence[Verdict]) -> tuple[list[str], bool]:
    """The last lines of a report, and whether all is well.

    Args:
        verdicts: With their causes, see `causes`.
    """
    counts = Counter(verdict.status for verdict in verdicts)
    asked = len(verdicts) - counts["left out"]
    lines = []
    for (cause, about), times in Counter((v.cause, v.about) for v in verdicts if v.cause).most_common():
        lines.append(f"Likely cause in {times} of {counts['differs'] + counts['failed']}: {about} ({cause}).")
    fine = asked > 0 and counts["pass"] == asked
    rest = [f"{n} {status if n == 1 else word}" for status, word in _WORDS.items() if (n := counts[status])]
    pass_ = "passes" if asked == 1 else "pass"
    lines.append(", ".join([f"{counts['pass']} of {counted(asked, 'case')} {pass_}", *rest]) + ".")
    return lines, fine


_WORDS: dict[Status, str] = {"differs": "differ", "failed": "failed", "left out": "left out"}


def _place(tap: int | None) -> str:
    if tap is None:
        return ""
    return "fit: " if tap == 0 else f"tap {tap}: "


def described(verdict: Verdict) -> str:
    """A verdict in a line, behind the name of its case."""
    if verdict.status == "pass":
        return f"pass, but {verdict.sentence}" if verdict.sentence else "pass"
    place = _place(verdict.tap) if verdict.status == "differs" else ""
    cause = f"; likely cause: {verdict.about}" if verdict.about else ""
    word = {"differs": "DIFFERS", "failed": "FAILED", "left out": "left out:"}[verdict.status]
    return f"{word} {place}{verdict.sentence}{cause}"
