"""Pages of cross-checks and calibrations."""

from collections.abc import Iterator, Mapping, Sequence

from ...models.measurement.registry import PAPER
from ...models.splits import Split
from ..experiment.crosscheck import NEAR_TIE, CrossCheck
from ..page.numbers import crosscheck_table
from ..page.page import Brief, Cautions, Page, Section, Table
from ..stats.uniformity import PRECISION, Factor
from .sbc import Calibration


def crosscheck_page(found: Mapping[str, CrossCheck], refused: Mapping[str, str], split: Split) -> Page:
    """The comparisons as tables, and a verdict."""
    intro = [Brief(split.description), Brief(Cautions([split.warning] if split.warning else []))]
    if [*found] == [PAPER] and not refused:
        return Page("Cross-check", [*intro, *_blocks(found[PAPER])], [])
    sections = [Section(f"Model {name}", [*_blocks(check)]) for name, check in found.items()]
    if len(found) + len(refused) > 1:
        sections.append(Section("", [*map(Brief, _summary(found, refused))]))
    return Page("Cross-check", intro, sections)


def _blocks(check: CrossCheck) -> Iterator[Brief]:
    """The comparison of one model."""
    yield Brief(crosscheck_table(check))
    yield Brief(
        f"{check.episodes} episodes of {check.taps} taps, the first {check.sequence_taps} also enumerated as whole "
        f"sequences: {check.differing_decisions} decisions and {check.differing_moves} moves differ, "
        f"{check.near_ties} near-ties within {NEAR_TIE:g}."
    )
    yield from map(Brief, check.notes)
    yield Brief("All routes agree." if check.passed else "The routes DISAGREE.")


def _summary(found: Mapping[str, CrossCheck], refused: Mapping[str, str]) -> Iterator[str]:
    """Which models were not checked, and whether the routes agree for the others."""
    for name, reason in refused.items():
        yield f"Model {name} was not checked: {reason}"
    differ = [name for name, check in found.items() if not check.passed]
    verdict = f"the routes of {', '.join(differ)} DISAGREE" if differ else "all routes agree"
    yield f"{len(found)} of {len(found) + len(refused)} models checked: {verdict}."


def calibration_page(result: Calibration) -> Page:
    """A row for each route and policy, the tests that fail, and a verdict."""
    head = ["route", "policy", "trials", "wrong / (1 − belief)", "at", "tests", "least p x tests", ""]
    failed, rows = result.failed, []
    for route, policy in dict.fromkeys((row.route, row.policy) for row in result.rows):
        part = result.part(route=route, policy=policy)
        fails = sum(row.route == route and row.policy == policy for row, _ in failed)
        last = [row for row in part.rows if row.quantity == "what"][-1]
        numbers = str(last.n), told_factor(last.factor), last.moment, str(part.tests), told_p(part.least)
        rows.append([route, policy, *numbers, f"{fails} FAIL" if fails else "ok"])
    return Page("Calibration", [Brief(Table(head, rows, words={1, 4, 7})), *map(Brief, sentences(result))], [])


def told_factor(factor: Factor) -> str:
    """A factor with its interval."""
    return f"{factor.value:.2f} [{factor.low:.2f}, {factor.high:.2f}]"


def told_p(p: float, equal: str = "") -> str:
    """A p-value down to where rounding begins to matter."""
    return f"{equal}{p:.2g}" if p >= PRECISION else f"< {PRECISION:g}"


def sentences(result: Calibration) -> Sequence[str]:
    """The verdict, and the tests that fail, smallest p first."""
    failed = sorted(result.failed, key=lambda pair: pair[0].p[pair[1]])
    shown = [
        f"{row.route}, {row.policy}, {row.moment}: {test} of {row.quantity}, p {told_p(row.p[test], '= ')}."
        for row, test in failed[:5]
    ]
    verdict = "Beliefs are calibrated" if not failed else "Beliefs are NOT calibrated"
    return [*shown, f"{verdict}: {len(failed)} of {result.tests} tests fail (level {result.level:g} for all together)."]
