"""The figures of a run, each with its title and caption, in one folder."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import xarray as xr

from ...models.grid import ClassGrid
from ..page.old import DrawnPicture as Picture
from ..stats.acting import can_act
from . import figures
from .results import Request, Results

_BAND = "The band is the 95 % interval at the highest threshold."


def draw(request: Request, results: Results, folder: Path, advance: Callable[[int], None]) -> list[dict[str, Any]]:
    """Draws every figure that the data allow.

    Args:
        request: What was asked for.
        results: What came out.
        folder: Where the files go.
        advance: Told of every figure that is finished.

    Returns:
        One mapping per figure: `name`, `title`, `caption` and the files `png` and `svg`.
    """
    drawn = []
    for picture in _pictures(request, results):
        png, svg = figures.save(picture.figure, folder, picture.name)
        drawn.append({"name": picture.name, "title": picture.title, "caption": picture.caption, "png": png, "svg": svg})
        advance(1)
    return drawn


def count(grid: ClassGrid) -> int:
    """How many figures `draw` makes."""
    return 3 + 3 * can_act(grid) + (grid.M > 1) + (max(grid.shape) > 1)


def _pictures(request: Request, results: Results) -> Iterator[Picture]:
    yield _pressure(request, results)
    yield Picture(
        "fig4",
        "Beliefs during single sequences",
        "Belief in every class against the number of taps, a clear (A) and an ambiguous (B) passive sequence; "
        "grey lines are all other classes.",
        figures.beliefs(*results.cases, results.grid),
    )
    yield from _active_pictures(request, results)
    yield _acuity(results)
    theta = request.settings.thresholds[request.settings.shown]
    if results.grid.M > 1:
        yield Picture(
            "confusion",
            "Which object is taken for which",
            f"Share of decisions at threshold {theta:g}; rows are the true objects, cells below 0.005 are blank.",
            figures.confusion(*results.confusions, list(results.grid.what_name), theta),
        )
    if max(results.grid.shape) > 1:
        yield Picture(
            "contacts",
            "Accuracy after a fixed number of contacts",
            "Share of right answers after n taps of the same class, without moves or stopping, with 95 % intervals.",
            figures.contacts(results.accuracy_dataset, results.grid),
        )


def _pressure(request: Request, results: Results) -> Picture:
    train = request.split.folds[0].train
    shown = int(results.studies[0].test.what[0])
    shown = shown if (train.what == shown).any() else int(train.what[0])
    session = train.session[train.what == shown][0]
    taps = train.select((train.session == session) & (train.what == shown))
    return Picture(
        "fig3",
        "Taps of one object",
        f"The training taps on {train.what_name[shown]} of session {session} in order of position.",
        figures.pressure(taps, shown),
    )


def _active_pictures(request: Request, results: Results) -> Iterator[Picture]:
    if results.by_fixation is None or results.paths is None:
        return
    theta = request.settings.thresholds[request.settings.shown]
    yield Picture(
        "fig5_passive",
        "Passive perception by sensing position",
        "Errors and reaction time against the position where the sensor stays, one curve per threshold. " + _BAND,
        figures.errors_by_position(results.by_position),
    )
    yield Picture(
        "fig5_active",
        "Active perception by fixation point",
        "Errors and reaction time against the fixation point, averaged over starts, one curve per threshold. " + _BAND,
        figures.errors_by_fixation(results.by_fixation),
    )
    yield Picture(
        "fig6",
        "Trajectories",
        f"Position against taps in {len(results.paths.passive)} passive (A) and active (B) trials at threshold "
        f"{theta:g}; the fixation point is {results.grid.where_label(results.fixation)}.",
        figures.trajectories(*results.paths, results.grid, results.fixation),
    )


def _acuity(results: Results) -> Picture:
    # With one class of a kind its error is zero everywhere, and its panels say nothing.
    empty = [name for name, size in zip(("where_error", "what_error"), results.grid.shape, strict=True) if size == 1]
    empty = empty if len(empty) == 1 else []
    curves: dict[str, xr.Dataset] = {name: curve.drop_vars(empty) for name, curve in results.curves.items()}
    if "active" in curves:
        title = "Decision errors, passive and active"
        note = f"; the fixation point is {results.grid.where_label(results.fixation)}."
    else:
        title, note = "Decision errors, passive", "."
    return Picture(
        "fig7",
        title,
        f"Errors against the belief threshold and the mean reaction time, bands and bars are 95 % intervals{note}",
        figures.acuity(curves["passive"], curves.get("active")),
    )
