"""Page of a comparison of strategies."""

from collections.abc import Iterator
from functools import partial

from ..page.numbers import factor_of, in_brackets, interval, number, percent
from ..page.page import Block, Brief, Listing, Note, Page, Picture, Row, Section, Table, Terms, Verbatim
from . import figures
from .figures_regret import regret
from .figures_trust import trust
from .findings import FIXED, PAPER

_EQUAL = {
    PAPER: "At equal mean numbers of taps, with a threshold on the belief in an object",
    FIXED: "After the same number of taps in every trial",
}
_COMPARED = ("what_error", "where_error", "way")


def strategies_page(summary: Row) -> Page:
    """The page: findings, a section for each kind of data, overconfidence, regret and method."""
    sections = [
        Section(source["name"], [*_source(i, source, summary["theta"])], f"source-{i}")
        for i, source in enumerate(summary["sources"], 1)
    ]
    if summary["sources"]:
        sections.append(Section("Overconfident models", [*_trust(summary)], "trust-section"))
    if summary["regret"]:
        sections.append(Section("Regret", [*_regret(summary["regret"])], "regret-section"))
    sections.append(Section("Method and provenance", [*_rules(summary)], "rules", folded=True))
    first, *others = summary["findings"]
    more = Section("Findings on other data, overconfidence and regret", [*map(Brief, others)], folded=True)
    return Page(summary["title"], [Brief(Note([f"**{first}**"])), more], sections)


def _source(i: int, source: Row, theta: float) -> Iterator[Block]:
    """One kind of data; the number of its figures counts from 1."""
    first, name = source["powers"][0], source["name"]
    error = f"object error ({source['what_unit']})"
    unit = in_brackets(source["where_unit"])
    yield Brief(Listing(source["findings"]))
    yield Picture(
        f"curves-{i}",
        f"Error against taps and travel: {name}",
        "Object and position errors along the belief thresholds of the paper, against the mean number of taps and the "
        "mean travel of the sensor (linear up to its first number), each group of strategies beside the fixation "
        "point. Right of each panel stand the last points with their 95% intervals, in the order of the key; an "
        "arrowhead is where one is cut.",
        partial(figures.curves, source),
        curves=True,
    )
    yield (
        f"{source['grid']['L']} positions and {source['grid']['M']} objects, power {first['power']}, border "
        f"{source['border']}. {source['units']}" + " **These data are simulated.**" * source["simulated"]
    )
    less = "− fixation"
    heads = ["strategy", "taps", error, less, f"position error{unit}", less, f"travel{unit}", less, "null decisions"]
    tables = {}
    for family, caption in _EQUAL.items():
        rows = [
            [
                row["strategy"],
                str(row["taps"]),
                *(
                    interval(row, f"{q}{end}")
                    for q in ("what_error", "where_error", "way")
                    for end in ("", "_difference")
                ),
                percent(row["given_up"]),
            ]
            for row in first["equal"][family]
        ]
        tables[family] = Table(heads, rows, caption, dense=True)
    yield Section("After equal numbers of taps", [Brief(tables[FIXED], columns=(0, 1, 2, 3))], folded=True)
    equal = Picture(
        f"equal-taps-{i}",
        f"Strategies at equal taps: {name}",
        "Paired difference of the object error from that of the fixation point, at equal mean numbers of taps. Thick "
        "lines are individual 95% intervals, thin lines simultaneous ones; hollow points have no interval. Arrowheads "
        "mark clipped intervals.",
        partial(figures.equal_taps, source),
    )
    yield Section("At equal mean numbers of taps", [equal, tables[PAPER]], folded=True)
    yield Section(f"At threshold {number(theta)}", [_at_threshold(source, theta, error, unit)], folded=True)
    yield Section("Stopping rules", [*_stopping(i, source)], folded=True)
    trajectories = Picture(
        f"trajectories-{i}",
        f"Trajectories: {name}",
        f"Position against taps in {len(next(iter(source['paths'].values())))} trials of one data set up to their "
        f"decision at threshold {theta:g}, from the same starts. Lines at the same position are offset by up to a "
        "quarter of a class, and dots mark decisions; strokes at the left are trials decided at tap 1; grey: fraction "
        "of trials that make a tap; dashed: the fixation point.",
        partial(figures.trajectories, source),
        curves=True,
    )
    yield Section("Trajectories", [trajectories], folded=True)


def _stopping(i: int, source: Row) -> Iterator[Block]:
    yield Picture(
        f"stopping-{i}",
        f"Stopping rules: {source['name']}",
        "Object error of trials with a decision along the levels of each rule (colour) and of the paper's rule "
        "(grey), with the fixation point; last panel: fraction of null decisions. The last points are repeated on the "
        "right with their 95% intervals; arrowheads mark clipped intervals.",
        partial(figures.stopping, source),
        curves=True,
    )
    yield Table(
        ["rule", "taps", f"object error of decisions ({source['what_unit']})", "− paper's rule", "null decisions"],
        [
            [
                row["rule"],
                str(row["taps"]),
                interval(row, "what_error"),
                interval(row, "what_error_difference"),
                percent(row["given_up"]),
            ]
            for row in source["powers"][0]["rules"]
        ],
        "Stopping rules with the fixation point, at equal mean numbers of taps",
        dense=True,
    )


def _at_threshold(source: Row, theta: float, error: str, unit: str) -> Table:
    first = source["powers"][0]
    paired = {row["strategy"]: row for row in first["shown"]}
    heads = ["strategy", error, f"position error{unit}", "taps", "− fixation", f"travel{unit}", "− fixation"]
    rows = [
        [
            name,
            *(interval(row, key) for key in ("what_error", "where_error", "taps")),
            interval(paired[name], "taps_difference"),
            interval(row, "way"),
            interval(paired[name], "way_difference"),
            interval(row, "wrong"),
            percent(row["given_up"]),
            percent(row["unstopped"]),
        ]
        for name in source["strategies"]
        for row in first["curves"][PAPER][name]
        if row["level"] == theta
    ]
    return Table(
        [*heads, "P(wrong object)", "null decisions", "stopped by the deadline"],
        rows,
        f"At threshold {number(theta)} on the belief in an object",
        dense=True,
    )


def _trust(summary: Row) -> Iterator[Block]:
    yield Picture(
        "trust",
        "Effect of overconfidence",
        f"After {summary['look']} taps. A: difference of P(wrong object) between the fixation point and info-what, "
        "against the miscalibration of the fixation point. B: miscalibration of both. C: expected minus gained "
        "information about the object, for both. Dashed: equality. Lines are 95% intervals, clipped at arrowheads; "
        "hollow points lie beyond the axis; undefined values are counted.",
        partial(trust, summary["sources"]),
    )
    heads = ["data", "power", "exponent", "strategy", "miscalibration", "ratio to fixation"]
    heads += ["P(wrong): fixation − strategy", "expected (nats)", "gained (nats)", "expected − gained"]
    rows = [
        [
            source["name"],
            str(power["power"]),
            number(power["exponent"]),
            row["strategy"],
            *(factor_of(row, name) for name in ("factor", "factor_ratio")),
            *(interval(row, name) for name in ("gain", "expected", "told", "excess", "excess_difference")),
            percent(row["given_up"]),
        ]
        for source in summary["sources"]
        for power in source["powers"]
        for row in power["trust"]
    ]
    yield Table(
        [*heads, "difference from fixation", "null decisions"],
        rows,
        f"After {summary['look']} taps, for each exponent of the likelihood",
        words={1, 3},
        dense=True,
    )


def _regret(found: Row) -> Iterator[Block]:
    yield (
        "Cost of the strategies above the minimum, in small cases for which the exact rule can be computed and in a "
        "larger case for which a lower bound is known."
    )
    yield from found["rules"]
    yield Picture(
        "regret",
        "Cost above the minimum",
        "Cost of each strategy above that of the exact rule (last column: above a lower bound), for four kinds of "
        "stopping rules, with 95% intervals. Of the fixation points, the best and the worst with the best threshold "
        "are shown. Logarithmic axis; values below its left end are drawn there.",
        partial(regret, found),
    )
    yield Section("Costs in each case", [*_cases(found)], folded=True)


def _cases(found: Row) -> Iterator[Block]:
    for case in found["cases"]:
        prices = {
            name: [
                f"**{price['shown']}**" if price["best"] else price["shown"]
                for price in case["prices"]
                if price["strategy"] == name
            ]
            for name in case["strategies"]
        }
        table = Table(
            ["strategy", *found["kinds"]],
            [[name, *shown] for name, shown in prices.items()],
            case["caption"],
            dense=True,
        )
        title = f"{case['name']}, {number(case['tap_cost'])} mm per tap"
        yield Section(title, [f"{case['described']}. {case['said']}", table])


def _rules(summary: Row) -> Iterator[Block]:
    yield (
        "The paper moves to a fixation point and stops at a belief threshold. This study compares it with other "
        "control strategies and stopping rules on the same trials and taps. A negative difference is a lower error "
        "than with the paper's fixation point."
    )
    yield Verbatim(summary["command"])
    terms = [Terms(summary["strategy_words"]), Terms(summary["rule_words"])]
    yield Section("Strategies and stopping rules", terms, folded=True)
    if summary["sources"]:
        yield from summary["rules"]
        yield f"{summary['trials']} trials of each data set, strategy and exponent."
    versions = ", ".join(f"{name} {version}" for name, version in summary["versions"].items())
    yield f"Seed {summary['seed']}. {versions}."
