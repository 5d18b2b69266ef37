"""Page and labelled numbers of a comparison."""

import json
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from ..page.ahead import later
from ..page.labelled import NUMBERS_FORMAT
from ..page.numbers import bounded, factor_of, in_brackets, interval, listed, number, percent
from ..page.page import Block, Brief, Cautions, Note, Page, Picture, Row, Section, Table, Verbatim
from .run import Comparison
from .taps import SAMPLE

if TYPE_CHECKING:
    from . import figures, figures_decisions, figures_taps
else:  # they load matplotlib
    figures, figures_decisions, figures_taps = later(__package__, "figures", "figures_decisions", "figures_taps")


def comparison_tree(comparison: Comparison, summary: Row) -> xr.DataTree:
    """All numbers with their names, dims and units."""
    groups: dict[str, xr.Dataset | None] = {
        "/": xr.Dataset(
            attrs={name: summary[name] for name in ("title", "command", "seed")}
            | {"grid": json.dumps(comparison.grid.to_dict()), "format": NUMBERS_FORMAT}
        ),
        "taps_left_out": comparison.left_out_taps,
        f"{summary['unit']}s_left_out": comparison.left_out_groups,
        "checks": comparison.checks,
        "classes": comparison.classes,
        "decisions": comparison.curves,
        "equal_taps": comparison.equal,
    }
    if comparison.stacking is not None:
        numbers = comparison.stacking.select_dtypes("number")
        groups["stacking"] = xr.Dataset(
            {name: ("model", numbers[name].to_numpy(dtype=np.float64)) for name in numbers.columns},
            {"model": np.array(comparison.stacking.index, dtype=np.str_)},
        )
    return xr.DataTree.from_dict({name: group for name, group in groups.items() if group is not None})


def comparison_page(comparison: Comparison, summary: Row) -> Page:
    """The page: ranks first, then a table and a figure for each level, with the others folded.

    Args:
        comparison: What came out, for the figures.
        summary: See `summary.summarise`.
    """
    sections = (
        Section("Prediction of taps", [*_taps(comparison, summary)], "taps"),
        Section("Inference of classes", [*_classes(comparison, summary)], "classes"),
        Section("Decisions", [*_decisions(comparison, summary)], "decisions"),
        Section("Method and models", [*_method(summary)], "models"),
        Section("Provenance", [*_provenance(summary)], "provenance", folded=True),
    )
    return Page(summary["title"], [*_findings(summary)], sections)


def _findings(summary: Row) -> Iterator[Block]:
    def rank(cell: Row | None) -> str:
        return "–" if cell is None else f"**{cell['rank']}** ({number(cell['value'])})"

    simulated = "Ranks refer to the simulator; a real sensor may rank the models differently."
    care = f"{summary['overconfident']} See [Calibration of decisions](#calibration)." * bool(summary["overconfident"])
    yield Brief(Note([summary["headline"], care, simulated * summary["simulated"]]))
    yield Brief(best_models(summary))
    titles = [level["title"] + in_brackets(level["unit"]) for level in summary["levels"]]
    rows = [[row["name"], *map(rank, row["levels"])] for row in summary["ranks"]]
    yield Brief(Table(["model", *titles], rows, "Rank of each model (1 is best), with the ranked quantity in brackets"))
    refused = [f"{row['name']} was left out: {row['reason']}" for row in summary["refused"]]
    yield Brief(Cautions([*summary["warnings"], *refused]))


def best_models(summary: Row) -> Table:
    """The best model at each level beside the second and the reference model."""

    def valued(name: str, value: float | None) -> str:
        return f"{name} ({number(value)})"

    reference = summary["reference"]
    rows = [
        [
            row["title"] + in_brackets(row["unit"]),
            valued(listed(row["best"]), row["value"]),
            "–" if row["second"] is None else valued(row["second"], row["second_value"]),
            *(bounded(*row[name] or ()) for name in ("less_second", "less_reference")),
        ]
        for row in summary["best"]
    ]
    caption = (
        f"The best model at each level, with its differences from the second and from {reference}, the first of "
        "--models, and their 95% intervals; none where test taps are too few or a curve ends nearby"
    )
    return Table(["level", "best", "second", "best − second", f"best − {reference}"], rows, caption, words={1, 2})


def _method(summary: Row) -> Iterator[Block]:
    yield from summary["what_was_run"]
    yield Verbatim(summary["command"])
    yield (
        f"Taps: mean log probability of a tap’s bins under its own class, for left-out {summary['unit']}s, integrated "
        "over the posterior (by plug-in parameters for all models if one has no posterior), at power 1. Classes: mean "
        "log belief in the true (position, object) class. Decisions: "
        "mean object error at the longest mean reaction time reached by all models or, if there is none, by most. "
        "Models that are equal but for rounding share a rank. Adjacent ranks may be ties: what counts is the interval "
        "of a difference. The best model is compared with the second and with the first of --models, the reference of "
        "all differences; name another model first to change it."
    )
    yield _models(summary)


def _taps(comparison: Comparison, summary: Row) -> Iterator[Block]:
    """Prediction, with what is left out by single taps and predictive checks folded."""
    unit, means = summary["unit"], comparison.left_out_groups
    if means is not None:
        less = f"− {summary['reference']}"
        yield Brief(
            Table(
                ["model", "integrated", less, "plug-in", less, "weight"],
                [
                    [
                        row["name"],
                        interval(row, "integrated"),
                        interval(row, "integrated_difference"),
                        interval(row, "plug_in"),
                        interval(row, "plug_in_difference"),
                        f"{row['weight']:.2f}" if "weight" in row else "–",
                    ]
                    for row in summary["taps"]
                ],
                f"Log probability of the taps of left-out {unit}s (nat per tap)",
            ),
            columns=(0, 1, 2, 3, 5),
        )
        yield Picture(
            f"{unit}s",
            f"Prediction of left-out {unit}s",
            "Mean log probability of a tap’s bins minus that of the reference model, with 95% intervals.",
            partial(figures_taps.groups_left_out, means),
            narrow=True,
        )
    drawn = unit if means is None else means.attrs["drawn"]
    how = f"leaving out each {drawn} in turn"
    if unit != "session":
        how = f"leaving out each fold of {unit}s, and hold for independent {unit}s"
    meaning = (
        f"{summary['groups']} Values are mean log probabilities per tap, in nats, of the same bins for all models, "
        "at power 1. Integrated: over the posterior of the parameters. Plug-in: at the parameters used for decisions. "
        f"Intervals are 95% jackknife intervals, {how}. Stacking weights are those of ArviZ (`az.compare`), with taps "
        "as units."
    )
    yield Section("What is compared", [meaning], folded=True)
    if means is not None and unit != "session":
        other = "object" if unit == "position" else "position"
        yield Section(f"{other.capitalize()} after one tap at left-out {unit}s", [*_inferred(summary)], folded=True)
    if comparison.left_out_taps is not None:
        yield Section("Single left-out taps", [*_single_taps(comparison.left_out_taps, summary)], folded=True)
    yield Section("Predictive checks", [*_checks(comparison, summary)], "checks", folded=True)


def _inferred(summary: Row) -> Iterator[Block]:
    unit, less = summary["unit"], f"− {summary['reference']}"
    other = "object" if unit == "position" else "position"
    yield (
        f"A model without parameters for a {unit} that it was not trained on gives a tap the mean of its probabilities "
        f"at the trained {unit}s and the same {other}. The {other} is inferred from one tap at the left-out {unit}, "
        f"summed over the {unit}s that the model knows, all equally probable at first, at the power of its decisions."
    )
    error = f"{other} error" + in_brackets(summary["units"]["what" if other == "object" else "where"])
    heads = {f"log belief in the true {other} (nat)": "belief", error: "error"}
    yield Table(
        ["model", *(head for title in heads for head in (title, less))],
        [
            [row["name"], *(interval(row, key) for name in heads.values() for key in (name, f"{name}_difference"))]
            for row in summary["taps"]
        ],
        f"{other.capitalize()} after one tap at left-out {unit}s",
    )


def _single_taps(left_out: xr.Dataset, summary: Row) -> Iterator[Block]:
    rows = [row for row in summary["taps"] if "psis" in row]
    yield Table(
        [
            *("model", "importance sampling", "taps looked at", "of these with k too large", "ranked"),
            *("exact, integrated", "exact, plug-in"),
        ],
        [
            [
                row["name"],
                number(row["psis"], 4),
                str(row["psis_taps"]),
                percent(row["bad_k"]),
                "yes" if row["psis_ranks"] else "no",
                number(row.get("exact"), 4),
                number(row.get("exact_plug_in"), 4),
            ]
            for row in rows
        ],
        "Log probability of single left-out training taps (nat per tap)",
    )
    yield (
        f"Importance sampling (PSIS-LOO, {summary['draws']} draws) is unreliable for a tap with a Pareto k above "
        f"{number(rows[0]['good_k'], 2)}, that is, a tap with a large influence on the posterior of its class, or "
        "without a Pareto k; models with such taps are not ranked by it. Models that fail on a random sample of "
        f"{SAMPLE} taps have no value, because the others are not looked at. Where a closed form exists "
        "(histogram, gaussian and profile), leaving out a tap is exact, given the prior that the training taps suggest."
    )
    yield Picture(
        "pareto",
        "Reliability of importance sampling",
        "Pareto k of the training taps; to the right of the dashed line the estimate for a tap is unreliable.",
        partial(figures_taps.pareto, left_out),
        narrow=True,
    )


def _checks(comparison: Comparison, summary: Row) -> Iterator[Block]:
    checks = summary["checks"]
    if not checks or comparison.checks is None:
        return
    yield (
        "Each statistic tests an assumption of some models. The table gives its value in the training taps and its "
        "mean in replicates drawn from each fitted model; in brackets the fraction of replicates at or above the "
        "observed value, which is near 0 or 1 if the model does not reproduce the statistic. A fraction near 0 or 1 "
        "is weak evidence if both values are close, because replicates contain the sampling error of the fit as well "
        "as that of the taps."
    )
    yield Table(
        ["statistic", "tests", "observed", *(model["name"] for model in checks[0]["models"])],
        [
            [
                check["statistic"],
                check["assumption"],
                number(check["observed"]),
                *(f"{number(model['replicated'], 2)} ({number(model['p'], 2)})" for model in check["models"]),
            ]
            for check in checks
        ],
        words={1},
        dense=True,
    )
    yield Picture(
        "checks",
        "Predictive checks",
        "Statistics of the training taps (blue line) and of replicates drawn from each fitted model (median and "
        "central 95%). A model whose bar does not reach the line does not reproduce the statistic.",
        partial(figures_taps.predictive_checks, comparison.checks),
    )


def _classes(comparison: Comparison, summary: Row) -> Iterator[Block]:
    """Scores after the most taps that give intervals, with those after others folded."""
    known = [row["contacts"] for row in summary["classes"] if row["log_score_joint_low"] is not None]
    shown = max(known, default=summary["contacts"][-1])
    yield _class_table(comparison, summary, shown)
    yield Picture(
        "classes",
        "Beliefs after fixed numbers of taps",
        "Scores of beliefs against the number of taps of one class, with 95% intervals.",
        partial(figures.class_scores, comparison.classes, comparison.grid),
        curves=True,
    )
    meaning = (
        "Beliefs after fixed numbers of taps of one class and session, without moves or stopping; all models see the "
        f"same sequences. {summary['class_interval']}"
    )
    yield Section("What is compared", [meaning], folded=True)
    others = [_class_table(comparison, summary, n) for n in summary["contacts"] if n != shown]
    yield Section("After other numbers of taps", others, folded=True)
    differences = Picture(
        "class_differences",
        "Beliefs relative to the reference model",
        "The same scores minus those of the reference model on the same sequences.",
        partial(figures.class_differences, comparison.classes, comparison.grid),
        curves=True,
    )
    yield Section("Differences from the reference model", [differences], folded=True)


def _class_table(comparison: Comparison, summary: Row, n: int) -> Table:
    scores = {}
    if comparison.grid.M > 1:
        scores |= {"Brier score, object": "brier_what", "calibration error, object": "calibration_what"}
        scores |= {"object correct": "accuracy_what"}
    if comparison.grid.L > 1:
        scores |= {"position correct": "accuracy_where"}
    return Table(
        ["model", "log belief in the true class (nat)", f"− {summary['reference']}", *scores],
        [
            [
                row["name"],
                interval(row, "log_score_joint"),
                interval(row, "log_score_joint_difference"),
                *(interval(row, name) for name in scores.values()),
            ]
            for row in summary["classes"]
            if row["contacts"] == n
        ],
        f"After {n} tap{'' if n == 1 else 's'}",
        dense=True,
    )


def _decisions(comparison: Comparison, summary: Row) -> Iterator[Block]:
    """Errors at equal reaction times of the last policy, with all else folded."""
    units = summary["units"]
    what = "P(wrong)" if units["what"] == "P(wrong)" else f"object error ({units['what']})"
    played = [policy for policy in ("passive", "active") if _rows_of(summary["decisions"], policy)]
    *others, last = [policy for policy in played if _rows_of(summary["equal_taps"], policy)] or [""]
    yield _at_equal_times(_rows_of(summary["equal_taps"], last), last, what)
    yield Picture(
        "decisions",
        "Errors against reaction time",
        "Mean errors of each model against mean reaction times, one point per threshold; grey: "
        f"{summary['reference']}. Bands are 95% intervals, cut at the top of the panels.",
        partial(figures_decisions.decision_curves, comparison.curves, comparison.grid),
        curves=True,
    )
    meaning = (
        f"{summary['trials']} trials of each model and policy, from the same starts and with the same random numbers. "
        f"{summary['decision_interval']} Errors are compared at equal mean reaction times along the curves; a dash "
        "means that a model does not reach that reaction time. Miscalibration is the fraction of wrong objects over "
        "the mean of 1 − belief at the decision (1 if calibrated)."
    )
    yield Section("What is compared", [meaning], folded=True)
    tables = [_at_threshold(comparison, summary, policy, what) for policy in played]
    yield Section(f"At threshold {number(summary['shown_theta'], 10)}", tables, folded=True)
    differences = Picture(
        "decision_differences",
        "Errors at equal reaction times, relative to the reference model",
        "Error minus that of the reference model at the same mean reaction time, in the same trials.",
        partial(figures.decision_differences, comparison.equal, comparison.grid),
        curves=True,
    )
    equal = [_at_equal_times(_rows_of(summary["equal_taps"], policy), policy, what) for policy in others]
    yield Section("At equal reaction times", [*equal, differences], folded=True)
    calibration = Picture(
        "miscalibration",
        "Calibration of decisions",
        "Fraction of wrong objects over the mean of 1 − belief at the decision, against the threshold, with 95% "
        f"intervals; 1 is calibrated, more is overconfident. Grey: {summary['reference']}.",
        partial(figures_decisions.miscalibration, comparison.curves),
        curves=True,
    )
    yield Section("Calibration of decisions", [calibration], "calibration", folded=True)


def _rows_of(rows: list[Row], policy: str) -> list[Row]:
    return [row for row in rows if row["policy"] == policy]


def _at_threshold(comparison: Comparison, summary: Row, policy: str, what: str) -> Table:
    errors = {what: "what_error"} if comparison.grid.M > 1 else {}
    where = "position error" + in_brackets(summary["units"]["where"])
    errors |= {where: "where_error"} if comparison.grid.L > 1 else {}
    return Table(
        ["model", *errors, "taps", "stopped by threshold", "test taps used up", "miscalibration"],
        [
            [
                row["name"],
                *(interval(row, name) for name in (*errors.values(), "taps")),
                percent(row["stopped_fraction"]),
                percent(row["used_up"]),
                factor_of(row, "miscalibration"),
            ]
            for row in _rows_of(summary["decisions"], policy)
            if row["theta"] == summary["shown_theta"]
        ],
        f"{policy.capitalize()}",
    )


def _at_equal_times(rows: list[Row], policy: str, what: str) -> Table:
    times, names = (list(dict.fromkeys(row[key] for row in rows)) for key in ("taps", "name"))
    cells = [[name, *(interval(row, "what_error") for row in rows if row["name"] == name)] for name in names]
    caption = f"{policy.capitalize()}, {what} at equal mean reaction times"
    return Table(["model", *(f"{number(time)} tap{'s' * (time != 1)}" for time in times)], cells, caption, dense=True)


def _models(summary: Row) -> Table:
    return Table(
        ["model", "assumption dropped", "assumption made instead", "power of decisions", "fit", "seconds"],
        [
            [
                row["name"],
                row["relaxes"],
                row["how"],
                row["power"],
                row["fit"] + ("" if row["converged"] else " **It did not converge.**"),
                number(row["seconds"]),
            ]
            for row in summary["models"]
        ],
        words={1, 2, 4},
    )


def _provenance(summary: Row) -> Iterator[Block]:
    grid = summary["grid"]
    yield (
        f"Seed {summary['seed']}; {summary['test_taps']} test taps of {grid['L']} x {grid['M']} (position, object) "
        "classes, those known to all models. The same command with the same seed and versions gives the same numbers."
    )
    yield Section("Versions", [Table((), [*summary["versions"].items()], words={1})])
    times = [(name, number(value)) for name, value in summary["elapsed_s"].items()]
    yield Section("Time spent (s)", [Table((), times)])
