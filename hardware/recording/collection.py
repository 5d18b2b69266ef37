"""Data collection: labelled taps, each safely recorded before the next starts."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from ...models.errors import InputError
from ...models.io.rig import RigTaps, read_rig
from ...models.io.rig_recording import About, TapLabel
from ..journal import Journal
from ..link.loop import Loop
from ..rig.rig import TapTally
from .plan import ObjectSettings
from .recording import Recorder
from .settings import differences

_ASK_AGAIN_S = 0.05


class CollectingRig(Protocol):
    """Rig interface for a data collection.

    Attributes:
        loop: Loop to run while waiting for the operator, so that readings do not pile up.
        label: Label of the next taps; the rig passes it to its journal with every press.
        tally: Numbers of taps.
    """

    loop: Loop
    tally: TapTally
    label: Mapping[str, Any]

    def clear(self) -> None:
        """Lifts the finger off the object."""
        ...

    def go(self, x_mm: float) -> None:
        """Moves to a position along the finger, clear of the object."""
        ...

    def tap(self) -> NDArray[np.float64]:
        """Samples of one tap, shape (J, K); the journal has them on return."""
        ...


class Operator(Protocol):
    """Person or emulator that puts objects under the finger."""

    def place(self, what: int, thing: ObjectSettings) -> None:
        """Asks for an object, without waiting.

        Args:
            what: Index of the object in the plan.
            thing: Name and size of the object.
        """
        ...

    def ready(self) -> bool:
        """Whether the object is in place."""
        ...


class Recovered(NamedTuple):
    """A resumed recording.

    Attributes:
        recorder: Recorder, open at the end of the file.
        trials: Trials already recorded.
        lost: What could not be read, as a phrase; empty if everything was read.
    """

    recorder: Recorder
    trials: frozenset[int]
    lost: str


def resume_recording(path: str | Path, about: About) -> Recovered:
    """Resumes a recording after its last accepted tap.

    Args:
        path: The file.
        about: Current rig and plan.

    Raises:
        InputError: The file cannot be read or written, is in use, or was recorded with another rig or plan; it is left
            unchanged.
    """
    found: list[RigTaps] = []

    def check() -> None:
        found.append(read_rig(path))
        if different := differences(about, found[0].about):
            raise InputError(f"{path}: cannot resume the recording: {'; '.join(different)}.")

    recorder = Recorder.resume(path, check=check)
    return Recovered(recorder, frozenset(tap.label.trial for tap in found[0].taps), found[0].lost)


def collect(
    rig: CollectingRig,
    taps: Iterable[TapLabel],
    objects: Sequence[ObjectSettings],
    settle_taps: int,
    operator: Operator,
    journal: Journal,
    progress: Callable[[], None] = lambda: None,
    warn: Callable[[str], object] = lambda _: None,
) -> None:
    """Makes the taps in order.

    Taps that touch nothing are recorded like others, as a plan may mean some to, for example beside the object. If no
    tap of an object touched anything, that is said.

    Args:
        rig: Rig, connected.
        taps: Labels of the taps still to be made.
        objects: Objects of the plan, indexed by `what`.
        settle_taps: Unlabelled taps after each change of object.
        operator: Changes the objects.
        journal: Journal for the changes of object.
        progress: Called after every labelled tap.
        warn: Called with a sentence about an object that was never touched, unless some of its taps were made before.

    Raises:
        RigError: A device failed; the rig is at rest and all earlier taps are recorded.
        InputError: The recording cannot be written.
    """
    for number, (what, of_object) in enumerate(groupby(taps, lambda tap: tap.what)):
        place_mm, touched, whole = None, rig.tally.touched, number > 0
        for tap in of_object:
            rig.label = {}
            if place_mm is None:
                _change(rig, what, objects[what], operator, journal)
                rig.go(tap.where_mm)
                for _ in range(settle_taps):
                    rig.tap()
                whole |= tap.trial == 0
            elif tap.where_mm != place_mm:
                rig.go(tap.where_mm)
            place_mm = tap.where_mm
            rig.label = msgspec.to_builtins(tap)
            rig.tap()
            progress()
        rig.label = {}
        if whole and rig.tally.touched == touched:
            sentence = (
                f"No tap of {objects[what].name} touched anything: was it in place, does y rise towards it "
                f"(stage.y.direction), is tap.depth_mm large enough? `solidtouch rig approach` shows it."
            )
            journal.event(rig.loop.now, "no touch", sentence, what=what)
            warn(sentence)


def _change(rig: CollectingRig, what: int, thing: ObjectSettings, operator: Operator, journal: Journal) -> None:
    rig.clear()
    operator.place(what, thing)
    while not operator.ready():
        rig.loop.sleep(_ASK_AGAIN_S)
    journal.event(rig.loop.now, "object", f"the finger is above {thing.name}", what=what, name=thing.name)
