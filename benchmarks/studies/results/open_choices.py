"""Effect of each open choice of the paper on simulated data sets and on recordings.

`--document docs/explanation/open-choices.md --recorded FOLDER` updates its tables and figures; without recordings their
table is left unchanged. `--from runs/studies/open-choices.json` rewrites text, tables and figures from earlier
measurements.
"""

import argparse
import json
from collections.abc import Iterator, Sequence
from pathlib import Path

from solidtouch.analysis.experiment.sources import Source, recorded_source, simulated_source
from solidtouch.analysis.page.numbers import interval, percent
from solidtouch.analysis.page.page import Row
from solidtouch.analysis.sensitivity.figures import forest, interactions
from solidtouch.analysis.sensitivity.findings import VERDICTS, WORDS, worded
from solidtouch.analysis.sensitivity.run import SensitivitySettings, sensitivity_study
from solidtouch.analysis.sensitivity.summary import summarise
from solidtouch.cli.shared.progress import bars
from solidtouch.models.settings import Division

from benchmarks.page import parsed, publish, table, write_block
from benchmarks.study import RECORDED, write_json

BLOCKS = ("open-choices-findings", "open-choices", "open-choices-pairs", "open-choices-rules")
RECORDED_BLOCK = "open-choices-recorded"
_SHORT = {"conclusion": "conclusion", "numbers": "numbers", "not decided": "?", "nothing": "nothing"}


def findings(source: Row) -> str:
    """What came out first, as a list, and what the defaults give."""
    lines = [[row["policy"], *(interval(row, name) for name in WORDS)] for row in source["default"]]
    advantage = [interval(source["advantage"][name], "value") for name in source["advantage"]]
    lines.append(["passive minus active", *advantage, ""])
    units = (source["what_unit"], source["where_unit"])
    head = ["defaults", *(f"{word} ({unit})" for word, unit in zip(WORDS.values(), units, strict=False)), "taps"]
    listed = "\n".join([f"- {sentence}" for sentence in source["findings"]] + [bullets(one) for one in source["lists"]])
    return f"{source['units']}\n\n{table([*head, 'calibration (factor)'], lines)}\n\n{listed}"


def bullets(options: Row, indent: str = "") -> str:
    """A list of options below its title."""
    title = f"{indent}- {options['title']}:{'' if options['items'] else ' none.'}"
    return "\n".join([title, *(f"{indent}  - {item}" for item in options["items"])])


def sections(source: Row) -> str:
    """A section for every choice: what the paper says, our default, and what each option changes."""
    return "\n\n".join(section(choice, source) for choice in source["choices"])


def section(choice: Row, source: Row) -> str:
    """One choice."""
    lines = []
    for option in choice["options"]:
        verdict = VERDICTS[option["verdict"]] + (f": {', '.join(option['of'])}" if option["of"] else "")
        lines.append([option["name"], *(interval(option, name) for name in _COLUMNS), verdict])
    head = f"### {choice['name'][0].upper()}{choice['name'][1:]}\n\n*The paper:* {choice['paper']}"
    default = f"*Default:* {choice['default']}, see [the note](../decisions/{choice['record']})."
    more = [choice["note"]] if choice["note"] else []
    more += [
        f"Without it {percent(option['impossible_taps'])} of the test taps are impossible under their own class, and "
        f"{percent(option['impossible_trials'])} of the active trials contain a tap that is impossible under every "
        "class."
        for option in choice["options"]
        if option["impossible_trials"] > 0
    ]
    more += [
        f"Not run: {row['option']}, {row['reason']}." for row in source["not_run"] if row["choice"] == choice["name"]
    ]
    unit = source["what_unit"]
    heads = ["option", f"object error ({unit})", f"at equal taps ({unit})", f"position error ({source['where_unit']})"]
    heads += ["taps", "calibration (factor)", f"passive object error ({unit})", "verdict"]
    return "\n\n".join([head, default, table(heads, lines), *more])


_COLUMNS = (
    "active_what_error",
    "equal_taps",
    "active_where_error",
    "active_taps",
    "active_factor",
    "passive_what_error",
)


def pairs(source: Row) -> str:
    """Every pair of strong options."""
    lines = [
        [
            *(f"{pair[side]['choice']}: {pair[side]['option']}" for side in ("first", "second")),
            interval(pair, "together"),
            interval(pair, "beyond"),
            "yes" if pair["sure"] else "no",
        ]
        for pair in source["pairs"]
    ]
    unit = source["what_unit"]
    return table(["option", "with", f"both ({unit})", f"interaction ({unit})", "significant"], lines)


def recorded_table(sources: Sequence[Row]) -> str:
    """The gravest verdict of every choice on every recording, and what the defaults give there."""
    names = list(dict.fromkeys(choice["name"] for source in sources for choice in source["choices"]))
    verdicts = [{choice["name"]: _SHORT[choice["verdict"]] for choice in source["choices"]} for source in sources]
    head = ["choice", *(source["name"] for source in sources)]
    lines = [[name, *(row.get(name, "-") for row in verdicts)] for name in names]
    defaults = [
        [
            source["name"],
            f"{source['grid']['L']} x {source['grid']['M']}",
            row["policy"],
            f"{interval(row, 'what_error')} {source['what_unit']}",
            f"{interval(row, 'where_error')} {source['where_unit']}" if source["grid"]["L"] > 1 else "–",
            f"{interval(row, 'taps')} taps",
            interval(row, "factor"),
        ]
        for source in sources
        for row in source["default"]
    ]
    units = "\n".join(_said(source) for source in sources)
    given = ["recording", "positions x objects", "policy", "object error", "position error", "mean reaction time"]
    given.append("calibration (factor)")
    return f"{table(given, defaults)}\n\n{table(head, lines)}\n\n{units}"


def _said(source: Row) -> str:
    """What the table of verdicts does not hold, but for what may be chance."""
    said = [sentence for sentence in source["findings"][1:] if not sentence.startswith("Choices")]
    lists = [bullets(one, "  ") for one in source["lists"] if one["key"] == "surely"]
    return "\n".join([f"- {source['name']}: {' '.join([source['units'], *said])}", *lists])


def recordings(folder: Path | None) -> Iterator[Source]:
    """Those of the recorded sets that are there."""
    for name, cells in RECORDED.items():
        if folder is not None and (folder / name).is_file():
            yield recorded_source(folder / name, Division(where_cell=cells[0], what_cell=cells[1]))


def measured(options: argparse.Namespace) -> Row:
    """What comes out on the simulated data sets and the recordings that are there."""
    settings = SensitivitySettings(trials=options.trials, seed=options.seed)
    simulated = [simulated_source("paper", options.data_sets, options.seed)] if options.data_sets else []
    sources = [*simulated, *recordings(options.recorded)]
    with bars() as progress:
        studies = [sensitivity_study(source, settings, progress) for source in sources]
    return summarise(
        studies, settings, {"title": "Open choices", "command": "benchmarks/studies/results/open_choices.py"}
    )


def main() -> None:
    """Runs the study as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--data-sets", type=int, default=40, help="simulated data sets; 0 updates only the table of recordings"
    )
    parser.add_argument("--trials", type=int, default=1000, help="trials per data set")
    parser.add_argument("--seed", type=int, default=0, help="random seed")
    parser.add_argument("--recorded", type=Path, help="folder of recordings")
    parser.add_argument(
        "--from", dest="measured", type=Path, help="rewrite text, tables and figures from these measurements"
    )
    options = parsed(parser, *BLOCKS, RECORDED_BLOCK)
    if options.measured is None:
        summary = measured(options)
    else:
        summary = worded(json.loads(options.measured.read_text(encoding="utf-8")))
    write_json("open-choices", summary)
    recorded = [source for source in summary["sources"] if not source["simulated"]]
    simulated = [source for source in summary["sources"] if source["simulated"]]
    rules = "\n".join(f"- {sentence}" for sentence in summary["rules"])
    texts = {BLOCKS[-1]: rules}
    for one in simulated:
        texts |= dict(zip(BLOCKS[:-1], (findings(one), sections(one), pairs(one)), strict=True))
    if recorded:
        texts[RECORDED_BLOCK] = recorded_table(recorded)
    for name, text in texts.items():
        print(text, end="\n\n")
        write_block(options.document, name, text)
    if options.document is not None:
        for one in simulated:
            publish(forest(one), options.document, "open-choices")
            publish(interactions(one), options.document, "open-choices-pairs")


if __name__ == "__main__":
    main()
