"""Choices that the paper leaves open, as data: the paper's statement, our default and the other options of each.

A `Reading` is one way to read the whole paper; an option is a name and the fields of the reading that it changes.
No two choices change the same field, so options of different choices combine.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

from ...inference.moves.control import default_fixation
from ...inference.reference import Border
from ...inference.trials.run import THRESHOLDS
from ...models.errors import InputError
from ...models.grid import ClassGrid
from ..experiment.settings import SHOWN_THETA

COARSE = (0.1, 0.3, 0.5, 0.7, 0.9)


@dataclass(frozen=True)
class Reading:
    """One way to read the paper; the defaults are those of this software.

    Attributes:
        power: Root of the likelihood: `"J"`, `"JK"`, `"none"` or an exponent.
        pseudocount: Counts added to bins.
        added: Which bins get them: all, or empty ones only, whose histogram is then normalised again or not.
        bins: Of a histogram.
        value_range: One range for all taxels, one each, or one for all after each taxel was standardised.
        outside: What a sample beyond the training range counts as: one in the end bin, one in an empty bin, nothing.
        border: Reading of Eq. 9.
        clamping: What happens to a move beyond the range: the finger stops at the end and the belief is shifted as
            commanded or as really moved, or the move is refused and neither moves.
        order: Whether the stop test comes before the move or after move and shift.
        deadline: Taps after which a trial ends.
        at_deadline: Whether a trial that ends so counts with its most probable classes or is left out.
        fixation: Where class of the fixation point: so many above the middle one, or an end of the range.
        read_at: Threshold at which results are read, or a grid of them of which the best counts.
        replacement: Whether test taps are drawn with replacement, or without until those of a class are used up.
        start: Starting classes drawn at random, or in turn.
        where_error: Distance between decided and true class where the sensor stands (`class`), of the decided class
            centre from the tap (`tap`), or between classes where it stood first (`start`).
        theta_x: Threshold for a move.
        highpass_hz: Of the simulated rig; recorded data stay as they are.
    """

    power: str | float = "J"
    pseudocount: float = 0.01
    added: Literal["all", "empty", "empty, not normalised"] = "all"
    bins: int = 100
    value_range: Literal["global", "taxel", "standardised"] = "global"
    outside: Literal["end bin", "empty bin", "left out"] = "end bin"
    border: Border = "uniform"
    clamping: Literal["command", "real", "refused"] = "command"
    order: Literal["before", "after"] = "before"
    deadline: int = 100
    at_deadline: Literal["most probable", "left out"] = "most probable"
    fixation: int | Literal["first", "last"] = 0
    read_at: float | tuple[float, ...] = SHOWN_THETA
    replacement: bool = True
    start: Literal["random", "in turn"] = "random"
    where_error: Literal["class", "tap", "start"] = "class"
    theta_x: float = 0.0
    highpass_hz: float = 0.1

    def fixation_index(self, L: int) -> int:
        """The where class aimed for, of L.

        Raises:
            InputError: There is no such class.
        """
        if isinstance(self.fixation, str):
            return 0 if self.fixation == "first" else L - 1
        index = default_fixation(L) + self.fixation
        if not 0 <= index < L:
            raise InputError(f"There is no where class {self.fixation:+d} from the middle one of {L} to aim for.")
        return index


class Option(NamedTuple):
    """One of the ways to settle a choice."""

    name: str
    changes: Mapping[str, Any]


@dataclass(frozen=True)
class Choice:
    """What the paper leaves open, in one respect.

    Attributes:
        name: For print.
        paper: What the paper says, with the section.
        record: File in docs/decisions that says why the default is as it is.
        default: Name of our default.
        options: The others.
        not_run: Options that are not run, with the reason.
        note: What names of options leave open; empty where nothing.
        simulated_only: Whether recorded data cannot tell.
        active_only: Whether it means anything to the active policy only.
    """

    name: str
    paper: str
    record: str
    default: str
    options: tuple[Option, ...]
    not_run: tuple[tuple[str, str], ...] = ()
    note: str = ""
    simulated_only: bool = False
    active_only: bool = False


@dataclass(frozen=True)
class Catalogue:
    """The choices that can be run on some data."""

    choices: tuple[Choice, ...]
    skipped: tuple[tuple[str, str, str], ...] = field(default=())

    @property
    def options(self) -> list[tuple[Choice, Option]]:
        """All options but the defaults, choice by choice."""
        return [(choice, option) for choice in self.choices for option in choice.options]


def changed(options: Iterable[Option], base: Reading | None = None) -> Reading:
    """The reading that takes these options and is the default in all else."""
    reading = base or Reading()
    for option in options:
        reading = replace(reading, **option.changes)
    return reading


def applicable(grid: ClassGrid, samples: int, *, simulated: bool, choices: Sequence[Choice] | None = None) -> Catalogue:
    """The choices and options that change something on data of this shape; places are named as they are there.

    Args:
        grid: The classes.
        samples: J.
        simulated: Whether the data can be simulated anew with other settings.
        choices: Those to look at; default all.
    """
    kept: list[Choice] = []
    skipped: list[tuple[str, str, str]] = []
    for choice in CHOICES if choices is None else choices:
        options = []
        for option in choice.options:
            reason = _pointless(choice, option, grid, samples, simulated)
            if reason:
                skipped.append((choice.name, option.name, reason))
            else:
                options.append(_placed(option, grid))
        if options:
            default = _placed(Option(choice.default, _default_of(options[0])), grid).name
            kept.append(replace(choice, default=default, options=tuple(options)))
    return Catalogue(tuple(kept), tuple(skipped))


def _placed(option: Option, grid: ClassGrid) -> Option:
    """The option, with the place in its name where it is about one."""
    if "fixation" not in option.changes:
        return option
    place = grid.where_label(changed([option]).fixation_index(grid.L))
    return option._replace(name=f"{option.name} ({place})")


def _default_of(option: Option) -> dict[str, Any]:
    """What the defaults are of that which an option changes."""
    return {name: getattr(Reading(), name) for name in option.changes}


def _pointless(choice: Choice, option: Option, grid: ClassGrid, samples: int, simulated: bool) -> str:
    """Why an option cannot be told from the default here; empty where it can."""
    changes = option.changes
    reasons = (
        (choice.simulated_only and not simulated, "recorded taps come as they were prepared"),
        (choice.active_only and 1 in grid.shape, "there is one position or one object"),
        ("where_error" in changes and grid.L == 1, "there is one position"),
        (changes.get("where_error") == "start" and 1 in grid.shape, "nothing moves"),
        (changes.get("power") == "none" and samples == 1, "taps of one sample have no root"),
    )
    return next((reason for holds, reason in reasons if holds), _same_place(changes.get("fixation"), grid.L))


def _same_place(fixation: int | str | None, L: int) -> str:
    """Why a fixation point is none, or another one by name only; empty where it is one."""
    if fixation is None:
        return ""
    middle = default_fixation(L)
    if isinstance(fixation, str):
        return "it is the default here" if middle == (0 if fixation == "first" else L - 1) else ""
    index = middle + fixation
    if not 0 <= index < L:
        return f"there are only {L} positions"
    return {0: "it is the first class here", L - 1: "it is the last class here"}.get(index, "")


def _options(field_name: str, values: Mapping[str, Any]) -> tuple[Option, ...]:
    return tuple(Option(name, {field_name: value}) for name, value in values.items())


def _numbers(field_name: str, values: Iterable[float], unit: str = "") -> tuple[Option, ...]:
    return _options(field_name, {f"{value:g}{unit}": value for value in values})


CHOICES: tuple[Choice, ...] = (
    Choice(
        "root of the likelihood",
        "Eq. 1 takes the geometric mean over the samples of a tap but the product over taxels, without giving a "
        "reason.",
        "2026-11-21-likelihood.md",
        "J-th",
        _options("power", {"J K-th": "JK", "none": "none", "exponent 0.1": 0.1, "exponent 0.005": 0.005}),
    ),
    Choice(
        "pseudocount",
        "Eq. 2 has none: one sample in an empty bin makes a class impossible.",
        "2026-11-21-likelihood.md",
        "0.01",
        _numbers("pseudocount", (0.0, 1e-6, 1e-3, 0.1, 1.0, 10.0)),
    ),
    Choice(
        "bins that get the pseudocount",
        "Nothing, as Eq. 2 has no pseudocount.",
        "2026-11-21-likelihood.md",
        "all",
        _options("added", {"empty, then normalised": "empty", "empty, not normalised": "empty, not normalised"}),
    ),
    Choice(
        "number of bins",
        "100 bins (below Eq. 2), without giving a reason.",
        "2026-11-21-likelihood.md",
        "100",
        _numbers("bins", (25, 50, 200)),
    ),
    Choice(
        "range of the bins",
        "“Across the full data range” (below Eq. 2), of all taxels or of each; data were “normalized” (sec. 2.3), "
        "without saying how.",
        "2026-11-21-likelihood.md",
        "all taxels",
        _options("value_range", {"each taxel": "taxel", "standardised taxels": "standardised"}),
    ),
    Choice(
        "samples beyond the range",
        "Nothing: test taps can lie beyond the training range.",
        "2026-11-21-likelihood.md",
        "end bin",
        _options("outside", {"as an empty bin": "empty bin", "left out": "left out"}),
    ),
    Choice(
        "border",
        "Beliefs from outside the range are “uniformly distributed” (below Eq. 9), without saying over what.",
        "2026-11-21-borders.md",
        "uniform over cells",
        _options(
            "border",
            {
                "uniform for each object": "uniform_what",
                "prior": "prior",
                "clamp": "clamp",
                "circular": "circular",
            },
        ),
        active_only=True,
    ),
    Choice(
        "move beyond the range",
        "Nothing; recorded taps end where the range does.",
        "2026-11-21-trials.md",
        "stop, as commanded",
        _options("clamping", {"stop, as moved": "real", "refuse": "refused"}),
        (("finger off the object", "no tap without contact was recorded"),),
        active_only=True,
    ),
    Choice(
        "stop test and move",
        "Fig. 2 and sec. 2.2 list both without their order, which matters where a move changes the belief in the "
        "object.",
        "2026-11-21-borders.md",
        "stop test first",
        _options("order", {"move first": "after"}),
        active_only=True,
    ),
    Choice(
        "deadline",
        "None; taps continue until the threshold is crossed (Eq. 7).",
        "2026-11-21-trials.md",
        "100 taps",
        _numbers("deadline", (20, 50, 200, 400), " taps"),
    ),
    Choice(
        "trials at the deadline",
        "Nothing, as there is no deadline.",
        "2026-11-21-trials.md",
        "most probable",
        _options("at_deadline", {"left out": "left out"}),
    ),
    Choice(
        "fixation point",
        "8 mm, the middle of the range (sec. 3.3), which is the boundary of two classes.",
        "2026-11-21-trials.md",
        "middle, the lower one",
        tuple(
            Option(name, {"fixation": index})
            for name, index in (
                ("first class", "first"),
                ("one class below", -1),
                ("one class above", 1),
                ("two classes above", 2),
                ("last class", "last"),
            )
        ),
        active_only=True,
    ),
    Choice(
        "threshold that is read",
        "Thresholds from 0.1 to 0.995 with unknown spacing (sec. 3.2); sec. 3.3 reports the best.",
        "2026-11-21-trials.md",
        "0.95",
        (
            *_numbers("read_at", (0.9, 0.99, 0.995)),
            Option(f"best of {len(THRESHOLDS)} thresholds", {"read_at": THRESHOLDS}),
            Option(f"best of {len(COARSE)} thresholds", {"read_at": COARSE}),
        ),
        note="The best threshold is that with the least mean object error of a policy, of "
        f"{' '.join(f'{theta:g}' for theta in THRESHOLDS)}, or of {' '.join(f'{theta:g}' for theta in COARSE)}. "
        "It is chosen on the same test taps that measure the error, so this error is slightly optimistic.",
    ),
    Choice(
        "drawing of test taps",
        "Taps are drawn from the class (sec. 3.2), without saying whether with replacement.",
        "2026-11-21-trials.md",
        "with replacement",
        _options("replacement", {"without, then anew": False}),
    ),
    Choice(
        "starting classes",
        "1000 iterations per location when passive (sec. 3.2), 1000 in all when active (sec. 3.3); the rest is open.",
        "2026-11-21-trials.md",
        "at random",
        _options("start", {"in turn": "in turn"}),
    ),
    Choice(
        "position error",
        "Absolute classification errors (sec. 3.2); 0.01 mm is less than a tap is from the centre of its class.",
        "2026-11-21-errors-and-intervals.md",
        "between classes",
        _options("where_error", {"class centre to tap": "tap", "start, by commanded moves": "start"}),
    ),
    Choice(
        "threshold for a move",
        "0 when active and 1 when passive; values between are allowed (below Eq. 8).",
        "2026-11-21-trials.md",
        "0",
        _numbers("theta_x", (0.2, 0.4, 0.6, 0.8, 0.95)),
        active_only=True,
    ),
    Choice(
        "high-pass",
        "Data were “high-pass filtered” (sec. 2.3); no cut-off.",
        "2026-11-21-preprocessing.md",
        "0.1 Hz",
        _options("highpass_hz", {"0.5 Hz": 0.5, "none": 0.0}),
        simulated_only=True,
    ),
)
"""Every choice, in the order of the paper's equations and then of its experiment."""
