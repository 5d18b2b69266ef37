"""Page of a reproduction."""

from collections.abc import Iterable, Iterator

from ..experiment.crosscheck import CrossCheck
from ..page.numbers import crosscheck_table, in_brackets, interval, number, percent
from ..page.page import Block, Brief, Cautions, Embedded, Note, Page, Picture, Section, Table, Verbatim
from .record import ANSWERS, ErrorRow, ReproductionSummary

_LISTS = (("Options", "options", 10), ("Versions", "versions", 10), ("Time spent (s)", "elapsed_s", 3))
_RATES = ("stopped_fraction", "clamped_fraction", "substituted_fraction")


def report_page(
    summary: ReproductionSummary, check: CrossCheck, drawn: Iterable[Picture], example: Embedded | None = None
) -> Page:
    """The page; sections without content are left out.

    Args:
        summary: See `summary.summarise`.
        check: The engines compared.
        drawn: The figures.
        example: An episode to play.
    """
    theta = number(summary["headline"]["theta"], 10)
    sections = (
        Section("Method", [*_run(summary)], "run"),
        Section(f"Passive and active at threshold {theta}", [*_headline(summary)], "headline"),
        Section("Comparison with the paper", [*_paper(summary)], "paper"),
        Section("Figures", [*drawn], "figures"),
        Section("An episode, tap by tap", [] if example is None else [example], "episode"),
        Section("Results", [*_results(summary)], "results"),
        Section("Accuracy against contacts", [*_accuracy(summary)], "contacts"),
        Section("Cross-check of the engines", [*_crosscheck(check)], "crosscheck"),
        Section("Provenance", [*_provenance(summary)], "provenance"),
    )
    return Page(summary["title"], [], [section for section in sections if section.blocks])


def _run(summary: ReproductionSummary) -> Iterator[Block]:
    yield from summary["what_was_run"]
    yield Verbatim(summary["command"])
    if summary["simulated"]:
        yield Note(
            [
                "**These data are simulated.** The simulator was calibrated to the paper’s headline errors, so "
                "agreement below is not evidence for the paper or for a real sensor."
            ]
        )
    yield Brief(Cautions([*summary["warnings"], *summary["skipped"]]))
    heads = ("name", "taps", "sessions", "description")
    rows = [[number(item[head]) for head in heads] for item in summary["data"]]
    yield Table(heads, rows, "Data", words={3})
    split = summary["split"]
    yield f"Split into training and test taps: **{split['method']}**. {split['description']}"
    yield _grid(summary)


def _grid(summary: ReproductionSummary) -> str:
    grid, fixation = summary["grid"], summary["fixation"]
    sentences = [
        f"{_classes(grid['L'], 'position', grid['where'])} and {_classes(grid['M'], 'object', grid['what'])}; "
        f"{grid['K']} taxels, {grid['J']} samples per tap."
    ]
    if fixation:
        sentences.append(
            f"The fixation point is {number(fixation['value'], 10)} {summary['units']['where']} (position class "
            f"{fixation['index']}, counted from 0)."
        )
    if grid["left_out"]:
        sentences.append(f"Left out, because they have no training tap: “{'”, “'.join(grid['left_out'])}”.")
    return " ".join(sentences)


def _headline(summary: ReproductionSummary) -> Iterator[Block]:
    headline = summary["headline"]
    if headline["still"]:
        yield Brief(f"**{headline['still']}**")
    sides = {"stored": headline["stored"], "fresh": headline["fresh"]}
    if headline["enough"]:
        sides[f"fresh, at threshold {number(headline['enough']['rows'][0]['theta'], 10)}"] = headline["enough"]
    rows = [
        [name, row["policy"].replace(" - ", " − "), *_errors_and_taps(row)]
        for name, side in sides.items()
        for row in side["rows"]
    ]
    sized = [column for column, size in ((2, "M"), (3, "L")) if summary["grid"][size] > 1]
    yield Brief(Table(["test taps", "perception", *_heads(summary)], rows, words={1}), columns=(0, 1, *sized, 4))
    few = f"**{headline['few']}**" if headline["few"] and headline["few"] != summary["interval"] else ""
    yield Brief(" ".join(filter(None, (*(side["meaning"] for side in sides.values()), few, summary["interval"]))))
    if summary["differences"]:
        yield "Differences are paired: passive and active trials have the same starts and random numbers."


def _paper(summary: ReproductionSummary) -> Iterator[Block]:
    if not summary["paper"]:
        return
    rows = [
        [row["quantity"], row["unit"], number(row["paper"]), interval(row, "ours"), row["source"]]
        for row in summary["paper"]
    ]
    yield Table(["quantity", "unit", "paper", "this run [95% interval]", "section of the paper"], rows, words={4})
    yield summary["interval"]


def _results(summary: ReproductionSummary) -> Iterator[Block]:
    if not summary["results"]:
        return
    yield summary["interval"]
    none_left = any(row["no_class_left_fraction"] for row in summary["results"])
    for policy in ("passive", "active"):
        yield _policy_table(summary, policy)
    yield Table(
        ["belief threshold", *_heads(summary)],
        [[number(row["theta"], 10), *_errors_and_taps(row)] for row in summary["differences"]],
        "Passive minus active",
    )
    yield (
        "Stopped by threshold: fraction of trials that decided before the deadline. Clamped: fraction in which the "
        "end of the range shortened a move before the decision. Substituted: fraction in which a move led to a class "
        "without a test tap and the nearest class with one was used. "
        + "No class left: fraction that ended undecided with a tap that was impossible under every remaining class. "
        * none_left
        + "Reaction times include trials ended by the deadline."
    )


def _policy_table(summary: ReproductionSummary, policy: str) -> Table:
    """Errors, taps and rates against the threshold; P(wrong) beside errors in units, no class left where there was."""
    shown = [row for row in summary["results"] if row["policy"] == policy]
    what, *others = _heads(summary)
    heads = ["belief threshold", what, *others, "stopped by threshold", "trials clamped", "trials substituted"]
    rows = [
        [number(row["theta"], 10), *_errors_and_taps(row), *(percent(row[name]) for name in _RATES)] for row in shown
    ]
    if summary["units"]["what"] not in ("", "P(wrong)"):
        heads.insert(2, "P(wrong object)")
        for cells, row in zip(rows, shown, strict=True):
            cells.insert(2, "–" if row["what_wrong"] is None else f"{row['what_wrong']:.3f}")
    if any(row["no_class_left_fraction"] for row in shown):
        heads.append("no class left")
        for cells, row in zip(rows, shown, strict=True):
            cells.append(percent(row["no_class_left_fraction"]))
    return Table(heads, rows, f"{policy.capitalize()} perception")


def _accuracy(summary: ReproductionSummary) -> Iterator[Block]:
    if not summary["accuracy"]:
        return
    yield (
        "Fraction of correct decisions after a given number of contacts of one class, drawn without replacement, over "
        f"the classes with enough distinct test taps. {summary['interval']}"
    )
    rows = [
        [number(row["contacts"]), number(row["classes"]), *(interval(row, kind) for kind in ANSWERS)]
        for row in summary["accuracy"]
    ]
    yield Table(["contacts", "classes", *ANSWERS.values()], rows)


def _crosscheck(check: CrossCheck) -> Iterator[Block]:
    yield (
        f"Independent implementations computed the same {check.episodes} episodes of {check.taps} taps; "
        f"{'all differences are within the limits' if check.passed else 'differences exceed the limits'}. Differing "
        f"decisions: {check.differing_decisions}, differing moves: {check.differing_moves}, near-ties (not counted): "
        f"{check.near_ties}."
    )
    yield crosscheck_table(check)


def _provenance(summary: ReproductionSummary) -> Iterator[Block]:
    yield f"Seed {summary['seed']}. The same command with the same seed and versions gives the same numbers."
    for title, key, digits in (
        ("Options", "options", 10),
        ("Versions", "versions", 10),
        ("Time spent (s)", "elapsed_s", 3),
    ):
        rows = [(name, number(value, digits)) for name, value in summary[key].items()]
        yield Section(title, [Table((), rows, words={1})])
    yield (
        "Method: N. Lepora, U. Martinez-Hernandez and T. Prescott, “A SOLID case for active Bayesian perception in "
        "robot touch”."
    )


def _heads(summary: ReproductionSummary) -> list[str]:
    what, where = summary["units"]["what"], summary["units"]["where"]
    error = "object" if what == "P(wrong)" else "object error"
    return [error + in_brackets(what), "position error" + in_brackets(where), "reaction time (taps)"]


def _errors_and_taps(row: ErrorRow) -> list[str]:
    return [interval(row, name) for name in ("what_error", "where_error", "taps")]


def _classes(count: int, kind: str, labels: str) -> str:
    return f"{count} {kind} {'class' if count == 1 else 'classes'}{in_brackets(labels)}"
