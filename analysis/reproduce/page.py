"""Page of a reproduction."""

from collections.abc import Iterable, Iterator

from ..experiment.crosscheck import CrossCheck
from ..page.numbers import crosscheck_table, in_brackets, interval, number, percent
from ..page.page import Block, Brief, Cautions, Embedded, Note, Page, Picture, Section, SideBySide, Table, Verbatim
from .record import ANSWERS, ErrorRow, ReproductionSummary

_LISTS = (("Options", "options", 10), ("Versions", "versions", 10), ("Time spent (s)", "elapsed_s", 3))
_RATES = ("stopped_fraction", "clamped_fraction", "substituted_fraction")


def report_page(
    summary: ReproductionSummary, check: CrossCheck, drawn: Iterable[Picture], example: Embedded | None = None
) -> Page:
    """The page: the answer with its figure, then what it rests on; sections without content are left out.

    Args:
        summary: See `summary.summarise`.
        check: The engines compared.
        drawn: The figures.
        example: An episode to play.
    """
    figures = {picture.name: picture for picture in drawn}
    intro = [*_answer(summary), *filter(None, [figures.pop("fig7", None)]), *_cautions(summary)]
    sections = (
        Section("Fresh taps", [*_headline(summary)], "headline"),
        Section("Comparison with the paper", [*_paper(summary)], "paper"),
        Section("Figures", [*figures.values()], "figures"),
        Section("An episode, tap by tap", [] if example is None else [example], "episode"),
        Section("Method and data", [*_run(summary)], "run"),
        Section("Results at all thresholds", [*_results(summary)], "results", folded=True),
        Section("Accuracy against contacts", [*_accuracy(summary)], "contacts", folded=True),
        Section("Cross-check of the engines", [*_crosscheck(check)], "crosscheck", folded=True),
        Section("Provenance", [*_provenance(summary)], "provenance", folded=True),
    )
    return Page(summary["title"], intro, sections)


def _answer(summary: ReproductionSummary) -> Iterator[Block]:
    """The comparison in a sentence and a table, with the paper's numbers."""
    headline = summary["headline"]
    sentences = [f"**{headline['answer'][0]}**", *headline["answer"][1:], headline["still"] or ""]
    if summary["simulated"]:
        sentences.append(
            "The data are simulated; the simulator was calibrated to the paper’s headline errors, so agreement is not "
            "evidence for the paper or for a real sensor."
        )
    note = Brief(Note([" ".join(filter(None, sentences))]))
    rows = [[_policy(row), *_errors_and_taps(row)] for row in headline["stored"]["rows"]]
    rows += [[f"paper, {name}", *map(number, errors), "–"] for name, errors in _paper_errors(summary)]
    sized = [column for column, size in ((1, "M"), (2, "L")) if summary["grid"][size] > 1]
    caption = f"At threshold {number(headline['theta'], 10)}, on stored taps, with 95% intervals"
    caption += "; rows of the paper: its lowest errors" * bool(summary["paper"])
    table = Table(["perception", *_heads(summary)], rows, caption)
    yield SideBySide([note, Brief(table, columns=(0, *sized, 3))])


def _paper_errors(summary: ReproductionSummary) -> Iterator[tuple[str, tuple[float | None, float | None]]]:
    """The paper's errors of object and position, by policy."""
    for policy in ("passive", "active"):
        found = {row["error"]: row["paper"] for row in summary["paper"] or () if row["curve"] == policy}
        if found:
            yield policy, (found.get("what_error"), found.get("where_error"))


def _policy(row: ErrorRow) -> str:
    return row["policy"].replace(" - ", " − ")


def _cautions(summary: ReproductionSummary) -> Iterator[Block]:
    few = summary["headline"]["few"]
    known = [few] if few and few != summary["interval"] else []
    yield Brief(Cautions([*known, *summary["warnings"], *summary["skipped"]]))


def _run(summary: ReproductionSummary) -> Iterator[Block]:
    yield from summary["what_was_run"]
    yield Verbatim(summary["command"])
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
    """What fresh taps say, and what the two kinds of taps are."""
    headline = summary["headline"]
    sides = {number(headline["theta"], 10): headline["fresh"]}
    if headline["enough"]:
        sides[number(headline["enough"]["rows"][0]["theta"], 10)] = headline["enough"]
    rows = [[theta, _policy(row), *_errors_and_taps(row)] for theta, side in sides.items() for row in side["rows"]]
    sized = [column for column, size in ((2, "M"), (3, "L")) if summary["grid"][size] > 1]
    table = Table(["belief threshold", "perception", *_heads(summary)], rows, "On fresh taps")
    yield Brief(table, columns=(0, 1, *sized, 4))
    meanings = [side["meaning"] for side in (headline["stored"], *sides.values())]
    yield Brief(" ".join(filter(None, (*meanings, summary["interval"]))))
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
    for title, key, digits in _LISTS:
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
