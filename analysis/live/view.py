"""Live view of the belief: a picture, a sentence or a record for each tap, for grids of any size.

The picture is a heat map of the joint belief with its marginals beside it. Colours go from dark to bright and are
told apart by the colour-blind; percentages stand in the cells, so it can be read without colour too.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.cells import cell_len
from rich.color import Color
from rich.console import Group
from rich.style import Style
from rich.text import Text

from ...inference.episode import Step
from ...inference.novelty import FLAGGED
from ...models.grid import ClassGrid
from ..page.figure_style import unit_name
from ..page.numbers import in_brackets

# Nine colours of matplotlib's viridis, from low to high.
_COLOURS = np.array(
    [
        (68, 1, 84), (71, 44, 122), (59, 81, 139), (44, 113, 142), (33, 144, 141), (39, 173, 129), (92, 200, 99),
        (170, 220, 50), (253, 231, 37),
    ]
)  # fmt: skip
_BLOCKS = " ▏▎▍▌▋▊▉█"
_STEPS = " ▁▂▃▄▅▆▇█"
_CELL = 4  # characters of a column: a percentage and a space
_TOTAL = 7  # of the what belief in figures
_BAR = 12  # of its bar, where there is room
_SHORTEST_BAR = 4
_NARROWEST = 72
_LONGEST_NAME = 18
_DIGITS = 9  # of what is recorded, so that engines that agree give the same text


class Seen(NamedTuple):
    """One step and what is needed to show it.

    Attributes:
        step: The tap and what is believed after it.
        grid: The classes.
        theta: Threshold on the what belief; 1 of a rule that has none.
        fixation: The fixation point, or `None` for passive perception.
        p: Predictive p-value of the tap, `None` where the model cannot tell.
        unknown: Whether the episode ends here because nothing that is known fits.
        heading: What is perceived with what, and which episode.
        rule: Name of the stopping rule where it is another one than the threshold.
    """

    step: Step
    grid: ClassGrid
    theta: float
    fixation: int | None
    p: float | None
    unknown: bool = False
    heading: str = ""
    rule: str = ""

    @property
    def what_name(self) -> str:
        """Name of the most probable object."""
        return self.grid.what_name[self.step.what]

    @property
    def where_label(self) -> str:
        """The most probable place."""
        return self.grid.where_label(self.step.where)


def sentence(seen: Seen) -> str:
    """One line without colour."""
    step = seen.step
    parts = [
        f"tap {step.number}: {seen.what_name} {step.what_marginal.max():.3f}",
        f"{seen.where_label} {step.where_marginal.max():.3f}",
        _novelty(seen.p),
        _next(seen),
    ]
    return ", ".join(parts)


def record(seen: Seen) -> dict[str, Any]:
    """The same for a program, as JSON has it."""
    step = seen.step
    return {
        "tap": step.number,
        "what": seen.what_name,
        "what_belief": _rounded(step.what_marginal.max()),
        "where": float(seen.grid.where_value[step.where]),
        "where_index": step.where,
        "where_belief": _rounded(step.where_marginal.max()),
        "log_evidence": None if step.no_class_left else _rounded(step.log_evidence),
        "p": None if seen.p is None else _rounded(seen.p),
        "unusual": seen.p is not None and seen.p < FLAGGED,
        "arrived": step.arrived,
        "move": step.move,
        "what_marginal": [_rounded(value) for value in step.what_marginal],
        "where_marginal": [_rounded(value) for value in step.where_marginal],
    }


def picture(seen: Seen, width: int = 100, rows: int = 20) -> Group:
    """The heat map with its marginals and what is said about it.

    Args:
        seen: What to show.
        width: Characters of a line; neighbouring where classes share a column where there are too many.
        rows: Objects shown at most; the least probable ones share a row where there are more.
    """
    grid = seen.grid
    belief, names = _fewer_rows(np.exp(seen.step.log_belief).T, list(grid.what_name), rows)
    side = _side(names)
    columns = max(1, (width - side - _TOTAL) // _CELL)
    per_column = -(-grid.L // columns)
    starts = np.arange(0, grid.L, per_column)
    bar = min(_BAR, width - side - _TOTAL - _CELL * len(starts))
    shown = np.add.reduceat(belief, starts, axis=1)
    lines = [_header([f"{value:.4g}" for value in grid.where_value[starts]], side).append("  what", style="bold")]
    lines += [_row(name, side, values, seen.theta, bar) for name, values in zip(names, shown, strict=True)]
    lines += _where_rows(shown.sum(axis=0), side)
    if seen.fixation is not None:
        lines.append(Text(" " * (side + _CELL * (seen.fixation // per_column) + 2) + "▲ fixation point", no_wrap=True))
    share = "" if per_column == 1 else f", {per_column} classes each, the first named"
    legend = f"Belief in percent, · below 0.5; columns: position{in_brackets(unit_name(grid.axis_unit))}{share}."
    head = [Text(seen.heading, style="bold")] if seen.heading else []
    return Group(*head, *lines, Text(legend, style="italic"), *_words(seen))


def fitting_width(grid: ClassGrid) -> int:
    """Characters that a line needs for each where class to have its own column, and the sentences to be read."""
    return max(_NARROWEST, _side(grid.what_name) + _CELL * grid.L + _TOTAL + _BAR)


def _side(names: Sequence[str]) -> int:
    """Characters of the column of names and the space behind it; some letters are two wide."""
    return min(max(map(cell_len, [*names, "where"])), _LONGEST_NAME) + 1


def _fewer_rows(belief: NDArray[np.float64], names: list[str], rows: int) -> tuple[NDArray[np.float64], list[str]]:
    """The most probable rows in their order, and the sum of the others."""
    if len(names) <= rows:
        return belief, names
    order = np.argsort(-belief.sum(axis=1), kind="stable")
    kept, others = np.sort(order[: rows - 1]), order[rows - 1 :]
    whole = np.vstack([belief[kept], belief[others].sum(axis=0)])
    return whole, [*(names[m] for m in kept), f"{len(others)} others"]


def _header(labels: list[str], side: int) -> Text:
    """The places above their columns; every second, third, ... where they are long."""
    stride = -(-(1 + max(map(len, labels))) // _CELL)
    line = [" "] * (side + _CELL * len(labels))
    for i in range(0, len(labels), stride):
        end = side + _CELL * (i + 1) - 1
        if len(labels[i]) <= end:
            line[end - len(labels[i]) : end] = labels[i]
    return Text("".join(line), style="bold", no_wrap=True)


def _row(name: str, side: int, values: NDArray[np.float64], theta: float, bar: int) -> Text:
    text = Text(name, no_wrap=True)
    text.truncate(side - 1, overflow="ellipsis", pad=True)
    text.append(" ")
    for value in values:
        text.append(f"{_percent(value):>{_CELL - 1}} ", _colours(value))
    total = float(values.sum())
    text.append(f" {total:5.3f} {_bar(total, theta, bar)}")
    return text


def _where_rows(marginal: NDArray[np.float64], side: int) -> list[Text]:
    """The where marginal as columns, and in percent."""
    heights = "".join(" " + _STEPS[round(8 * min(1.0, value))] * (_CELL - 2) + " " for value in marginal)
    percent = "".join(f"{_percent(value):>{_CELL - 1}} " for value in marginal)
    return [Text(" " * side + heights, no_wrap=True), Text(f"{'where':{side}}{percent}", style="bold", no_wrap=True)]


def _words(seen: Seen) -> list[Text]:
    step = seen.step
    decided = step.decision is not None
    what, where = step.what_marginal.max(), step.where_marginal.max()
    relation = f"above the threshold {seen.theta:g}" if decided else f"threshold {seen.theta:g}"
    if seen.rule:
        relation = f"stops by {seen.rule}"
    return [
        Text(f"Tap {step.number}: {seen.what_name} {what:.3f} ({relation}), at {seen.where_label} {where:.3f}."),
        Text(_sentence_case(_novelty(seen.p)), style="bold" if seen.p is not None and seen.p < FLAGGED else ""),
        Text(_sentence_case(_next(seen)), style="bold" if step.move is None or seen.unknown else ""),
    ]


def _novelty(p: float | None) -> str:
    if p is None:
        return "no p-value"
    return f"unusual tap, p {p:.2g}" if p < FLAGGED else f"usual tap, p {p:.2g}"


def _next(seen: Seen) -> str:
    step = seen.step
    if seen.unknown:
        return "unknown: unlike every object of the model"
    if step.no_class_left:
        return (
            f"no class left: this tap is impossible under every remaining class; {seen.what_name} was the most "
            "probable before"
        )
    if step.gave_up:
        return f"given up: no decision, {seen.what_name} is the most probable"
    if step.decision is not None:
        return f"decided: {seen.what_name}"
    if step.move is None:
        return f"deadline: {seen.what_name} is the most probable"
    doubted = "possibly unlike every object of the model, " if step.what_marginal.max() > seen.theta else ""
    return doubted + (f"move {step.move:+d}" if step.move else "stay")


def _bar(value: float, theta: float, length: int) -> str:
    """A bar from 0 to 1 with a mark at the threshold; nothing where there is no room."""
    if length < _SHORTEST_BAR:
        return ""
    eighths = round(8 * length * min(1.0, value))
    bar = ("█" * (eighths // 8) + _BLOCKS[eighths % 8] * (eighths % 8 > 0)).ljust(length)
    mark = min(length - 1, int(theta * length))
    return bar[:mark] + "┊" + bar[mark + 1 :] if theta < 1 and bar[mark] == " " else bar


def _percent(value: float) -> str:
    return "·" if value < 0.005 else f"{100 * value:.0f}"


def _colours(value: float) -> Style:
    """Bright for probable; the root makes small beliefs visible. Digits are dark on bright and bright on dark."""
    at = np.sqrt(min(1.0, max(0.0, float(value)))) * (len(_COLOURS) - 1)
    low = min(int(at), len(_COLOURS) - 2)
    red, green, blue = _COLOURS[low] + (at - low) * (_COLOURS[low + 1] - _COLOURS[low])
    dark = 0.299 * red + 0.587 * green + 0.114 * blue < 128
    ink = Color.from_rgb(255, 255, 255) if dark else Color.from_rgb(0, 0, 0)
    return Style(color=ink.name, bgcolor=Color.from_rgb(red, green, blue).name)


def _sentence_case(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."


def _rounded(value: float) -> float:
    return round(float(value), _DIGITS)
