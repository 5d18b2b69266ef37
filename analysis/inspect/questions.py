"""Which questions a recording can answer, and what to record for those that it cannot."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.grid import FEW_TAPS, ClassGrid, can_act, sessions_alike
from ...models.taps import TapSet
from ..experiment.before_contact import before_contact, filter_memory
from ..experiment.data_warnings import FEW, blocks_of
from ..stats.detection import half_width
from .quick_fit import MOST_TAPS, QuickFit, quick_fit, too_large

type CanTell = Literal["yes", "partly", "no"]

QUESTIONS = ("single taps", "several taps", "new sessions", "moves", "beliefs")
"""Accuracy of single taps, accumulation over several, generalisation to sessions, active perception, calibration."""

WANTED_HALF_WIDTH = 0.1  # of the accuracy of single taps
WANTED_FACTOR = 2.0  # of miscalibration
FEWEST_WRONG = 1.0  # wrong decisions that beliefs imply, below which a correct model often makes none
_ALMOST_NONE = 0.1
FEW_SESSIONS = 4  # below which intervals over sessions are unreliable, see `inference.trials.resampling`
_RECORD = 20  # taps of a class and session, as in the paper
_MOSTLY = 0.5  # share of the accuracy above chance, from which on it is mostly that of samples before contact
_MOST = 1000  # taps of a class that are worth asking for
_ONE_CLASS = "There is one class; record a second object."
_UNTESTED = "No class has taps to train and to test with; record all."
_ALTERNATED = {"object": "objects", "position": "positions"}


class QuestionAnswer(NamedTuple):
    """Whether a recording can answer a question.

    Attributes:
        question: One of `QUESTIONS`.
        answer: Whether it can.
        why: What it shows, or what is missing and what to record instead, in a sentence. Those of single taps and of
            beliefs take up to two lines of a terminal of 80 columns, all others one.
    """

    question: str
    answer: CanTell
    why: str


class _Design(NamedTuple):
    """What was recorded.

    Attributes:
        grid: The classes.
        counts: Taps per session and class, shape (S, L, M).
        blocks: What was recorded in blocks: "object", "position" or "(position, object) class"; empty if nothing.
        known: Whether the leading samples are known to be before contact.
        memory: Seconds for which a high-pass remembers, which forgets drift and keeps former taps; 0 without one.
        parts: "alternate" or "run on" where trial numbers do so from session to session, else empty.
        alike: Whether sessions hold the same classes.
        large: Whether the recording is too large for a quick fit.
        fit: The quick fit; `None` where it is too large, or no class has taps to train and to test with.
    """

    grid: ClassGrid
    counts: NDArray[np.int64]
    blocks: str
    known: bool
    memory: float
    parts: str
    alike: bool
    large: bool
    fit: QuickFit | None

    @property
    def sessions(self) -> int:
        return len(self.counts)

    @property
    def each(self) -> int:
        """Taps of a class in a session where it has any, the median."""
        return int(np.median(self.counts[self.counts > 0]))

    @property
    def classes(self) -> int:
        """Classes with a tap."""
        return int(np.count_nonzero(self.counts.any(axis=0)))

    @property
    def judged(self) -> int:
        """Taps of each class on which `audit` judges beliefs, see `parts.audit_parts`."""
        return max(1, self.each // {1: 4, 2: 2}.get(self.sessions, 1))

    @property
    def alternate(self) -> str:
        """How to record without blocks."""
        return f"alternate {_ALTERNATED.get(self.blocks, 'classes')}."

    def also(self, shown: str) -> str:
        """What drift does beside `drift`, in a short sentence."""
        return f"{shown if self.blocks else 'As for single taps'}; {self.alternate}"

    @property
    def drift(self) -> str:
        """Why a class may be inferred without touch, in a sentence; empty where nothing says so."""
        fit = self.fit
        if fit is None or fit.first is None:
            return (
                f"In blocks, so drift can stand for touch; {self.alternate}" if self.blocks and not self.memory else ""
            )
        numbers = (
            f"{fit.first.accuracy:.2f} (chance {fit.whole.chance:.2f}, taps {fit.whole.accuracy:.2f}); {self.alternate}"
        )
        if self.memory:
            return f"Former taps in the first sample alone infer {numbers}" if fit.share >= _MOSTLY else ""
        if self.known:
            return f"Samples before contact alone infer {numbers}" if fit.share >= _MOSTLY else ""
        if self.blocks and fit.offset is not None and fit.offset.low > fit.offset.chance:
            return (
                f"In blocks, and subtracted offsets infer {fit.offset.accuracy:.2f} (chance {fit.offset.chance:.2f}); "
                f"{self.alternate}"
            )
        return f"In blocks, and the first sample alone infers {numbers}" if self.blocks else ""


def answers(taps: TapSet, grid: ClassGrid, counts: NDArray[np.int64]) -> tuple[QuestionAnswer, ...]:
    """The answer to each of `QUESTIONS`; the rules are in docs/how-to/recording.md.

    Args:
        taps: What was recorded.
        grid: The classes.
        counts: Taps per session and class, shape (S, L, M).
    """
    if not counts.any():
        return tuple(QuestionAnswer(name, "no", "No tap belongs to a class.") for name in QUESTIONS)
    design = _design(taps, grid, counts)
    rules = _single_taps, _several_taps, _new_sessions, _moves, _beliefs
    return tuple(QuestionAnswer(name, *next(rule(design))) for name, rule in zip(QUESTIONS, rules, strict=True))


def _design(taps: TapSet, grid: ClassGrid, counts: NDArray[np.int64]) -> _Design:
    where, what = taps.indices(grid)
    inside = (where >= 0) & (what >= 0)
    cell = (where * grid.M + what)[inside]
    blocks = blocks_of(taps, where, what, grid)
    if grid.M == 1:
        blocks.pop("object", None)
    # Without a record of samples before contact none is known, and looking for a hint would take long.
    before = before_contact(taps.select(inside), cell).samples if taps.preprocessing.pre_samples else 0
    design = _Design(
        grid,
        counts,
        next(iter(blocks), ""),
        before > 0,
        filter_memory(taps),
        divided(taps.session[inside], taps.trial[inside]),
        sessions_alike(cell, taps.session[inside]),
        too_large(taps),
        None,
    )
    return design._replace(fit=quick_fit(taps, grid, before, design.judged))


def divided(session: NDArray[np.int64], trial: NDArray[np.int64]) -> str:
    """Whether sessions seem to be parts of one recording: trial numbers count within classes, and over sessions.

    Returns:
        `"alternate"`: no number is in two sessions, but their ranges overlap; `"run on"`: each session begins with
        higher numbers than the one before ended with; empty: neither.
    """
    numbers = [np.unique(trial[session == s]) for s in np.unique(session)]
    counted = sum(map(len, numbers)) < len(trial)  # within classes, not over the session
    if len(numbers) < 2 or not counted or len(np.unique(np.concatenate(numbers))) < sum(map(len, numbers)):
        return ""
    return "run on" if all(a[-1] < b[0] for a, b in pairwise(numbers)) else "alternate"


type _Rule = Iterator[tuple[CanTell, str]]
"""Answers with their sentences, the gravest first; the first one counts."""


def _single_taps(design: _Design) -> _Rule:
    fit, most = design.fit, int(design.counts.sum(axis=0).max())
    if design.classes == 1:
        yield "no", _ONE_CLASS
    if most == 1:
        yield "no", f"Each class has one tap, none to test with; record {_RECORD}."
    if design.drift:
        yield "partly", design.drift
    train = design.counts[:-1].sum(axis=0) if design.sessions > 1 else -(-design.counts[0] // 2)
    if (each := int(np.median(train[design.counts.any(axis=0)]))) < FEW:
        yield "partly", f"{_taps(each)} per class to train with {_are(each)} too few; record {_RECORD}."
    if fit is None and not design.large:
        yield "no", _UNTESTED
    if fit is None:
        yield "yes", f"Every class has about {design.each} taps in a session."
        return
    width = half_width(fit.whole.taps)
    told = f"{_taps(fit.whole.taps)} to test with give{_s(fit.whole.taps)} ±{width:.2f}"
    if width > WANTED_HALF_WIDTH:
        yield "partly", f"{told}; record 100 or more in the last session."
    yield "yes", f"{told}."


def _several_taps(design: _Design) -> _Rule:
    fit, each = design.fit, design.each
    if design.classes == 1:
        yield "no", _ONE_CLASS
    if each == 1:
        yield "no", f"One tap per class and session; record {_RECORD} in each."
    if design.drift:
        yield "partly", design.also("Taps share their drift")
    if fit is not None and fit.most > MOST_TAPS:
        yield "partly", f"Many decisions take over {MOST_TAPS} taps; record {MOST_TAPS}, not {each}."
    if fit is not None and each < fit.most:
        need = _tens(max(FEW_TAPS, fit.most))
        yield "partly", f"90% of decisions take up to {fit.most} taps; record {need}, not {each}."
    if each < FEW_TAPS:
        yield "partly", f"{each} taps per class and session are few; record {FEW_TAPS}."
    yield "yes", f"Classes have {each} taps{'' if fit is None else f', 90% of decisions take up to {fit.most}'}."


def _new_sessions(design: _Design) -> _Rule:
    sessions = design.sessions
    if sessions == 1:
        yield "no", "One session; record every class again on another day."
    if design.parts == "alternate":
        yield "no", "Trial numbers alternate as in one recording; add a day."
    if not design.alike:
        yield "no", "Sessions differ in classes; record all in each."
    if design.parts:
        yield "partly", "Trial numbers run on as in one recording; add a day."
    if sessions < FEW_SESSIONS:
        yield "partly", f"{sessions} sessions; record {FEW_SESSIONS} or more to see how they vary."
    yield "yes", f"{sessions} sessions hold the same classes."


def _moves(design: _Design) -> _Rule:
    L, M = design.grid.shape
    filled, each = int(np.count_nonzero(design.counts.all(axis=0))), design.each
    if not can_act(design.grid):
        yield "no", f"There is one {'position' if L == 1 else 'object'}; record several."
    if 2 * filled < L * M:
        yield "no", f"{filled} of {L * M} classes have taps in all sessions; fill all."
    if each == 1:
        yield "partly", f"Moves back repeat the one tap of a class; record {_RECORD}."
    if filled < L * M:
        yield "partly", f"{L * M - filled} of {L * M} classes lack taps in a session; fill all."
    if design.drift:
        yield "partly", design.also("Drift also shows after moves")
    if each < FEW:
        yield "partly", f"Moves back repeat the {each} taps of a class; record {_RECORD}."
    yield "yes", f"All {L * M} classes have taps, {each} in a session."


def _beliefs(design: _Design) -> _Rule:
    fit, judged = design.fit, design.judged
    if design.classes == 1:
        yield "no", _ONE_CLASS
    if judged == 1:
        yield "no", f"One tap per class is left to judge on; record {_RECORD} per session."
    if fit is None and not design.large:
        yield "no", _UNTESTED
    if fit is None:
        yield "partly", "Too large for a quick estimate; see solidtouch audit."
        return
    right = fit.right
    wrong, factor = right.wrong(judged * design.classes), right.factor(judged * design.classes)
    need = fit.right_to_the_end.taps_for(WANTED_FACTOR) / design.classes
    more = f"a last session of {_tens(int(need))} taps per class" if need < _MOST else ""
    if wrong < FEWEST_WRONG:
        few = "Almost no" if wrong < _ALMOST_NONE else f"Only {wrong:.1f}"
        yield "no", f"{few} wrong decisions are implied; record {more or 'objects harder to tell apart'}."
    shows = f"Detects errors {factor:.1f} times as frequent as implied"
    if factor > WANTED_FACTOR:
        yield "partly", f"{shows}; for {WANTED_FACTOR:g} times record {more or 'objects harder to tell apart'}."
    if design.sessions == 1:
        yield "partly", f"{shows}, within this session; record two more."
    yield "yes", f"{shows}."


def _taps(number: int) -> str:
    return f"{number:,} tap{'s' * (number != 1)}"


def _are(number: int) -> str:
    return "is" if number == 1 else "are"


def _s(number: int) -> str:
    return "s" if number == 1 else ""


def _tens(number: int) -> int:
    """The next multiple of ten."""
    return -(-number // 10) * 10
