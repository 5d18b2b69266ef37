"""Strategies of moving and rules of stopping on simulated data sets and on recordings with a tap in every cell.

`--recorded FOLDER --document docs/explanation/strategies.md` updates its tables and figures. `--summary
strategies.json` uses the results of finished runs of `solidtouch strategies` instead of playing and updates the blocks
they cover.
"""

import argparse
import json
from collections.abc import Iterator, Sequence
from pathlib import Path

from solidtouch.analysis.experiment.settings import SHOWN_THETA
from solidtouch.analysis.page.numbers import factor_of, interval, number, percent
from solidtouch.analysis.page.page import Row
from solidtouch.analysis.page.report import TitleRecord
from solidtouch.analysis.strategies import figures as figure_strategies
from solidtouch.analysis.strategies.data import RIGHT, StrategyData, recorded_bench, simulated_bench
from solidtouch.analysis.strategies.figures_regret import regret
from solidtouch.analysis.strategies.figures_trust import trust
from solidtouch.analysis.strategies.findings import FIXED, PAPER, TAPS, better_finding, random_findings
from solidtouch.analysis.strategies.regret import RegretSettings, regret_study
from solidtouch.analysis.strategies.regret_summary import summarise_regret
from solidtouch.analysis.strategies.run import BASE, StrategySettings, strategy_study
from solidtouch.analysis.strategies.summary import summarise
from solidtouch.cli.shared.progress import bars
from solidtouch.models.settings import Division

from benchmarks.page import parsed, publish, table, write_block
from benchmarks.study import write_json

RECORDED = {"barrett_ballcyl.npz": (None, None), "eflesh_grid.npz": ("3mm", "3mm")}
"""Recordings with a tap in every cell, and the widths of their cells."""
PRESETS = ("ideal", "paper", "nodrift", "broken", "model")
SHOWN = "preset paper"
BLOCKS = ("strategies-findings", "strategies-shown", "strategies-equal", "strategies-rules", "strategies-trust")
REGRET = "regret"
_NAMES = {PAPER: "on average, by threshold", FIXED: "each"}


def told(sources: Sequence[Row]) -> str:
    """Units of the intervals and results of random moves, as a list."""
    units = [f"{source['name']}: {source['units']}" for source in sources]
    said = (*units, better_finding(sources), *random_findings(sources))
    return "\n".join(f"- {sentence}" for sentence in said)


def shown(source: Row) -> str:
    """Results of each strategy at the shown threshold of the paper's rule."""
    names = ("what_error", "where_error", "taps", "taps_difference", "way")
    first, lines = source["powers"][0], []
    paired = {row["strategy"]: row for row in first["shown"]}
    for strategy, points in first["curves"][PAPER].items():
        point = {**next(point for point in points if point["level"] == SHOWN_THETA), **paired[strategy]}
        shares = [percent(point[share]) for share in ("given_up", "unstopped")]
        lines.append([strategy, *(interval(point, name) for name in names), *shares])
    head = ["strategy", f"object error ({source['what_unit']})", f"position error ({source['where_unit']})", "taps"]
    head += ["difference from fixation", f"travel ({source['where_unit']})", "null decisions", "at the deadline"]
    return table(head, lines)


def equal(sources: Sequence[Row]) -> str:
    """Object errors minus those of the fixation point at equal taps, one table for each number of taps and rule."""
    parts = []
    for family in (PAPER, FIXED):
        for taps in TAPS:
            rows = {
                source["name"]: {
                    row["strategy"]: row for row in source["powers"][0]["equal"][family] if row["taps"] == taps
                }
                for source in sources
            }
            strategies = dict.fromkeys(name for one in rows.values() for name in one)
            lines = [[name, *(_difference(one.get(name)) for one in rows.values())] for name in strategies]
            head = [f"{taps} taps {_NAMES[family]}", *(f"{one['name']} ({one['what_unit']})" for one in sources)]
            lines = [line for line in lines if line[0] != BASE]
            nothing = [_null(one.get(BASE)) for one in rows.values()]
            parts.append(table(head, [*lines, ["null decisions, all", *nothing]]))
    return "\n\n".join(parts)


def _difference(row: Row | None) -> str:
    """A difference with its interval, in bold where all intervals together exclude zero."""
    if row is None or row["what_error_difference"] is None:
        return "-"
    text = interval(row, "what_error_difference")
    low, high = row["what_error_difference_least"], row["what_error_difference_most"]
    return f"**{text}**" if low is not None and high is not None and (low > 0 or high < 0) else text


def _null(row: Row | None) -> str:
    return "-" if row is None else percent(row["given_up"])


def rules(source: Row) -> str:
    """Every stopping rule with the fixation point."""
    lines = [
        [
            row["rule"],
            str(row["taps"]),
            interval(row, "what_error"),
            interval(row, "what_error_difference"),
            percent(row["given_up"]),
        ]
        for row in source["powers"][0]["rules"]
        if row["what_error"] is not None
    ]
    unit = source["what_unit"]
    head = [f"rule, {source['name']}", "mean taps", f"object error of the answers ({unit})"]
    return table([*head, f"− that of the paper's rule ({unit})", "null decisions"], lines)


def trusted(sources: Sequence[Row]) -> str:
    """Miscalibration, gain, and expected and gained information, for every exponent of the likelihood."""
    factors, names = ("factor", "factor_ratio"), ("gain", "expected", "told", "excess_difference")
    lines = [
        [
            source["name"],
            f"{power['power']} ({number(power['exponent'], 2)})",
            row["strategy"],
            *(factor_of(row, name) for name in factors),
            *(interval(row, name) for name in names),
            percent(row["given_up"]),
        ]
        for source in sources
        for power in source["powers"]
        for row in power["trust"]
        if row["strategy"] in (BASE, "random", "info-what", "info-joint")
    ]
    head = [
        "data",
        "power (exponent)",
        "strategy",
        "miscalibration",
        "ratio to fixation",
        "P(wrong): fixation − strategy",
    ]
    return table(
        [*head, "expected (nats)", "gained (nats)", "difference of expected − gained from fixation", "null decisions"],
        lines,
    )


def benches(data_sets: int, seed: int, folder: Path | None) -> Iterator[StrategyData]:
    """The presets and those of the recordings that are there."""
    for name in PRESETS:
        yield simulated_bench(name, data_sets, seed)
    for name, cells in RECORDED.items():
        if folder is not None and (folder / name).is_file():
            yield recorded_bench(folder / name, Division(where_cell=cells[0], what_cell=cells[1]))


def regrets(summary: Row) -> str:
    """What strategies cost more than need be: how it is told, and a table for each case and cost of taps."""
    return "\n\n".join([" ".join(summary["rules"]), *(_prices(case, summary["kinds"]) for case in summary["cases"])])


def _prices(case: Row, kinds: Sequence[str]) -> str:
    """A case in a sentence, and its table; the cheapest is bold."""
    lines = []
    for name in case["strategies"]:
        own = [price for price in case["prices"] if price["strategy"] == name]
        lines.append([name, *(f"**{price['shown']}**" if price["best"] else price["shown"] for price in own)])
    return f"*{case['described']}.* {case['said']} {case['caption']}:\n\n{table(['strategy', *kinds], lines)}"


def played(options: argparse.Namespace) -> Row:
    """The summary of a comparison that is made now."""
    settings = StrategySettings(trials=options.trials, seed=options.seed)
    lost = RegretSettings(seed=options.seed)
    with bars() as progress:
        found = [
            strategy_study(b, settings, progress) for b in benches(options.data_sets, options.seed, options.recorded)
        ]
        above = summarise_regret(regret_study(lost, progress), lost)
    made_by: TitleRecord = {"title": "Strategies", "command": "benchmarks/studies/strategies/comparison.py"}
    return summarise(found, settings, made_by, above)


def compared(sources: Sequence[Row]) -> dict[str, str]:
    """What stands in the page of the data that were compared, by block."""
    paper = _shown_source(sources)
    right = [source for source in sources if source["name"] == f"preset {RIGHT}"]
    by_rule = "\n\n".join(rules(source) for source in (paper, *right))
    texts = (told(sources), shown(paper), equal(sources), by_rule, trusted(sources))
    return dict(zip(BLOCKS, texts, strict=True))


def publish_figures(sources: Sequence[Row], document: Path) -> None:
    """The figures of the data that were compared."""
    paper = _shown_source(sources)
    for name in ("curves", "equal_taps", "stopping", "trajectories"):
        publish(getattr(figure_strategies, name)(paper), document, f"strategies-{name.replace('_', '-')}")
    publish(trust([source for source in sources if source["simulated"]] or sources), document, "strategies-trust")


def _shown_source(sources: Sequence[Row]) -> Row:
    return next((source for source in sources if source["name"] == SHOWN), sources[0])


def main() -> None:
    """Runs the study as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data-sets", type=int, default=10, help="data sets per preset")
    parser.add_argument("--trials", type=int, default=100, help="trials per class")
    parser.add_argument("--seed", type=int, default=0, help="random seed")
    parser.add_argument("--recorded", type=Path, help="folder of recordings")
    parser.add_argument("--summary", type=Path, nargs="+", help="strategies.json of finished runs")
    options = parsed(parser, *BLOCKS, REGRET)
    if options.summary:
        summaries = [json.loads(path.read_text("utf-8")) for path in options.summary]
    else:
        summaries = [played(options)]
        write_json("strategies", summaries[0])
    sources = [source for one in summaries for source in one["sources"]]
    lost = next((one["regret"] for one in summaries if one.get("regret")), None)
    texts = (compared(sources) if sources else {}) | ({REGRET: regrets(lost)} if lost else {})
    for name, text in texts.items():
        print(text, end="\n\n")
        write_block(options.document, name, text)
    if options.document is not None and sources:
        publish_figures(sources, options.document)
    if options.document is not None and lost:
        publish(regret(lost), options.document, "strategies-regret")


if __name__ == "__main__":
    main()
