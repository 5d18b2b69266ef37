"""An audit as a page: the verdict, where the model fails, what that costs and what to do."""

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

from ..page.figure_confusion import confusion
from ..page.numbers import bounded, factor, interval, number, percent
from ..page.page import Block, Brief, Cautions, Listing, Note, Page, Picture, Section, Table, Verbatim
from . import figures, figures_reliability
from .figures_checks import figure_checks
from .record import (
    AuditSummary,
    BesideRecord,
    ComponentsRecord,
    CostEvidence,
    SuspectRow,
    TaxelsRecord,
    TaxelTest,
    ThresholdRecord,
    TimesRecord,
    Triple,
    VarianceRecord,
)
from .run import Audit
from .summary import unseen_parts

if TYPE_CHECKING:
    import xarray as xr

_TESTS = {
    "rank": "rank correlation",
    "distance": "distance correlation",
    "table": "information in 4 x 4 tables (nat)",
}


def audit_page(audit: Audit, summary: AuditSummary) -> Page:
    """The verdict, where the model fails, what that costs and what to do.

    Args:
        audit: What came out, for the figures.
        summary: See `summary.summarise`.
    """
    assumed = "The filter multiplies samples, taxels and taps as if they were independent given the class."
    sections = [
        Section("Verdict", [*_verdict(summary)], "verdict"),
        Section("Where it fails", [*_where(audit, summary)], "where"),
        Section("What it costs", [*_cost(audit, summary)], "cost"),
        Section("What to do", [*_remedy(audit, summary)], "remedy"),
        Section("Provenance", [*_provenance(summary)], "provenance"),
    ]
    return Page(summary["title"], [f"{assumed} {summary['parts']}", Verbatim(summary["command"])], sections)


def _verdict(summary: AuditSummary) -> Iterator[Block]:
    yield Brief(Note(summary["verdict"]["sentences"]))
    if summary["simulated"]:
        yield "**These data are simulated.**"
    yield Brief(Cautions(summary["warnings"]))


def _where(audit: Audit, summary: AuditSummary) -> Iterator[Block]:
    evidence = summary["first_cause"]["evidence"]
    variance = evidence["variance"]
    if audit.split is not None and variance is not None and variance["classes"]:
        yield from _variance(audit.split, variance, summary["first_cause"]["name"] or "")
    else:
        yield f"The variance of evidence cannot be split: {evidence['no_variance'] or 'no class has taps enough.'}"
    leaks = Picture(
        "leakage",
        "What is inferred without touch",
        "Accuracy after one tap from samples before contact where they are known, from subtracted offsets, which the "
        "filter never sees, from whole taps, and from taps less their level before contact, beside chance.",
        partial(figures.leakage, audit.leakage),
    )
    yield Section("Without touch", [Listing(evidence["leakage"]["sentences"]), leaks])
    yield Section("Across taxels", [*_taxels(audit, evidence["taxels"])])
    yield Section("In time", [*_times(audit, evidence["times"])])
    yield Section("Between taps", [*_components(evidence["components"])])
    checks = Picture(
        "checks",
        "Posterior predictive checks of the naive-Bayes model",
        "Statistics of all taps (lines, orange where they differ) and of taps drawn from histograms fitted to them.",
        partial(figure_checks, audit.checks),
    )
    made = (
        "The same statistics of taps drawn from histograms that were fitted to these taps: what the naive-Bayes model "
        "does not make lies outside."
    )
    yield Section("Taps that the model would make", [made, checks])


def _variance(split: "xr.Dataset", variance: VarianceRecord, cause: str) -> Iterator[Block]:
    said = (
        "The evidence of a tap is its log-likelihood ratio for its own class against the nearest rival. Were samples "
        f"and taps independent, the variance of the evidence of {variance['taps']} taps of one class and session would "
        "be the first row; the others say what comes on top. The design effect of a single tap, observed over "
        f"independent variance, is {interval(variance['sizes'][0], 'value')} (median over {variance['classes']} "
        "classes)."
    )
    if variance["session_p"] is not None:
        said += (
            f" Exchanging taps between sessions gives p = {number(variance['session_p'], 2)} for no difference between "
            "them."
        )
    if variance["covariate_p"] is not None:
        course = "the position inside a class" if variance["covariate"] == "place" else "the order of taps"
        said += (
            f" Exchanging taps within sessions gives p = {number(variance['covariate_p'], 2)} for nothing that goes "
            f"with {course}."
        )
    yield said
    yield Listing([_suspect(row) for row in variance["suspects"]])
    yield Brief(
        Table(
            ["part", "share of the variance", "over that of independent samples"],
            [[part["words"], interval(part, "share"), number(part["ratio"], 2)] for part in variance["parts"]],
            f"Variance of the evidence of {variance['taps']} taps",
        ),
        columns=(0, 1),
    )
    yield Picture(
        "causes",
        "What makes evidence vary",
        f"Shares of the variance of the evidence of {variance['taps']} taps of one class and session, "
        "with 95 % intervals over classes; pale bars may be none.",
        partial(figures.causes, _seen(split), cause),
    )
    sizes = [(size["words"], interval(size, "value")) for size in variance["sizes"][2:]]
    yield Table((), sizes, "How large disturbances are, by the covariance of samples")


def _suspect(row: SuspectRow) -> str:
    if row["p"] is None:
        said = (
            "not tested: it hardly varies within classes and sessions, or there are too few taps, so its effect cannot "
            "be told from that of sessions."
        )
    else:
        said = (
            f"p = {number(row['p'], 2)} for nothing in evidence that goes with it from tap to tap, beyond any slow "
            "course."
        )
    if (row["follows_order"] or 0.0) > 0.5:
        said += (
            f" It follows the order of taps ({percent(row['follows_order'])} of its variance within sessions), so its "
            "effect can hardly be told from drift."
        )
    return f"“{row['name']}”: {said}"


def _taxels(audit: Audit, found: TaxelsRecord) -> Iterator[Block]:
    sessions = (
        "and sessions"
        if found["within_sessions"]
        else "(each session has one tap of a class, so that taps were exchanged between sessions and dependence may be "
        "that of sessions)"
    )
    dead = f" Taxels without any change were skipped: {', '.join(map(str, found['dead']))} of {found['taxels']}."
    yield (
        f"Within classes {sessions}, at fixed sample, so that the course of a press does not count. The mean absolute "
        "effect stands beside that of permuted taps. “p, taxels may drift” has the null that taxels are independent of "
        "each other, each with any slow course along the session: contrasts of three neighbouring taps, which leave "
        "nothing of a line, were permuted, so what taxels share slowly does not count. “p, taps exchangeable” has the "
        "null that the taps of a class and session come in no particular order, so taxels that are independent but "
        "drift reject it too. Pairs are those that survive a false discovery rate of 5 % by contrasts, where there are "
        "any." + dead * bool(found["dead"])
    )
    heads = ["test", "mean absolute effect", "permuted", "pairs found", "p, taxels may drift", "p, taps exchangeable"]
    yield Table([*heads, "permutations"], [_taxel_test(test) for test in found["tests"]])
    yield Picture(
        "taxels",
        "Dependence of taxels at the same sample, within class",
        "Effect sizes of three tests below the diagonal; above it, pairs that survive a false discovery rate of 5 %.",
        partial(figures.taxel_map, audit.taxels),
    )


def _taxel_test(test: TaxelTest) -> list[str]:
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


def _times(audit: Audit, found: TimesRecord) -> Iterator[Block]:
    if found["reason"]:
        yield f"Nothing to test: {found['reason']}."
    else:
        yield (
            "Samples of a taxel without the mean tap of their class: the correlation of neighbours is "
            f"{_triple(found['lag1'])} (p = {number(found['p'].get('lag1'), 2)}); the {found['samples']} samples of a "
            f"tap have a mean that varies as that of {_triple(found['effective_samples'])} independent ones, and all "
            f"values of a tap together are worth {_triple(found['effective_values'])} independent ones of "
            f"{found['values']}."
        )
    yield Picture(
        "times",
        "Dependence of samples, within class",
        "Autocorrelation and partial autocorrelation of what is left of a taxel without the mean tap of its class.",
        partial(figures.times, audit.times, audit.parts.train.preprocessing.rate_hz),
    )


def _components(found: ComponentsRecord) -> Iterator[Block]:
    yield Listing(found["sentences"])
    rows = [
        [
            row["quantity"],
            row["component"],
            _triple([row["mean"], row["low"], row["high"]]),
            number(row["r_hat"]),
            number(row["ess_bulk"], 3),
        ]
        for row in found["standard_deviations"]
        if row["mean"] is not None
    ]
    heads = ["quantity", "component", "mean", "R-hat", "effective draws"]
    yield Table(heads, rows, "Standard deviations by a hierarchical model, with 90 % intervals", words={1})


def _cost(audit: Audit, summary: AuditSummary) -> Iterator[Block]:
    cost = summary["miscalibration"]["evidence"]
    rest, judged = cost["at_stopping"], cost["judged"]
    yield (
        f"At threshold {rest['theta']}, {rest['policy']}, {percent(rest['stopped'])} of the trials stop, "
        f"{_triple(rest['wrong'])} of these are wrong, and the mean of 1 - belief is {_triple(rest['doubt'])}: the "
        f"miscalibration factor is **{factor(rest['factor'])}**, 1 where beliefs are right. Of all decisions it is "
        f"**{factor(judged['factor'], judged['unbounded'])}**; a right model on {judged['taps']} taps per class gives "
        f"{_beside(judged['beside'])}. Wrong decisions over 1 - threshold: {_triple(rest['over_promise'])}. "
        f"{cost['intervals']}"
    )
    yield _decisions(cost)
    yield cost["guarantee_sentence"]
    yield Table(
        ["measuring sessions", "taps of each class and session", "factor of a right model, at most", "found from"],
        [
            [
                str(row["sessions"]),
                str(row["taps"]),
                number(row["right"], 2),
                "never: too few wrong decisions" if row["detectable"] is None else number(row["detectable"], 2),
            ]
            for row in cost["enough"]
        ],
        "What would be enough: how many times as often wrong as a right model decisions must be, to be found with 80 % "
        "probability. Sessions count by their taps here; those that differ need more of them",
    )
    yield _lost(summary)
    yield from _cost_pictures(audit, summary)
    scores = ("wrong", "doubt", "calibration_error", "log_loss", "brier")
    yield Table(
        ["taps", "wrong", "mean of 1 - belief", "calibration error", "log loss (nat)", "Brier score"],
        [[str(row["taps"]), *(_triple(row["all"][name]) for name in scores)] for row in cost["after_taps"]],
        "After fixed numbers of taps, passive",
        dense=True,
    )
    yield Picture(
        "after_taps",
        "Beliefs and outcomes after a number of taps",
        "Fraction of right decisions against their belief, passive; calibration error and Brier score; "
        "miscalibration factor, a triangle at an end of its axis where it is 0 or over 1000.",
        partial(figures_reliability.reliability_after_taps, audit.measured.reliability),
    )


def _decisions(cost: CostEvidence) -> Table:
    """Those of all objects and of each, beside a right model and what the stopping rule promises."""
    rest, judged, guarantees = cost["at_stopping"], cost["judged"], cost["guarantees"]
    rows = []
    for name, row in {"all": rest["all trials"], **rest["each"]}.items():
        own = judged if name == "all" else judged["each"][name]
        promise = cost["exceeded"][name]
        kept = "**yes**" if promise["exceeded"] else "no"
        kept += f"; a right model: {_beside(promise['beside'])}" if promise["beside"] else ""
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
    heads = [rest["decides"], "wrong", "mean of 1 - belief", "factor", "a right model gives"]
    return Table(
        [*heads, "wrong over promised, power none and border clamp", "promise exceeded", "as used"],
        rows,
        f"All decisions and those for each {rest['decides']}; in brackets beside a right model where 95 % of its data "
        "sets lie",
        words={6},
        dense=True,
    )


def _lost(summary: AuditSummary) -> str:
    less, time = summary["miscalibration"]["evidence"]["lost"], summary["remedy"]["evidence"]["reaction_time"]
    if not less["model"]:
        return f"No model below errs surely less at the same mean reaction time of {number(time)} taps."
    more = f", or {number(less['taps'], 2)} taps at the same error" if (less["taps"] or 0) > 0 else ""
    return (
        f"Against “{less['model']}”, the best of the models below at the same mean reaction time of {number(time)} "
        f"taps, {_triple([less['error'], less['low'], less['high']])} {summary['units']['what']} of error are "
        f"lost{more}."
    )


def _cost_pictures(audit: Audit, summary: AuditSummary) -> Iterator[Picture]:
    cost, theta = summary["miscalibration"]["evidence"], summary["threshold"]
    yield Picture(
        "at_stopping",
        "Wrong decisions at stopping",
        "Against the threshold, of all objects, with a 95 % interval in grey, and of each; dotted what the threshold "
        "promises, dashed what beliefs say.",
        partial(figures_reliability.reliability_at_stopping, audit.measured.reliability),
    )
    yield Picture(
        "guarantees",
        "Promises of the stopping rule",
        "By what factor they are exceeded, with power none and border clamp and as used; at most 1 for a right model.",
        partial(figures_reliability.guarantee_factors, audit.guarantees),
    )
    if audit.grid.M > 1:
        both = [cost["at_stopping"], *cost["other_policy"].values()]
        tables = {at["policy"]: at["confusion"] for at in both}
        yield Picture(
            "confusion",
            "Which object is taken for which",
            f"Share of decisions at threshold {theta:g}; rows are the true objects.",
            partial(confusion, tables.get("passive"), tables.get("active"), list(audit.grid.what_name), theta),
        )


def _remedy(audit: Audit, summary: AuditSummary) -> Iterator[Block]:
    remedy, theta = summary["remedy"]["evidence"], summary["threshold"]
    used_up = f" at threshold {remedy['compared_at']}, as above its trials use up the test taps"
    yield (
        "Every remedy gives up one assumption; models other than the histogram come with an exponent of their own, "
        "tuned like that of the remedy “exponent” on sessions that neither trained nor measure, so what they gain "
        "beyond it is theirs. They are ranked by what they buy per tap: the gain in the mean log belief in the true "
        f"object over {remedy['taps']} taps. Errors are compared at the mean reaction time that the setting as it is "
        f"needs{used_up * (remedy['compared_at'] < theta)}, {number(remedy['reaction_time'])} taps, "
        f"{remedy['policy']}; there is none where a remedy is never as slow or as fast. A remedy surely helps if its "
        "gain is above zero at a level that holds for all of them together, which is stricter than the 95 % "
        "intervals, and its error is not surely more than a tenth larger. What is tuned for the model in use stands "
        "below beside what a right model gives on as many taps, fitted and tuned in the same way; exponents of other "
        "models are not compared, as simulating those models takes minutes (`solidtouch fit --model NAME --power "
        "learned --simulations 19` compares that of any model)."
    )
    yield Brief(_remedies(summary), columns=(0, 1, 3, 6, 7))
    yield Picture(
        "remedies",
        "What remedies buy",
        f"Gain in log score per tap over {audit.measured.n} taps, change of the error at the same mean reaction time, "
        "and miscalibration at the threshold, with 95 % intervals.",
        partial(figures.remedies, audit.measured),
    )
    yield Listing(
        [
            f"**{row['name']}**: {row['title']}. {row['how']}"
            + (f" {row['right_model']['sentence']}" if row["right_model"] else "")
            for row in remedy["ranking"]
        ]
    )
    yield Brief(Listing([f"**{row['name']}** is not possible here: {row['reason']}" for row in remedy["refused"]]))
    yield Listing([f"**threshold**: {_threshold(remedy['threshold'], theta)}"])
    if audit.target is not None:
        yield Brief(f"**{audit.target.sentence}**")
        yield Picture(
            "target_error",
            "The threshold for the wanted error",
            "Errors and reaction times of the tuning sessions against the threshold, and what a new one is to expect.",
            partial(figures_reliability.wanted_error, audit.target),
        )
    rig, recorded = (
        ("", "") if summary["simulated"] else (" --rig replay:TAPS", " (or the `rig.toml` that recorded them)")
    )
    yield (
        "The chosen setting is in `setting.json`, its model, fitted to the training taps, in `model.nc`: "
        f"`solidtouch perceive model.nc --setting setting.json{rig}`{recorded}, or "
        "`solidtouch reproduce --data TRAIN TEST --setting setting.json`."
    )


def _remedies(summary: AuditSummary) -> Table:
    remedy, unit = summary["remedy"]["evidence"], summary["units"]["what"]
    chosen = summary["remedy"]["chosen"]
    error = "P(wrong)" if unit == "P(wrong)" else f"error ({unit})"
    heads = ["remedy", "gain per tap (nat)", error, "change", "taps", "stop", "factor", "surely helps", "still assumes"]
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


def _threshold(other: ThresholdRecord, theta: float) -> str:
    """What another threshold does, chosen on the tuning taps."""
    if other["reached"]:
        said = (
            f"on the tuning taps {number(other['threshold'], 4)} errs as rarely as {theta} promises "
            f"({percent(other['target'])})"
        )
    else:
        said = (
            f"on the tuning taps no threshold errs as rarely as {theta} promises ({percent(other['target'])}); "
            f"{number(other['threshold'], 6)} errs least, {percent(other['tuned'])}"
        )
    return (
        f"{said}. On the measuring taps it errs in {percent(other['error'])} of the trials after "
        f"{number(other['taps'])} taps, where {theta} errs in {percent(other['before'])} after "
        f"{number(other['taps_before'])}."
    )


def _provenance(summary: AuditSummary) -> Iterator[Block]:
    files = ", ".join(f"{name}: {taps}" for name, taps in summary["files"].items())
    yield f"{files}. Seed {summary['seed']}, solidtouch {summary['version']}."
    times = [(stage, str(seconds)) for stage, seconds in summary["elapsed_s"].items()]
    yield Table((), times, "Seconds per stage")


def _beside(row: BesideRecord) -> str:
    """What a right model gives."""
    return factor([row["median"], row["low"], row["high"]])


def _triple(values: Triple | None) -> str:
    """A value with its bounds."""
    return bounded(*(values or ()))


def _seen(split: "xr.Dataset") -> "xr.Dataset":
    """Without the shares of parts that these taps cannot show."""
    shown = ~split["part"].isin(sorted(unseen_parts(split)))
    return split.assign({name: split[name].where(shown) for name in ("share", "share_low", "share_high")})
