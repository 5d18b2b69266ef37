"""Evidence behind the verdict of an audit: what it costs, and each test of dependence, folded."""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

from ..page.ahead import later
from ..page.numbers import bounded, factor, in_taps, interval, number, percent
from ..page.page import Block, Listing, Picture, Row, Section, Table
from .run import Audit

if TYPE_CHECKING:
    from . import figures, figures_checks, figures_reliability
else:  # they load matplotlib
    figures, figures_checks, figures_reliability = later(
        __package__, "figures", "figures_checks", "figures_reliability"
    )

_QUANTITIES = {"gain": "gain", "offset": "offset (unit of the samples)"}
_COMPONENTS = {"session": "session", "mounting": "class of a session", "tap": "tap"}
_TESTS = {
    "rank": "rank correlation",
    "distance": "distance correlation",
    "table": "information in 4 x 4 tables (nat)",
}


def evidence_blocks(audit: Audit, summary: Row) -> Iterator[Block]:
    """Every test of dependence, and what it costs."""
    evidence = summary["first_cause"]["evidence"]
    yield Section("Cost in decisions", [*_cost(audit, summary)], "cost", folded=True)
    leaks = Picture(
        "leakage",
        "Classification with and without touch",
        "Accuracy after one tap from whole taps, from samples before contact where these are known, from the "
        "subtracted offsets (which the model never sees) and from taps minus their level before contact, compared "
        "with chance; lines are 95% intervals.",
        partial(figures.leakage, audit.leakage),
    )
    yield Section("Without touch", [Listing(evidence["leakage"]["sentences"]), leaks], folded=True)
    yield Section("Across taxels", [*_taxels(audit, evidence["taxels"])], folded=True)
    yield Section("In time", [*_times(audit, evidence["times"])], folded=True)
    yield Section("Between taps", [*_components(evidence["components"])], folded=True)
    checks = Picture(
        "checks",
        "Posterior predictive checks of the naive-Bayes model",
        "Statistics of the taps, orange where they differ from all replicates, and the range of replicates drawn from "
        "histograms fitted to the taps (black), in standard deviations of the replicates. The axis is linear in the "
        "grey band, within which no difference counts, and logarithmic beyond.",
        partial(figures_checks.figure_checks, audit.checks),
    )
    made = (
        "Each statistic is computed for the taps and for replicates drawn from histograms fitted to them. A value "
        "outside the replicates shows a property that the naive-Bayes model does not reproduce."
    )
    yield Section("Posterior predictive checks", [made, checks], folded=True)


def _taxels(audit: Audit, found: Row) -> Iterator[Block]:
    sessions = (
        "and sessions"
        if found["within_sessions"]
        else "(permuted between sessions, because each session has one tap per class; dependence may be that of "
        "sessions)"
    )
    dead = f" Of {found['taxels']} taxels, these are constant and were skipped: {', '.join(map(str, found['dead']))}."
    yield (
        f"Tests are within classes {sessions} and at a fixed sample, so the time course of a press does not count. "
        "The mean absolute effect is compared with that of permuted taps. “p, taxels may drift” tests the null "
        "hypothesis that taxels are independent of each other but may each drift slowly along the session: contrasts "
        "of three neighbouring taps, which cancel linear trends, were permuted. “p, taps exchangeable” tests the null "
        "hypothesis that the order of the taps of a class and session is arbitrary, so independent taxels that drift "
        "reject it too. Pairs are those significant at a false discovery rate of 5% (by contrasts where these exist)."
        f"{dead * bool(found['dead'])}"
    )
    heads = ["test", "mean absolute effect", "permuted taps", "pairs found", "p, taxels may drift"]
    heads += ["p, taps exchangeable", "permutations"]
    yield Table(heads, [_taxel_test(test) for test in found["tests"]])
    yield Picture(
        "taxels",
        "Dependence of taxels at the same sample, within class",
        "Effect sizes of three tests below the diagonal; above it, pairs significant at a false discovery rate of 5%.",
        partial(figures.taxel_map, audit.taxels),
    )


def _taxel_test(test: Row) -> list[str]:
    name = _TESTS[test["test"]]
    if test["reason"]:
        return [name, test["reason"]]
    return [
        name,
        interval(test, "effect"),
        number(test["effect_null"], 2),
        f"{percent(test['rejected_fraction'])} of {test['pairs']}",
        test["drift_reason"] or number(test["drift_p"], 2),
        number(test["family_p"], 2),
        str(test["permutations"]),
    ]


def _times(audit: Audit, found: Row) -> Iterator[Block]:
    if found["reason"]:
        yield f"Not tested: {found['reason']}."
    else:
        yield (
            "Residuals of each taxel from the mean tap of its class: neighbouring samples have a correlation of "
            f"{triple(found['lag1'])} (p = {number(found['p'].get('lag1'), 2)}); the mean of the {found['samples']} "
            f"samples of a tap varies like that of {triple(found['effective_samples'])} independent samples, and the "
            f"{found['values']} values of a tap are worth {triple(found['effective_values'])} independent values."
        )
    yield Picture(
        "times",
        "Dependence of samples, within class",
        "Autocorrelation and partial autocorrelation of the residuals of each taxel from the mean tap of its class.",
        partial(figures.times, audit.times, audit.parts.train.preprocessing.rate_hz),
    )


def _components(found: Row) -> Iterator[Block]:
    yield Listing(found["sentences"])
    rows = [
        [
            _QUANTITIES[row["quantity"]],
            _COMPONENTS[row["component"]],
            triple([row["mean"], row["low"], row["high"]]),
        ]
        for row in found["standard_deviations"]
        if row["mean"] is not None
    ]
    heads = ["quantity", "component", "mean"]
    yield Table(heads, rows, "Standard deviations from a hierarchical model, with 90% intervals", words={1})


def _cost(audit: Audit, summary: Row) -> Iterator[Block]:
    cost = summary["miscalibration"]["evidence"]
    rest, judged = cost["at_stopping"], cost["judged"]
    yield (
        f"At threshold {rest['theta']:g}, {rest['policy']}, {percent(rest['stopped'])} of the trials stop, "
        f"{triple(rest['wrong'])} of these are wrong, and the mean of 1 − belief is {triple(rest['doubt'])}: the "
        "miscalibration factor (wrong decisions over mean 1 − belief; 1 if calibrated) is "
        f"**{factor(rest['factor'])}**. Over all decisions it is **{factor(judged['factor'], judged['unbounded'])}**; "
        f"a correct model on {judged['taps']} taps per class gives {beside(judged['beside'])}. The ratio of wrong "
        f"decisions to 1 − threshold is {triple(rest['over_promise'])}. {cost['intervals']}"
    )
    yield _decisions(cost)
    yield cost["guarantee_sentence"]
    yield Table(
        [
            "measuring sessions",
            "taps of each class and session",
            "largest factor of a correct model",
            "detectable factor",
        ],
        [
            [
                str(row["sessions"]),
                str(row["taps"]),
                number(row["right"], 2),
                "none: too few wrong decisions" if row["detectable"] is None else number(row["detectable"], 2),
            ]
            for row in cost["enough"]
        ],
        "Detectable miscalibration: factor, relative to a correct model, that is detected with 80% probability. Only "
        "the number of taps in the sessions counts here; sessions that differ require more of them",
    )
    yield _lost(summary)
    yield from _cost_pictures(audit, summary)
    scores = ("wrong", "doubt", "calibration_error", "log_loss", "brier")
    yield Table(
        ["taps", "wrong", "mean 1 − belief", "calibration error", "log loss (nat)", "Brier score"],
        [[str(row["taps"]), *(triple(row["all"][name]) for name in scores)] for row in cost["after_taps"]],
        "Passive perception after fixed numbers of taps",
        dense=True,
    )
    yield Picture(
        "after_taps",
        "Calibration after fixed numbers of taps",
        "Passive perception. A: fraction of correct decisions against belief. B: calibration error and Brier score. "
        "C: miscalibration factor; a triangle at the end of the axis marks 0 or more than 1000.",
        partial(figures_reliability.reliability_after_taps, audit.measured.reliability),
    )


def _decisions(cost: Row) -> Table:
    """Those of all objects and of each, beside a right model and what the stopping rule promises."""
    rest, judged, guarantees = cost["at_stopping"], cost["judged"], cost["guarantees"]
    rows = []
    for name, row in {"all": rest["all trials"], **rest["each"]}.items():
        own = judged if name == "all" else judged["each"][name]
        promise = cost["exceeded"][name]
        kept = "**yes**" if promise["exceeded"] else "no"
        kept += f"; correct model: {beside(promise['beside'])}" if promise["beside"] else ""
        rows.append(
            [
                name,
                triple(row["wrong"]),
                triple(row["doubt"]),
                factor(own["factor"], own["unbounded"]),
                beside(own["beside"]),
                factor(guarantees["power none, border clamp"].get(name)),
                kept,
                factor(guarantees["as used"].get(name)),
            ]
        )
    heads = [rest["decides"], "wrong", "mean 1 − belief", "factor", "correct model"]
    return Table(
        [*heads, "wrong / bound, power none and border clamp", "bound exceeded", "as used"],
        rows,
        f"All decisions and decisions for each {rest['decides']}; brackets of the correct model hold 95% of its data "
        "sets",
        words={6},
        dense=True,
    )


def _lost(summary: Row) -> str:
    less, time = summary["miscalibration"]["evidence"]["lost"], summary["remedy"]["evidence"]["reaction_time"]
    if not less["model"]:
        return f"No model below has a significantly lower error at the same mean reaction time of {in_taps(time)}."
    more = f", or needs {number(less['taps'], 2)} fewer taps for the same error" if (less["taps"] or 0) > 0 else ""
    return (
        f"The best model below, “{less['model']}”, has an error lower by "
        f"{triple([less['error'], less['low'], less['high']])} {summary['units']['what']} at the same mean reaction "
        f"time of {in_taps(time)}{more}."
    )


def _cost_pictures(audit: Audit, summary: Row) -> Iterator[Picture]:
    theta = summary["threshold"]
    yield Picture(
        "at_stopping",
        "Error rate at stopping",
        "Fraction of wrong decisions among stopped trials against the threshold: all objects (black, 95% interval in "
        "grey) and each object; dotted 1 − threshold, dashed mean 1 − belief.",
        partial(figures_reliability.reliability_at_stopping, audit.measured.reliability),
    )
    yield Picture(
        "guarantees",
        "Error rate relative to the bound of the stopping rule",
        "Wrong decisions over the bound that the stopping rule guarantees for a correct model (at most 1), with power "
        "none and border clamp (filled) and with the settings in use (hollow).",
        partial(figures_reliability.guarantee_factors, audit.guarantees),
    )
    if audit.grid.M > 1:
        yield Picture(
            "confusion",
            "Confusion of objects",
            f"Fraction of decisions at threshold {theta:g}; each row is a true object.",
            partial(figures_reliability.confusions, audit.measured.reliability, audit.grid, theta),
        )


def beside(row: Row) -> str:
    """What a right model gives."""
    return factor([row["median"], row["low"], row["high"]])


def triple(values: Sequence[float | None] | None) -> str:
    """A value with its bounds."""
    return bounded(*(values or ()))
