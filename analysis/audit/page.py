"""The folder of an audit: figures, `audit.json`, the page, and the chosen setting with its model."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...models.setting import Setting
from ...models.storage import complete_folder
from ..page.figure_confusion import confusion
from ..page.old import DrawnPicture as Picture
from ..page.old import write_page
from . import figures, figures_reliability
from .checks import figure_checks
from .remedies import BASELINE, Remedy
from .run import Audit
from .summary import unseen_parts

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


def write_audit(folder: Path, audit: Audit, summary: Mapping[str, Any], setting: Setting, force: bool = False) -> None:
    """Writes everything, whole or not at all.

    Args:
        folder: Where to.
        audit: What came out.
        summary: See `summary.summarise`.
        setting: The chosen one, see `chosen_setting`.
        force: Whether files in an existing folder may be replaced.

    Raises:
        InputError: The folder cannot be written.
    """
    with complete_folder(folder, force) as temporary:
        write_page(temporary, "audit.html", summary, _pictures(audit, summary), "audit.json")
        setting.save(temporary / "setting.json")
        chosen_remedy(audit, summary).model.save(temporary / "model.nc")


def chosen_remedy(audit: Audit, summary: Mapping[str, Any]) -> Remedy:
    """The recommended remedy, or the setting as it is."""
    name = summary["remedy"]["chosen"] or BASELINE
    return next(remedy for remedy in audit.remedies if remedy.name == name)


def chosen_setting(audit: Audit, summary: Mapping[str, Any]) -> Setting:
    """The setting of the chosen remedy, with the threshold for the wanted error where that can be reached."""
    chosen = chosen_remedy(audit, summary)
    note = f"{summary['title']}: {chosen.title}. {chosen.how}".strip()
    if audit.target is not None and audit.target.reachable:
        return replace(
            chosen.setting, threshold=audit.target.chosen.theta, note=f"{note} {audit.target.sentence}".strip()
        )
    return replace(chosen.setting, note=note)


def _pictures(audit: Audit, summary: Mapping[str, Any]) -> Iterator[Picture]:
    for name, title, caption, figure in _drawn(audit, summary):
        if figure is not None:
            yield Picture(name, title, caption, figure)


def _seen(split: "xr.Dataset") -> "xr.Dataset":
    """Without the shares of parts that these taps cannot show."""
    shown = ~split["part"].isin(sorted(unseen_parts(split)))
    return split.assign({name: split[name].where(shown) for name in ("share", "share_low", "share_high")})


def _drawn(audit: Audit, summary: Mapping[str, Any]) -> Iterator[tuple[str, str, str, "Figure | None"]]:
    theta = summary["threshold"]
    if audit.split is not None and audit.split.attrs["classes"]:
        yield (
            "causes",
            "What makes evidence vary",
            f"Shares of the variance of the evidence of {audit.split.attrs['taps']} taps of one class and session, "
            "with 95 % intervals over classes; pale bars may be none.",
            figures.causes(_seen(audit.split), summary["first_cause"]["name"] or ""),
        )
    yield (
        "leakage",
        "What is inferred without touch",
        "Accuracy after one tap from samples before contact where they are known, from subtracted offsets, which the "
        "filter never sees, from whole taps, and from taps less their level before contact, beside chance.",
        figures.leakage(audit.leakage),
    )
    yield (
        "taxels",
        "Dependence of taxels at the same sample, within class",
        "Effect sizes of three tests below the diagonal; above it, pairs that survive a false discovery rate of 5 %.",
        figures.taxel_map(audit.taxels),
    )
    yield (
        "times",
        "Dependence of samples, within class",
        "Autocorrelation and partial autocorrelation of what is left of a taxel without the mean tap of its class.",
        figures.times(audit.times, audit.parts.train.preprocessing.rate_hz),
    )
    yield (
        "checks",
        "Posterior predictive checks of the naive-Bayes model",
        "Statistics of all taps (lines, orange where they differ) and of taps drawn from histograms fitted to them.",
        figure_checks(audit.checks),
    )
    yield (
        "after_taps",
        "Beliefs and outcomes after a number of taps",
        "Fraction of right decisions against their belief, passive; calibration error and Brier score; "
        "miscalibration factor, a triangle at an end of its axis where it is 0 or over 1000.",
        figures_reliability.reliability_after_taps(audit.measured.reliability),
    )
    yield (
        "at_stopping",
        "Wrong decisions at stopping",
        "Against the threshold, of all objects, with a 95 % interval in grey, and of each; dotted what the threshold "
        "promises, dashed what beliefs say.",
        figures_reliability.reliability_at_stopping(audit.measured.reliability),
    )
    yield (
        "guarantees",
        "Promises of the stopping rule",
        "By what factor they are exceeded, with power none and border clamp and as used; at most 1 for a right model.",
        figures_reliability.guarantee_factors(audit.guarantees),
    )
    cost = summary["miscalibration"]["evidence"]
    if audit.grid.M > 1:
        both = [cost["at_stopping"], *cost["other_policy"].values()]
        tables = {at["policy"]: at["confusion"] for at in both}
        yield (
            "confusion",
            "Which object is taken for which",
            f"Share of decisions at threshold {theta:g}; rows are the true objects.",
            confusion(tables.get("passive"), tables.get("active"), list(audit.grid.what_name), theta),
        )
    yield (
        "remedies",
        "What remedies buy",
        f"Gain in log score per tap over {audit.measured.n} taps, change of the error at the same mean reaction time, "
        "and miscalibration at the threshold, with 95 % intervals.",
        figures.remedies(audit.measured),
    )
    if audit.target is not None:
        yield (
            "target_error",
            "The threshold for the wanted error",
            "Errors and reaction times of the tuning sessions against the threshold, and what a new one is to expect.",
            figures_reliability.wanted_error(audit.target),
        )
