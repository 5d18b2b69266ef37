"""Page of an audit: the verdict, where the model fails, what that costs, and remedies."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

from ..page.ahead import later
from ..page.numbers import factor, in_taps, interval, number, percent
from ..page.page import Block, Brief, Cautions, Listing, Note, Page, Picture, Row, Section, Table, Verbatim
from .leakage.words import REASSURING
from .page_evidence import evidence_blocks, triple
from .run import Audit
from .verdict import shown_cause, unsupported_causes

if TYPE_CHECKING:
    from . import figures, figures_checks, figures_reliability
else:  # they load matplotlib
    figures, figures_checks, figures_reliability = later(
        __package__, "figures", "figures_checks", "figures_reliability"
    )


def audit_page(audit: Audit, summary: Row) -> Page:
    """The page: the verdict, the causes and the remedies; all else is folded.

    Args:
        audit: What came out, for the figures.
        summary: See `summary.summarise`.
    """
    sections = [
        Section("Causes", [*_causes(audit, summary)], "where"),
        Section("Remedies", [*_remedy(audit, summary)], "remedy"),
        Section("Evidence", [*evidence_blocks(audit, summary)], "evidence"),
        Section("Method and provenance", [*_provenance(summary)], "provenance", folded=True),
    ]
    return Page(summary["title"], [*_verdict(summary)], sections)


def _verdict(summary: Row) -> Iterator[Block]:
    simulated = "The data are simulated."
    yield Brief(Note([*summary["verdict"]["short"], simulated * summary["simulated"]]))
    yield Brief(Cautions(cautions(summary)))
    yield Section("The verdict in full", summary["verdict"]["sentences"], "verdict", folded=True)


def cautions(summary: Row) -> list[str]:
    """What the numbers depend on: of leakage only if it cannot be judged, and then no finding that is a good one."""
    judged, leakage = summary["verdict"]["evidence"]["judged"], summary["first_cause"]["evidence"]["leakage"]
    found = [] if leakage["judged"] else [one for one in leakage["sentences"] if one not in REASSURING]
    return [*filter(None, [judged["few"]]), *found, *summary["warnings"]]


def _causes(audit: Audit, summary: Row) -> Iterator[Block]:
    evidence = summary["first_cause"]["evidence"]
    variance = evidence["variance"]
    if audit.split is not None and variance is not None and variance["classes"]:
        named = shown_cause(audit.leakage, audit.split, audit.session_p)
        drawn = partial(figures.seen_causes, audit.split, named, unsupported_causes(audit.split, audit.session_p))
        yield from _variance(drawn, variance, narrow=not audit.preview)
    else:
        yield (
            "The variance of the evidence cannot be decomposed: "
            f"{evidence['no_variance'] or 'no class has enough taps.'}"
        )


def _variance(drawn: Callable[[], Any], variance: Row, *, narrow: bool) -> Iterator[Block]:
    yield Picture(
        "causes",
        "Causes of the variance of the evidence",
        f"Shares of the variance of the evidence of {variance['taps']} taps of one class and session, with 95% "
        "intervals over classes; pale bars are not significant at 99%, as the verdict requires, or below 5%. "
        "Shares are differences of estimates, so they may lie below 0 or above 1.",
        drawn,
        narrow=narrow,
    )
    said = (
        "The evidence of a tap is its log-likelihood ratio for its own class against the nearest rival. The first row "
        f"is the variance that the evidence of {variance['taps']} taps of one class and session would have if samples "
        "and taps were independent; the other rows are what dependence adds. The design effect of a single tap "
        f"(observed variance ratio to independent samples) is {interval(variance['sizes'][0], 'value')} (median over "
        f"{variance['classes']} classes)."
    )
    if variance["session_p"] is not None:
        said += f" A permutation test of no difference between sessions gives p = {number(variance['session_p'], 2)}."
    if variance["covariate_p"] is not None:
        course = "the position within a class" if variance["covariate"] == "place" else "the order of taps"
        said += (
            f" A permutation test within sessions of no association with {course} gives p = "
            f"{number(variance['covariate_p'], 2)}."
        )
    table = Table(
        ["part", "share of the variance", "ratio to independent samples"],
        [[part["words"], interval(part, "share"), number(part["ratio"], 2)] for part in variance["parts"]],
        f"Variance of the evidence of {variance['taps']} taps",
    )
    sizes = [(size["words"], interval(size, "value")) for size in variance["sizes"][2:]]
    more = [
        said,
        Listing([_suspect(row) for row in variance["suspects"]]),
        Brief(table, columns=(0, 1)),
        Table((), sizes, "Size of disturbances, from the covariance of samples"),
    ]
    yield Section("Shares and sizes", more, folded=True)


def _suspect(row: Row) -> str:
    if row["p"] is None:
        said = (
            "not tested, because it hardly varies within classes and sessions or there are too few taps; its effect "
            "cannot be distinguished from that of sessions."
        )
    else:
        said = (
            f"p = {number(row['p'], 2)} for no association with the evidence from tap to tap, after removing slow "
            "trends."
        )
    if (row["follows_order"] or 0.0) > 0.5:
        said += (
            f" It follows the order of taps ({percent(row['follows_order'])} of its variance within sessions), so its "
            "effect can hardly be distinguished from drift."
        )
    return f"“{row['name']}”: {said}"


def _remedy(audit: Audit, summary: Row) -> Iterator[Block]:
    remedy, theta = summary["remedy"]["evidence"], summary["threshold"]
    tried = audit.measured
    yield Brief(remedy_table(summary), columns=(0, 1, 3, 6, 7))
    rig, recorded = (
        ("", "") if summary["simulated"] else (" --rig replay:TAPS", " (or the `rig.toml` that recorded them)")
    )
    yield (
        "`setting.json` holds the chosen setting and `model.nc` its model, fitted to the training taps: `solidtouch "
        f"perceive model.nc --setting setting.json{rig}`{recorded}, or `solidtouch reproduce --data TRAIN TEST "
        "--setting setting.json`."
    )
    yield Brief(Listing([f"**{row['name']}** is not available: {row['reason']}" for row in remedy["refused"]]))
    if audit.target is not None:
        yield Brief(f"**{audit.target.sentence}**")
        yield Picture(
            "target_error",
            "Threshold for the target error",
            "Errors and reaction times of the tuning sessions against the threshold, with prediction intervals for a "
            "new session.",
            partial(figures_reliability.wanted_error, audit.target),
        )
    effects = Picture(
        "remedies",
        "Effect of the remedies",
        f"Gain in log score per tap over {in_taps(tried.n)}, change of the error at the same mean reaction time "
        "and miscalibration at the threshold, with 95% intervals of each alone; the table allows for their number.",
        partial(figures.remedies, tried.scores, tried.n, tried.taps, tried.played),
        narrow=not audit.preview,
    )
    yield Section("Effects with intervals", [effects], folded=True)
    each = [
        f"**{row['name']}**: {row['title']}. {row['how']}"
        + (f" {row['right_model']['sentence']}" if row["right_model"] else "")
        for row in remedy["ranking"]
    ]
    each.append(f"**threshold**: {_threshold(remedy['threshold'], theta)}")
    yield Section(
        "What each remedy does, and how they are ranked", [_ranked(remedy, theta), Listing(each)], folded=True
    )


def _ranked(remedy: Row, theta: float) -> str:
    beside = (
        "Tuned values of the current model are listed below with those of a correct model, fitted and tuned in the "
        "same way on as many taps. "
    ) * any(row["right_model"] for row in remedy["ranking"])
    used_up = f" at threshold {remedy['compared_at']} (higher thresholds use up the test taps)"
    return (
        "Each remedy drops one assumption. Models other than the histogram have their own exponent, tuned on the "
        "tuning sessions like the remedy “exponent”, so any gain beyond that remedy is due to the model. Remedies are "
        f"ranked by the gain in mean log belief in the true object per tap, over {in_taps(remedy['taps'])}. Errors are "
        f"compared at the mean reaction time of the current setting{used_up * (remedy['compared_at'] < theta)}, "
        f"{in_taps(remedy['reaction_time'])}, {remedy['policy']}; a dash means that a remedy does not reach this "
        "reaction time. A remedy is significant if its gain is above zero at a level adjusted for all remedies "
        "together (stricter than the 95% intervals) and its error is not significantly more than a tenth larger. "
        f"{beside}Exponents of other models are not compared, because simulating them takes minutes; "
        "`solidtouch fit --model NAME --power learned --simulations 19` does so for any model."
    )


def remedy_table(summary: Row) -> Table:
    """Every remedy by its gain, the current setting first."""
    remedy, unit = summary["remedy"]["evidence"], summary["units"]["what"]
    chosen = summary["remedy"]["chosen"]
    error = "P(wrong)" if unit == "P(wrong)" else f"error ({unit})"
    heads = [
        "remedy",
        "gain per tap (nat)",
        error,
        f"change of {error}",
        "taps",
        "stopped",
        "factor",
        "significantly better",
        "still assumes",
    ]
    rows = [
        [
            f"**{row['name']}** (chosen)" if row["name"] == chosen else row["name"],
            *(triple(row[name]) for name in ("gain_per_tap", "error", "error_change")),
            number(row["taps"]),
            percent(row["stopped"]),
            factor(row["factor"], row["unbounded"]),
            {True: "yes", False: "no", None: ""}[row.get("worthwhile")],
            row["assumes"],
        ]
        for row in (remedy["as_it_is"], *remedy["ranking"])
    ]
    caption = f"Remedies by gain in log score per tap; errors at {in_taps(remedy['reaction_time'])}"
    if remedy["compared_at"] < summary["threshold"]:
        caption += (
            f", the mean of the current setting at threshold {remedy['compared_at']:g}; taps and factor at threshold "
            f"{summary['threshold']:g}"
        )
    return Table(heads, rows, caption, words={7, 8}, dense=True)


def _threshold(other: Row, theta: float) -> str:
    """What another threshold does, chosen on the tuning taps."""
    if other["reached"]:
        said = (
            f"on the tuning taps threshold {number(other['threshold'], 4)} has the error rate that {theta} promises "
            f"({percent(other['target'])})"
        )
    else:
        said = (
            f"on the tuning taps no threshold has the error rate that {theta} promises ({percent(other['target'])}); "
            f"the lowest is {percent(other['tuned'])}, at {number(other['threshold'], 4)}"
        )
    return (
        f"{said}. On the measuring taps {percent(other['error'])} of its decisions are wrong after "
        f"{number(other['taps'])} taps, compared with {percent(other['before'])} after {number(other['taps_before'])} "
        f"taps at {theta}."
    )


def _provenance(summary: Row) -> Iterator[Block]:
    yield f"The model treats samples, taxels and taps as independent given the class. {summary['parts']}"
    yield Verbatim(summary["command"])
    files = ", ".join(f"{name}: {taps}" for name, taps in summary["files"].items())
    yield f"{files}. Seed {summary['seed']}, solidtouch {summary['version']}."
    times = [(stage, str(seconds)) for stage, seconds in summary["elapsed_s"].items()]
    yield Table((), times, "Time spent (s); some stages run at the same time")
