"""Draws docs/reference/images/model-plates.svg: plate diagrams of all NumPyro models, from the models themselves."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch
from numpyro.infer.inspect import get_model_relations
from solidtouch.analysis.page.figure_sizes import TWO_COLUMNS, new_figure
from solidtouch.analysis.page.figure_style import OTHERS, save, styled
from solidtouch.models.measurement import (
    gaussian,
    histogram,
    matrix_normal,
    profile,
    profile_ar,
    profile_mvn,
    smooth,
    student,
)
from solidtouch.models.measurement.fits.priors import CellPrior, Taps

L, M, N, J, K, B, D = 2, 1, 6, 4, 3, 7, 5
_STEP, _GAP, _HALF = 2.35, 0.75, 1.35  # between circles, more between plates, and from a circle to a plate's edge
_WIDTH = 15.4  # of a panel
_TOP, _BOTTOM = 3.0, 0.0  # heights of parameters and samples
_NEAR, _NAMES, _FAR = 0.5, 0.38, 1.7  # from a circle to the edge at its free side, its names, the edge beyond them
_MARKER = 11.0  # points
_ORDER = ("L", "M", "D", "pair", "tap", "J", "time", "K", "taxel")  # of plates in a label


class Story(NamedTuple):
    """A model to draw.

    Attributes:
        title: Its name.
        relations: What `numpyro.infer.inspect.get_model_relations` says of it.
    """

    title: str
    relations: Mapping[str, Any]


@styled
def plates(stories: Sequence[Story], columns: int = 2) -> Figure:
    """A panel per model: circles are variables, grey if observed, boxes the plates that their inside repeats over."""
    rows = -(-len(stories) // columns)
    figure, axes = new_figure(TWO_COLUMNS, 1.9 * rows, rows, columns, whole=True)
    for panel, story in zip(axes.flat, stories, strict=False):
        plot_story(panel, story)
    for panel in list(axes.flat)[len(stories) :]:
        panel.set_visible(False)
    return figure


def plot_story(axes: Axes, story: Story) -> Axes:
    """Parameters in a row above, boxed by their plates, the observed samples below.

    Names stand above parameters and below samples, and arrows run between: they cross no text.
    """
    relations = story.relations
    groups = _groups(relations)
    place: dict[str, tuple[float, float]] = {}
    x = 0.0
    for sites in groups.values():
        for site in sites:
            place[site] = (x, _TOP)
            x += _STEP
        x += _GAP
    middle = (x - _GAP - _STEP) / 2
    for site in relations["observed"]:
        place[site] = (middle, _BOTTOM)
    for plate_set, sites in groups.items():
        _box(axes, plate_set, [place[site] for site in sites], _HALF, 1)
    for site in relations["observed"]:
        _box(axes, _plates_of(relations, site), [place[site]], 1.5 * _HALF, -1)
    for site, parents in relations["sample_sample"].items():
        for parent in parents:
            _arrow(axes, place[parent], place[site])
    for site, (at, height) in place.items():
        colour = "0.8" if site in relations["observed"] else "white"
        axes.plot(at, height, "o", markersize=_MARKER, markerfacecolor=colour, markeredgecolor="black", zorder=3)
        label = f"{site}\n{relations['sample_dist'][site]}"
        side = -1 if site in relations["observed"] else 1
        aligned: dict[str, Any] = {"ha": "center", "va": "bottom" if side > 0 else "top", "fontsize": "small"}
        axes.text(at, height + side * _NAMES, label, zorder=4, linespacing=1.05, **aligned)
    axes.set_xlim(middle - _WIDTH / 2, middle + _WIDTH / 2)
    axes.set_ylim(_BOTTOM - _FAR - 0.1, _TOP + _FAR + 0.1)
    axes.set_aspect("equal")
    axes.axis("off")
    axes.set_title(story.title, fontweight="bold")
    return axes


def _arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float]) -> None:
    """An arrow between two circles, bent below those that stand between."""
    passes = start[1] == end[1] and abs(start[0] - end[0]) > _STEP
    axes.add_patch(
        FancyArrowPatch(
            start,
            end,
            arrowstyle="-|>",
            mutation_scale=6,
            shrinkA=6.5,
            shrinkB=6.5,
            linewidth=0.6,
            color="black",
            connectionstyle=f"arc3,rad={0.3 if passes else 0.0}",
        )
    )


def _plates_of(relations: Mapping[str, Any], site: str) -> tuple[str, ...]:
    return tuple(plate for plate, sites in relations["plate_sample"].items() if site in sites)


def _groups(relations: Mapping[str, Any]) -> dict[tuple[str, ...], list[str]]:
    """Parameters by the plates around them."""
    groups: dict[tuple[str, ...], list[str]] = {}
    for site in relations["sample_sample"]:
        if site not in relations["observed"]:
            groups.setdefault(_plates_of(relations, site), []).append(site)
    return groups


def _box(
    axes: Axes,
    plate_set: tuple[str, ...],
    places: list[tuple[float, float]],
    reach: float,
    side: int,
) -> None:
    """A box around circles, reaching so far to the left and right, with names and its label above (1) or below (-1)."""
    if not plate_set:
        return
    left, right = min(x for x, _ in places) - reach, max(x for x, _ in places) + reach
    bottom, top = sorted((places[0][1] - side * _NEAR, places[0][1] + side * _FAR))
    axes.add_patch(
        FancyBboxPatch(
            (left, bottom),
            right - left,
            top - bottom,
            boxstyle="round,pad=0,rounding_size=0.1",
            facecolor="none",
            edgecolor=OTHERS,
            linewidth=0.8,
        )
    )
    label = "×".join(sorted(plate_set, key=_ORDER.index))
    aligned: dict[str, Any] = {"ha": "right", "va": "top" if side > 0 else "bottom", "fontsize": "small"}
    axes.text(right - 0.1, places[0][1] + side * (_FAR - 0.08), label, color="0.35", **aligned)


def main() -> None:
    """Writes the picture."""
    generator = np.random.default_rng(0)
    where, what = np.repeat(np.arange(L), N // L), np.zeros(N, dtype=np.intp)
    taps = Taps(generator.normal(size=(N, J, K)), where, what, (L, M))
    cells = CellPrior(0.0, 1.0, 2.0, 2.0)
    kronecker = matrix_normal.KroneckerPrior(J + 2.0, np.eye(J), K + 2.0, np.eye(K), 1.0)
    curves = smooth.CurvePrior(np.ones((D, K)), np.full(K, 2.0), np.full(K, 2.0))
    models = {
        "histogram": taps.under(histogram.story, edges=np.arange(B + 1.0)),
        "gaussian": taps.under(gaussian.story, prior=cells),
        "student": taps.under(student.story),
        "profile": taps.under(profile.story, prior=cells),
        "profile-ar": taps.under(profile_ar.story, prior=cells),
        "profile-mvn": taps.under(profile_mvn.story, prior=cells, typical=np.zeros(K * (K - 1) // 2), tightness=4.0),
        "matrix-normal": taps.under(matrix_normal.story, prior=kronecker),
        "smooth": taps.under(smooth.story, basis=np.ones((L, D)), prior=curves),
    }
    drawn = [Story(name, get_model_relations(story)) for name, story in models.items()]
    folder = Path(__file__).parents[3] / "docs" / "reference" / "images"
    save(plates(drawn), folder, "model-plates")


if __name__ == "__main__":
    main()
