"""Page of an audit: the verdict, where the model fails, what that costs, and remedies."""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

from ..page.ahead import later
from ..page.figure_confusion import confusion
from ..page.numbers import bounded, factor, interval, number, percent
from ..page.page import Block, Brief, Cautions, Listing, Note, Page, Picture, Row, Section, Table, Verbatim
from .run import Audit
from .summary import seen

if TYPE_CHECKING:
    import xarray as xr

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


def audit_page(audit: Audit, summary: Row) -> Page:
    """The page: the verdict, where the model fails, what that costs, and remedies.

    Args:
        audit: What came out, for the figures.
        summary: See `summary.summarise`.
    """
    assumed = "The model treats samples, taxels and taps as independent given the class."
    sections = [
        Section("Verdict", [*_verdict(summary)], "verdict"),
        Section("Dependence in the taps", [*_where(audit, summary)], "where"),
        Section("Cost in decisions", [*_cost(audit, summary)], "cost"),
        Section("Remedies", [*_remedy(audit, summary)], "remedy"),
        Section("Provenance", [*_provenance(summary)], "provenance"),
    ]
    return Page(summary["title"], [f"{assumed} {summary['parts']}", Verbatim(summary["command"])], sections)


def _verdict(summary: Row) -> Iterator[Block]:
    yield Brief(Note(summary["verdict"]["sentences"]))
    if summary["simulated"]:
        yield "**These data are simulated.**"
    yield Brief(Cautions(summary["warnings"]))


def _where(audit: Audit, summary: Row) -> Iterator[Block]:
    evidence = summary["first_cause"]["evidence"]
    variance = evidence["variance"]
    if audit.split is not None and variance is not None and variance["classes"]:
        yield from _variance(audit.split, variance, summary["first_cause"]["name"] or "")
    else:
        yield (
            "The variance of the evidence cannot be decomposed: "
            f"{evidence['no_variance'] or 'no class has enough taps.'}"
        )
    leaks = Picture(
        "leakage",
        "Classification with and without touch",
        "Accuracy after one tap from whole taps, from samples before contact where these are known, from the "
        "subtracted offsets (which the model never sees) and from taps minus their level before contact, compared "
        "with chance; lines are 95% intervals.",
        partial(figures.leakage, audit.leakage),
    )
    yield Section("Without touch", [Listing(evidence["leakage"]["sentences"]), leaks])
    yield Section("Across taxels", [*_taxels(audit, evidence["taxels"])])
    yield Section("In time", [*_times(audit, evidence["times"])])
    yield Section("Between taps", [*_components(evidence["components"])])
    checks = Picture(
        "checks",
        "Posterior predictive checks of the naive-Bayes model",
        "Statistics of the taps (vertical lines, orange where they lie outside all replicates) and of replicates "
        "drawn from histograms fitted to them.",
        partial(figures_checks.figure_checks, audit.checks),
    )
    made = (
        "Each statistic is computed for the taps and for replicates drawn from histograms fitted to them. A value "
        "outside the replicates shows a property that the naive-Bayes model does not reproduce."
    )
    yield Section("Posterior predictive checks", [made, checks])


def _variance(split: "xr.Dataset", variance: Row, cause: str) -> Iterator[Block]:
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
    yield said
    yield Listing([_suspect(row) for row in variance["suspects"]])
    yield Brief(
        Table(
            ["part", "share of the variance", "ratio to independent samples"],
            [[part["words"], interval(part, "share"), number(part["ratio"], 2)] for part in variance["parts"]],
            f"Variance of the evidence of {variance['taps']} taps",
        ),
        columns=(0, 1),
    )
    yield Picture(
        "causes",
        "Causes of the variance of the evidence",
        f"Shares of the variance of the evidence of {variance['taps']} taps of one class and session, with 95% "
        "intervals over classes; pale bars are not significant. Shares are differences of estimates, so they may lie "
        "below 0 or above 1.",
        partial(figures.causes, seen(split), cause),
    )
    sizes = [(size["words"], interval(size, "value")) for size in variance["sizes"][2:]]
    yield Table((), sizes, "Size of disturbances, from the covariance of samples")


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


def _taxels(audit: Audit, found: Row) -> Iterator[Block]:
    sessions = (
        "and sessions"
        if found["within_sessions"]
        else "(permuted between sessions, because each session has one tap per class; dependence may be that of "
        "sessions)"
    )
    dead = f" Constant taxels were skipped: {', '.join(map(str, found['dead']))} of {found['taxels']}."
    yield (
        f"Tests are within classes {sessions} and at a fixed sample, so the time course of a press does not count. "
        "The mean absolute effect is compared with that of permuted taps. “p, taxels may drift” tests the null "
        "hypothesis that taxels are independent of each other but may each drift slowly along the session: contrasts "
        "of three neighbouring taps, which cancel linear trends, were permuted. “p, taps exchangeable” tests the null "
        "hypothesis that the order of the taps of a class and session is arbitrary, so independent taxels that drift "
        "reject it too. Pairs are those significant at a false discovery rate of 5% (by contrasts where these exist)."
        + dead
        * bool(found["dead"])
    )
    heads = [
        "test",
        "mean absolute effect",
        "permuted taps",
        "pairs found",
        "p, taxels may drift",
        "p, taps exchangeable",
    ]
    yield Table([*heads, "permutations"], [_taxel_test(test) for test in found["tests"]])
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
            f"{_triple(found['lag1'])} (p = {number(found['p'].get('lag1'), 2)}); the mean of the {found['samples']} "
            f"samples of a tap varies like that of {_triple(found['effective_samples'])} independent samples, and the "
            f"{found['values']} values of a tap are worth {_triple(found['effective_values'])} independent values."
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
            _triple([row["mean"], row["low"], row["high"]]),
            number(row["r_hat"]),
            number(row["ess_bulk"], 3),
        ]
        for row in found["standard_deviations"]
        if row["mean"] is not None
    ]
    heads = ["quantity", "component", "mean", "R-hat", "effective draws"]
    yield Table(heads, rows, "Standard deviations from a hierarchical model, with 90% intervals", words={1})


def _cost(audit: Audit, summary: Row) -> Iterator[Block]:
    cost = summary["miscalibration"]["evidence"]
    rest, judged = cost["at_stopping"], cost["judged"]
    yield (
        f"At threshold {rest['theta']}, {rest['policy']}, {percent(rest['stopped'])} of the trials stop, "
        f"{_triple(rest['wrong'])} of these are wrong, and the mean of 1 − belief is {_triple(rest['doubt'])}: the "
        "miscalibration factor (wrong decisions over mean 1 − belief; 1 if calibrated) is "
        f"**{factor(rest['factor'])}**. Over all decisions it is **{factor(judged['factor'], judged['unbounded'])}**; "
        f"a correct model on {judged['taps']} taps per class gives {_beside(judged['beside'])}. The ratio of wrong "
        f"decisions to 1 − threshold is {_triple(rest['over_promise'])}. {cost['intervals']}"
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
        [[str(row["taps"]), *(_triple(row["all"][name]) for name in scores)] for row in cost["after_taps"]],
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
        kept += f"; correct model: {_beside(promise['beside'])}" if promise["beside"] else ""
        rows.append(
            [
                name,
                _triple(row["wrong"]),
                _triple(row["doubt"]),
                factor(own["factor"], own["unbounded"]),
                _beside(own["beside"]),
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
        return f"No model below has a significantly lower error at the same mean reaction time of {number(time)} taps."
    more = f", or needs {number(less['taps'], 2)} fewer taps for the same error" if (less["taps"] or 0) > 0 else ""
    return (
        f"The best model below, “{less['model']}”, has an error lower by "
        f"{_triple([less['error'], less['low'], less['high']])} {summary['units']['what']} at the same mean reaction "
        f"time of {number(time)} taps{more}."
    )


def _cost_pictures(audit: Audit, summary: Row) -> Iterator[Picture]:
    cost, theta = summary["miscalibration"]["evidence"], summary["threshold"]
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
        both = [cost["at_stopping"], *cost["other_policy"].values()]
        tables = {at["policy"]: at["confusion"] for at in both}
        yield Picture(
            "confusion",
            "Confusion of objects",
            f"Fraction of decisions at threshold {theta:g}; each row is a true object.",
            partial(confusion, tables.get("passive"), tables.get("active"), list(audit.grid.what_name), theta),
        )


def _remedy(audit: Audit, summary: Row) -> Iterator[Block]:
    remedy, theta = summary["remedy"]["evidence"], summary["threshold"]
    beside = (
        "Tuned values of the current model are listed below with those of a correct model, fitted and tuned in the "
        "same way on as many taps. "
    ) * any(row["right_model"] for row in remedy["ranking"])
    used_up = f" at threshold {remedy['compared_at']} (higher thresholds use up the test taps)"
    yield (
        "Each remedy drops one assumption. Models other than the histogram have their own exponent, tuned on the "
        "tuning sessions like the remedy “exponent”, so any gain beyond that remedy is due to the model. Remedies are "
        f"ranked by the gain in mean log belief in the true object per tap, over {remedy['taps']} taps. Errors are "
        f"compared at the mean reaction time of the current setting{used_up * (remedy['compared_at'] < theta)}, "
        f"{number(remedy['reaction_time'])} taps, {remedy['policy']}; a dash means that a remedy does not reach this "
        "reaction time. A remedy is significant if its gain is above zero at a level adjusted for all remedies "
        "together (stricter than the 95% intervals) and its error is not significantly more than a tenth larger. "
        f"{beside}Exponents of other models are not compared, because simulating them takes minutes; "
        "`solidtouch fit --model NAME --power learned --simulations 19` does so for any model."
    )
    yield Brief(_remedies(summary), columns=(0, 1, 3, 6, 7))
    yield Picture(
        "remedies",
        "Effect of the remedies",
        f"Gain in log score per tap over {audit.measured.n} taps, change of the error at the same mean reaction time "
        "and miscalibration at the threshold, with 95% intervals of each alone; the table allows for their number.",
        partial(figures.remedies, audit.measured),
    )
    yield Listing(
        [
            f"**{row['name']}**: {row['title']}. {row['how']}"
            + (f" {row['right_model']['sentence']}" if row["right_model"] else "")
            for row in remedy["ranking"]
        ]
    )
    yield Brief(Listing([f"**{row['name']}** is not available: {row['reason']}" for row in remedy["refused"]]))
    yield Listing([f"**threshold**: {_threshold(remedy['threshold'], theta)}"])
    if audit.target is not None:
        yield Brief(f"**{audit.target.sentence}**")
        yield Picture(
            "target_error",
            "Threshold for the target error",
            "Errors and reaction times of the tuning sessions against the threshold, with prediction intervals for a "
            "new session.",
            partial(figures_reliability.wanted_error, audit.target),
        )
    rig, recorded = (
        ("", "") if summary["simulated"] else (" --rig replay:TAPS", " (or the `rig.toml` that recorded them)")
    )
    yield (
        "`setting.json` holds the chosen setting and `model.nc` its model, fitted to the training taps: `solidtouch "
        f"perceive model.nc --setting setting.json{rig}`{recorded}, or `solidtouch reproduce --data TRAIN TEST "
        "--setting setting.json`."
    )


def _remedies(summary: Row) -> Table:
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
            *(_triple(row[name]) for name in ("gain_per_tap", "error", "error_change")),
            number(row["taps"]),
            percent(row["stopped"]),
            factor(row["factor"], row["unbounded"]),
            {True: "yes", False: "no", None: ""}[row.get("worthwhile")],
            row["assumes"],
        ]
        for row in (remedy["as_it_is"], *remedy["ranking"])
    ]
    caption = f"Remedies by gain in log score per tap; errors at {number(remedy['reaction_time'])} taps"
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
    files = ", ".join(f"{name}: {taps}" for name, taps in summary["files"].items())
    yield f"{files}. Seed {summary['seed']}, solidtouch {summary['version']}."
    times = [(stage, str(seconds)) for stage, seconds in summary["elapsed_s"].items()]
    yield Table((), times, "Time spent (s); some stages run at the same time")


def _beside(row: Row) -> str:
    """What a right model gives."""
    return factor([row["median"], row["low"], row["high"]])


def _triple(values: Sequence[float | None] | None) -> str:
    """A value with its bounds."""
    return bounded(*(values or ()))
