"""The folder of a comparison of strategies: figures, `strategies.json` and the page."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ..models.storage import complete_folder
from . import figure_strategies
from .figure_strategies_regret import regret
from .figure_strategies_trust import trust
from .pictures import Picture
from .report import write_page


def write_strategies(folder: Path, summary: Mapping[str, Any], force: bool = False) -> None:
    """Writes everything, whole or not at all.

    Args:
        folder: Where to.
        summary: See `strategies_summary.summarise`.
        force: Whether files in an existing folder may be replaced.

    Raises:
        InputError: The folder cannot be written.
    """
    with complete_folder(folder, force) as temporary:
        write_page(temporary, "strategies.html", summary, pictures(summary), "strategies.json")


def pictures(summary: Mapping[str, Any]) -> Iterator[Picture]:
    """The figures of each kind of data, numbered from 1, the one across them, `trust`, and `regret`."""
    for number, source in enumerate(summary["sources"], 1):
        name = source["name"]
        yield Picture(
            f"curves-{number}",
            f"Error against taps and way: {name}",
            "Object and position errors along the belief thresholds of the paper, against the mean number of taps and "
            "the mean way of the sensor. Bars are 95 % intervals of the last points.",
            figure_strategies.curves(source),
        )
        yield Picture(
            f"equal-taps-{number}",
            f"Strategies at equal taps: {name}",
            "Object error less that of the fixation point, paired, at equal mean numbers of taps. Thick lines are "
            "95 % intervals, thin ones hold all together.",
            figure_strategies.equal_taps(source),
        )
        yield Picture(
            f"stopping-{number}",
            f"Rules of stopping: {name}",
            "Object error of the trials that answer (A) and share of null decisions (B) along the levels of each rule, "
            "with the fixation point. Bars are 95 % intervals of the last points.",
            figure_strategies.stopping(source),
        )
        yield Picture(
            f"trajectories-{number}",
            f"Trajectories: {name}",
            f"Position against taps in {len(next(iter(source['paths'].values())))} trials of one data set up to their "
            f"decision at threshold {summary['theta']:g}, from the same starts. Lines on one position are spread by up "
            "to a quarter of a class; a dot ends each; dashed is the fixation point.",
            figure_strategies.trajectories(source),
        )
    if summary["sources"]:
        yield _trust(summary)
    if summary["regret"]:
        yield _regret(summary["regret"])


def _trust(summary: Mapping[str, Any]) -> Picture:
    return Picture(
        "trust",
        "What is left where the model is too sure",
        f"After {summary['look']} taps. A: P(wrong object) of the fixation point less that of info-what, against the "
        "miscalibration of the fixation point. B: miscalibration of both. C: information about the object that the "
        "model promised beyond what the taps told, of both. On the dashed lines both are misled alike. With 95 % "
        "intervals; miscalibration beyond 10 000 is left out.",
        trust(summary["sources"]),
    )


def _regret(summary: Mapping[str, Any]) -> Picture:
    return Picture(
        "regret",
        "Cost above the least possible",
        "Cost of each strategy under four kinds of stopping rules above that of the exact rule, in the last column "
        "above a bound that no strategy stays below, with 95 % intervals. Of the fixation points the best and the "
        "worst with the best threshold. Logarithmic; what is less than the left end is drawn there.",
        regret(summary),
    )
