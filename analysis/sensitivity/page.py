"""Page of a sensitivity study."""

from collections.abc import Iterator
from functools import partial

from ..page.numbers import in_brackets, interval, number, percent
from ..page.page import Block, Brief, Listing, Note, Page, Picture, Row, Section, Table, Verbatim
from . import figures
from .findings import VERDICTS, options_of

_ADVANTAGES = ("what_error", "where_error", "taps")


def sensitivity_page(summary: Row) -> Page:
    """The page: a section for each source of data, and the rules of the verdicts."""
    method = [
        "Each choice that the paper leaves open has a default here. This study runs every other option against the "
        "defaults on the same trials and reports whether it changes the paper's conclusion, its numbers or nothing. "
        f"Results are at threshold {number(summary['theta'])} unless stated otherwise.",
        Verbatim(summary["command"]),
    ]
    sections = [
        Section(source["name"], [*_source(i, source)], f"source-{i}") for i, source in enumerate(summary["sources"], 1)
    ]
    versions = ", ".join(f"{name} {version}" for name, version in summary["versions"].items())
    made = f"{summary['trials']} trials of each data set, policy and option; seed {summary['seed']}. {versions}."
    rules = Section(
        "Method, rules of the verdicts and provenance", [*method, *summary["rules"], made], "rules", folded=True
    )
    return Page(summary["title"], [], [*sections, rules])


def _source(i: int, source: Row) -> Iterator[Block]:
    """Findings and tables; the figures are `forest-N` and `pairs-N`."""
    yield Brief(Note([*source["findings"], *(Listing(one["items"], one["title"]) for one in source["lists"])]))
    if source["simulated"]:
        yield "**These data are simulated.** The simulator was calibrated to the paper's numbers."
    what, where = in_brackets(source["what_unit"]), in_brackets(source["where_unit"])
    yield Brief(f"{source['grid']['L']} positions and {source['grid']['M']} objects. {source['units']}")
    yield (
        "Brackets are 95% intervals; for dashes and numbers without brackets see the [rules](#rules)."
        + " Objects have no sizes, so the object error is the fraction of wrong decisions, P(wrong)."
        * (source["what_unit"] == "P(wrong)")
    )
    yield Picture(
        f"forest-{i}",
        f"Effects of the options: {source['name']}",
        f"Changes relative to the default (in brackets) in {source['policies'][-1]} perception; choices in the order "
        "of the object error of their strongest option. Thick lines are individual 95% intervals, thin lines "
        "simultaneous ones; changes in the grey bands are below the relevance limit. Axes are linear in the bands and "
        "logarithmic beyond.",
        partial(figures.forest, source),
    )
    yield Brief(_ranking(source, what), columns=(0, 3, 4, 5))
    yield from (f"{choice['name'].capitalize()}: {choice['note']}" for choice in source["choices"] if choice["note"])
    yield Section("Under the defaults", [_defaults(source, what, where)], folded=True)
    yield Section("All options", [_options(source, what, where)], folded=True)
    if source["pairs"]:
        pairs = Picture(
            f"pairs-{i}",
            f"Pairs of the strongest options: {source['name']}",
            "Change of the object error by both options minus the sum of their separate changes, with 95% intervals; "
            "bold if the simultaneous interval excludes zero. Negative: both together change less than the sum, for "
            "example because errors cannot exceed chance; positive: more. Colours are linear up to the relevance "
            "limit and logarithmic beyond.",
            partial(figures.interactions, source),
        )
        yield Section("Pairs of the strongest options", [pairs], folded=True)
    left_out = [
        f"{row['choice']}, {row['option']}: {row['reason']}." for row in (*source["not_run"], *source["skipped"])
    ]
    if left_out:
        yield Listing(left_out, "Options not run")


def _defaults(source: Row, what: str, where: str) -> Table:
    names = ("what_error", "where_error", "taps", "factor")
    rows = [[row["policy"], *(interval(row, name) for name in names)] for row in source["default"]]
    if source["advantage"]:
        advantages = (interval(source["advantage"][name], "value") for name in _ADVANTAGES)
        rows.append(["passive − active", *advantages, ""])
    heads = ["policy", f"object error{what}", f"position error{where}", "taps", "calibration (factor)"]
    return Table(heads, rows, "Under the defaults")


def _ranking(source: Row, what: str) -> Table:
    last = source["policies"][-1]
    change = f"change of {last} object error{what}"
    heads = ["choice", "the paper", "default", "strongest option", change, "strongest verdict (options)"]
    rows = [
        [
            *(choice[key] for key in ("name", "paper", "default")),
            option["name"],
            interval(option, f"{last}_what_error"),
            f"{VERDICTS[choice['verdict']]} ({choice['verdict_of']})",
        ]
        for choice in source["choices"]
        for option in choice["options"]
        if option["name"] == choice["strongest"]
    ]
    return Table(heads, rows, "Choices by the effect of their strongest option", words={1, 2, 3, 5}, dense=True)


def _options(source: Row, what: str, where: str) -> Table:
    last, active = source["policies"][-1], bool(source["advantage"])
    names = [f"{last}_what_error", "equal_taps", *(f"{last}_{name}" for name in ("where_error", "taps", "factor"))]
    heads = ["choice", "option", f"object error{what}", f"object error at equal taps{what}", f"position error{where}"]
    heads += ["taps", "calibration (factor)"]
    caption = "All options minus the default"
    if active:
        names += [f"advantage_{name}" for name in _ADVANTAGES]
        errors = (f"object error{what}", f"position error{where}", "taps")
        heads += [f"passive − active: {name}" for name in errors]
        caption += f": {last} perception and its advantage over passive perception"
    first = {id(choice["options"][0]) for choice in source["choices"]}
    rows = [
        [
            name if id(option) in first else "",
            option["name"] + _impossible(option),
            *(interval(option, key) for key in names),
            _verdict(option),
        ]
        for name, option in options_of(source)
    ]
    return Table([*heads, "verdict"], rows, caption, words={1, len(heads)}, dense=True)


def _impossible(option: Row) -> str:
    if not option["impossible_trials"]:
        return ""
    return (
        f" ({percent(option['impossible_trials'])} of trials met an impossible tap; "
        f"{percent(option['impossible_taps'])} of taps are impossible under their own class)"
    )


def _verdict(option: Row) -> str:
    of, better = ", ".join(option["of"]), ", ".join(option["better"]["surely"])
    return VERDICTS[option["verdict"]] + f": {of}" * bool(of) + f"; significantly lower: {better}" * bool(better)
