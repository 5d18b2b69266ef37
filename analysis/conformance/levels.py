"""Levels of the kit: what a program can claim to do, and which levels a check has found to pass."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from .case import LEVELS, Case
from .verdict import Verdict


class LevelResult(NamedTuple):
    """What a program did in the cases of a level.

    Attributes:
        level: Its name.
        cases: Number of cases of the kit that belong to it.
        passed: How many of them pass.
        differs: How many have a wrong answer.
        failed: How many have none, as the program failed.
        left_out: How many were not compared, as the precision or the program cannot do them.
        not_asked: How many were not chosen.
    """

    level: str
    cases: int
    passed: int
    differs: int
    failed: int
    left_out: int
    not_asked: int

    @property
    def passes(self) -> bool:
        """Whether the program passes the level: all of its cases were chosen, and none differs or failed."""
        return self.passed > 0 and not (self.differs or self.failed or self.not_asked)


def level_results(
    sizes: Mapping[str, int], cases: Mapping[str, Case], found: Mapping[str, Verdict]
) -> dict[str, LevelResult]:
    """The results in each level of which a case was asked, from simple to demanding.

    Args:
        sizes: Number of cases of the kit by level.
        cases: By name.
        found: The verdicts by case.
    """
    asked = {cases[name].level for name in found}
    return {level: _result(level, sizes[level], cases, found) for level in LEVELS if level in asked}


def _result(level: str, size: int, cases: Mapping[str, Case], found: Mapping[str, Verdict]) -> LevelResult:
    counts = Counter(verdict.status for name, verdict in found.items() if cases[name].level == level)
    return LevelResult(
        level, size, counts["pass"], counts["differs"], counts["failed"], counts["left out"], size - counts.total()
    )


def level_sentence(kit: str, results: Sequence[LevelResult], precision: str, without: Sequence[str]) -> str:
    """What a program may claim, in one line.

    Args:
        kit: Version of the kit.
        results: Of each level.
        precision: Of the program's numbers.
        without: Quantities that were not compared.
    """
    passed = [_with_left_out(result) for result in results if result.passes]
    parts = [f"passes {', '.join(passed)}"] if passed else []
    parts += [f"{result.level}: {_shortfall(result)}" for result in results if not result.passes]
    conditions = (f", {precision} precision" if precision != "double" else "") + "".join(f", no {n}" for n in without)
    return f"Conformance kit {kit}{conditions}: {'; '.join(parts) or 'no case'}."


def _with_left_out(result: LevelResult) -> str:
    return f"{result.level} ({result.left_out} left out)" if result.left_out else result.level


def _shortfall(result: LevelResult) -> str:
    """Why a level does not pass."""
    compared = result.cases - result.not_asked - result.left_out
    differ = "differs" if result.differs == 1 else "differ"
    wrong = [f"{n} of {compared} {word}" for n, word in ((result.differs, differ), (result.failed, "failed")) if n]
    if result.not_asked:
        wrong.append(f"{result.not_asked} of {result.cases} not asked")
    return ", ".join(wrong) or "left out"
