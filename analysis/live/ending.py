"""How an episode ended: the answer, the reason and, where it is known, the truth."""

from typing import Any, NamedTuple

from ...hardware.named_rigs import Truth
from ...models.grid import ClassGrid
from .view import Seen


class Ending(NamedTuple):
    """How an episode ended.

    Attributes:
        seen: Its last step.
        reason: `"threshold"`, `"rule"` where another rule decided, `"deadline"`, `"gave up"`, `"no class left"` or
            `"unknown"`.
        truth: True object and position, as far as known.
    """

    seen: Seen
    reason: str
    truth: Truth

    @property
    def answer(self) -> str | None:
        """The object, `"unknown"`, or `None` for a null decision."""
        if self.reason == "gave up":
            return None
        return "unknown" if self.reason == "unknown" else self.seen.what_name

    @property
    def right(self) -> bool | None:
        """Whether the answer is correct; `unknown` is correct for objects that are not in the model.

        `None` if the object is not known, and for null decisions.
        """
        if self.truth.what is None or self.answer is None:
            return None
        grid = self.seen.grid
        covered = [{name, *members} for name, members in zip(grid.what_name, grid.what_members, strict=True)]
        if self.reason == "unknown":
            return not any(self.truth.what in names for names in covered)
        return self.truth.what in covered[self.seen.step.what]


def ending_of(seen: Seen, truth: Truth) -> Ending:
    """The ending of an episode with this last step."""
    return Ending(seen, _reason(seen), truth)


def _reason(seen: Seen) -> str:
    if seen.unknown:
        return "unknown"
    if seen.step.no_class_left:
        return "no class left"
    if seen.step.gave_up:
        return "gave up"
    if seen.step.decision is None:
        return "deadline"
    return "rule" if seen.rule else "threshold"


def said(episode: int, ending: Ending) -> str:
    """The end of an episode in one or two sentences."""
    seen, truth = ending.seen, ending.truth
    taps = f"{seen.step.number} tap{'s' * (seen.step.number > 1)}"
    at = "" if ending.answer is None or ending.reason == "unknown" else f" at {seen.where_label}"
    answer = f"Episode {episode}: {ending.answer or 'no decision'}{at} after {taps} ({ending.reason})."
    known = [*filter(None, [truth.what]), *([] if truth.where is None else [_place(seen.grid, truth.where)])]
    return f"{answer} Truth: {' at '.join(known)}." if known else answer


def _place(grid: ClassGrid, where: float) -> str:
    """A position with its unit, also between two classes; in a plane it is the number of a place."""
    if grid.where_place is not None:
        return grid.where_label(int(grid.where_index(where)))
    return f"{where:.4g} {grid.where_label(0).partition(' ')[2]}".strip()


def end_record(episode: int, ending: Ending) -> dict[str, Any]:
    """The same for a program, as JSON has it."""
    step, truth = ending.seen.step, ending.truth
    return {
        "episode": episode,
        "decision": ending.answer,
        "where": float(ending.seen.grid.where_value[step.where]),
        "reason": ending.reason,
        "taps": step.number,
        "true_what": truth.what,
        "true_where": truth.where,
        "right": ending.right,
    }
