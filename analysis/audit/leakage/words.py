"""Sentences about leakage."""

from collections.abc import Iterator
from typing import Literal

import numpy as np
import xarray as xr

from ...experiment.before_contact import OPTION, Before

BEFORE, OFFSET, WHOLE, TARED = "before contact", "offset", "whole taps", "tared taps"
UNJUDGED = "cannot be judged"
_NO_OFFSETS = "The subtracted offsets do not differ between classes."
_NO_BLOCKS = "Classes were not recorded in blocks."
REASSURING = (_NO_OFFSETS, _NO_BLOCKS)
"""Findings that call for no care."""

type Verdict = Literal[
    "yes", "mostly", "partly", "no", "former taps", "nothing to explain", "not enough data", "cannot be judged"
]

_GRAVEST_FIRST: tuple[Verdict, ...] = (
    "yes",
    "mostly",
    "partly",
    "former taps",
    "not enough data",
    "cannot be judged",
    "nothing to explain",
    "no",
)
_OBJECTS = {"what": "object", "where": "position", "joint": "object and position together"}


def leakage_sentences(
    told: xr.Dataset,
    before: Before,
    blocks: dict[str, dict[str, bool]],
    explains: dict[str, Verdict],
    former: float,
) -> Iterator[str]:
    """The findings, the gravest first.

    Args:
        told: See `leakage.run.Leakage`.
        before: The samples before contact.
        blocks: Whether classes were recorded in blocks, by side and session, then by quantity.
        explains: Whether leakage explains the accuracy of each quantity.
        former: Seconds for which a high-pass remembers.
    """
    for verdict in _GRAVEST_FIRST:
        names = [name for name in explains if explains[name] == verdict]
        if not names:
            continue
        if verdict == "former taps":
            yield _of_former_taps(told, names, before, former)
        elif verdict == UNJUDGED:
            yield unjudged_sentence(before)
        else:
            yield from (_finding(told.sel(quantity=name), verdict, before) for name in names)
        if verdict in ("yes", "mostly", "former taps"):
            yield from (_tared(told.sel(quantity=name), before) for name in names)
    yield from _offset_sentences(told)
    if before.samples:
        yield _before_sentence(before)
    yield from _block_sentences(blocks)


def unjudged_sentence(before: Before) -> str:
    """Why nothing can be said, and what would help."""
    begins = "Leakage cannot be assessed: taps may begin in contact"
    if before.known == "contact":
        return (
            f"{begins}, because classes differ from the second sample on, before the trigger level is reached. If the "
            f"first N samples precede contact, use {OPTION} N."
        )
    if before.lead.kind == "stretch":
        n = before.lead.samples
        return f"{begins}. Classes do not differ in the first {n} samples; if these precede contact, use {OPTION} {n}."
    if len(before.lead.change) == 1:
        return f"{begins}, with one sample per tap."
    return f"{begins}. If the first N samples of each tap precede contact, use {OPTION} N."


def _of_former_taps(told: xr.Dataset, names: list[str], before: Before, former: float) -> str:
    numbers = "; ".join(f"the {_OBJECTS[name]} {_compared(told.sel(quantity=name), before)}" for name in names)
    return (
        f"Samples before contact separate classes because they hold traces of earlier taps ({numbers}): the high-pass "
        f"filter remembers {former:.1f} s, and earlier taps were of the same or a neighbouring class. A tap then "
        "repeats part of the information of earlier taps, and carries less after a move."
    )


def _first(before: Before) -> str:
    return "the first sample" if before.samples == 1 else f"the first {before.samples} samples"


def _compared(at: xr.Dataset, before: Before) -> str:
    """Accuracies before contact, where samples are known to be, of whole taps and by chance."""
    chance = f"{_number(at, WHOLE)} from whole taps, chance {float(at['chance']):.2f}"
    return f"{_number(at, BEFORE)} from {_first(before)}, {chance}" if before.samples else chance


def _finding(at: xr.Dataset, verdict: Verdict, before: Before) -> str:
    name, numbers = _OBJECTS[str(at["quantity"].values)], _compared(at, before)
    match verdict:
        case "yes":
            return (
                f"The {name} is inferred without touch almost as well as with it ({numbers}): {_share(at)} of the "
                f"accuracy of whole taps above chance. The accuracy of the {name} on these taps is therefore not "
                "evidence of touch."
            )
        case "mostly" | "partly":
            return (
                f"The {name} is {verdict} inferred without touch ({numbers}): {_share(at)} of the accuracy of whole "
                "taps above chance."
            )
        case "nothing to explain":
            return f"Leakage of the {name} does not matter: whole taps infer it no better than chance ({numbers})."
        case "not enough data":
            return f"Leakage of the {name} cannot be assessed: there are too few test taps ({numbers})."
        case _:
            return f"The {name} is not inferred without touch ({numbers})."


def _share(at: xr.Dataset) -> str:
    row = at.sel(source=BEFORE)
    return f"{float(row['share']):.0%} ({float(row['share_low']):.0%} to {float(row['share_high']):.0%})"


def _number(at: xr.Dataset, source: str) -> str:
    row = at.sel(source=source)
    return f"{float(row['accuracy']):.2f} ({float(row['low']):.2f} to {float(row['high']):.2f})"


def _tared(at: xr.Dataset, before: Before) -> str:
    low, high = float(at["lost_low"]), float(at["lost_high"])
    name, numbers = _OBJECTS[str(at["quantity"].values)], f"{_number(at, TARED)} against {_number(at, WHOLE)}"
    level = "the first sample" if before.samples == 1 else f"the mean of {_first(before)}"
    beginning = f"With {level} of each tap subtracted, whole taps infer the {name} "
    if low > 0:
        return (
            f"{beginning}less well ({numbers}; {low:.2f} to {high:.2f} lost), so part of the accuracy depends on the "
            "level before contact."
        )
    return f"{beginning}about as well ({numbers}), so the accuracy does not depend on the level before contact alone."


def _offset_sentences(told: xr.Dataset) -> Iterator[str]:
    """What the offsets show, which the filter never sees."""
    found = told.sel(source=OFFSET)
    if np.isnan(found["accuracy"]).all():
        return
    names = [str(name) for name in told["quantity"].values if name != "joint"]
    apart = [name for name in names if found["low"].sel(quantity=name) > told["chance"].sel(quantity=name)]
    for name in apart:
        at = told.sel(quantity=name)
        yield (
            f"The subtracted offsets differ between classes: they predict the {_OBJECTS[name]} "
            f"({_number(at, OFFSET)}, chance {float(at['chance']):.2f}). The model never sees them, so they do not "
            "explain its accuracy; they suggest that classes were recorded in blocks or under lasting conditions."
        )
    if not apart:
        yield _NO_OFFSETS


def _before_sentence(before: Before) -> str:
    n = before.samples
    samples = "The first sample" if n == 1 else f"The first {n} samples"
    match before.known:
        case "press":
            return f"{samples} of each tap precede the press and therefore contact."
        case "contact":
            return f"{samples} of each tap precede the trigger level, and classes do not differ in them."
        case _:
            return f"{samples} of each tap {'precedes' if n == 1 else 'precede'} contact, as {OPTION} says."


def _block_sentences(blocks: dict[str, dict[str, bool]]) -> Iterator[str]:
    names = {"what": "object", "where": "position", "joint": "(position, object) class"}
    quantities = list(next(iter(blocks.values())))
    found = {name: [side for side, of in blocks.items() if of[name]] for name in quantities}
    for name, sides in found.items():
        if sides:
            sessions = list(dict.fromkeys(side.rpartition(" ")[2] for side in sides))
            listed = f"session{'s' * (len(sessions) > 1)} {', '.join(sessions)}"
            yield f"Recorded in blocks: in {listed} the taps of each {names[name]} are consecutive."
    if not any(found.values()):
        yield _NO_BLOCKS
