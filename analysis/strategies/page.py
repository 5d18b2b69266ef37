"""The folder of a comparison of strategies: figures, `strategies.json` and the page."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ...models.storage import complete_folder
from ..page.old import DrawnPicture as Picture
from ..page.old import write_page
from . import figures
from .figures_regret import regret
from .figures_trust import trust


def write_strategies(folder: Path, summary: Mapping[str, Any], force: bool = False) -> None:
    """Writes everything, whole or not at all.

    Args:
        folder: Where to.
        summary: See `summary.summarise`.
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
            "the mean way of the sensor (linear up to its first number), each group of strategies beside the fixation "
            "point. Right of each panel stand the last points with their 95 % intervals, in the order of the key; an "
            "arrowhead is where one is cut.",
            figures.curves(source),
        )
        yield Picture(
            f"equal-taps-{number}",
            f"Strategies at equal taps: {name}",
            "Object error less that of the fixation point, paired, at equal mean numbers of taps. Thick lines are "
            "95 % intervals, thin ones, where there are any, hold all together; hollow points have none. An arrowhead "
            "is where a thin line is cut.",
            figures.equal_taps(source),
        )
        yield Picture(
            f"stopping-{number}",
            f"Rules of stopping: {name}",
            "Object error of the trials that answer along the levels of each rule, in colour, and of the paper's, in "
            "grey, with the fixation point; in the last panel the share of null decisions of the rules that give up. "
            "Right of each panel stand the last points with their 95 % intervals; an arrowhead is where one is cut.",
            figures.stopping(source),
        )
        yield Picture(
            f"trajectories-{number}",
            f"Trajectories: {name}",
            f"Position against taps in {len(next(iter(source['paths'].values())))} trials of one data set up to their "
            f"decision at threshold {summary['theta']:g}, from the same starts. Lines on one position are spread by up "
            "to a quarter of a class and a dot ends each; strokes at the left are trials that decide with their first "
            "tap, grey is the share of trials that make a tap, dashed the fixation point.",
            figures.trajectories(source),
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
        "model promised beyond what the taps told, of both. On the dashed lines both are alike. With 95 % "
        "intervals, cut ones with an arrowhead; hollow points lie beyond the axis, and what is not known is counted.",
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
