"""Data collection: labelled taps, each safely recorded before the next starts."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from ...models.errors import InputError
from ...models.io.rig import read_rig
from ...models.io.rig_recording import About, TapLabel
from ..journal import Journal
from ..link.loop import Loop
from .plan import ObjectSettings
from .recording import Recorder
from .settings import differences

_ASK_AGAIN_S = 0.05


class CollectingRig(Protocol):
    """Rig interface for a data collection.

    Attributes:
        loop: Loop to run while waiting for the operator, so that readings do not pile up.
        label: Label of the next taps; the rig passes it to its journal with every press.
    """

    loop: Loop
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
    recorded = read_rig(path)
    if different := differences(about, recorded.about):
        raise InputError(f"{path}: cannot resume the recording: {'; '.join(different)}.")
    trials = frozenset(tap.label.trial for tap in recorded.taps)
    return Recovered(Recorder.resume(path), trials, recorded.lost)


def collect(
    rig: CollectingRig,
    taps: Iterable[TapLabel],
    objects: Sequence[ObjectSettings],
    settle_taps: int,
    operator: Operator,
    journal: Journal,
    progress: Callable[[], None] = lambda: None,
) -> None:
    """Makes the taps in order.

    Args:
        rig: Rig, connected.
        taps: Labels of the taps still to be made.
        objects: Objects of the plan, indexed by `what`.
        settle_taps: Unlabelled taps after each change of object.
        operator: Changes the objects.
        journal: Journal for the changes of object.
        progress: Called after every labelled tap.

    Raises:
        RigError: A device failed; the rig is at rest and all earlier taps are recorded.
        InputError: The recording cannot be written.
    """
    present: int | None = None
    place_mm: float | None = None
    for tap in taps:
        rig.label = {}
        if tap.what != present:
            _change(rig, tap.what, objects[tap.what], operator, journal)
            rig.go(tap.where_mm)
            for _ in range(settle_taps):
                rig.tap()
        elif tap.where_mm != place_mm:
            rig.go(tap.where_mm)
        present, place_mm = tap.what, tap.where_mm
        rig.label = msgspec.to_builtins(tap)
        rig.tap()
        progress()
    rig.label = {}


def _change(rig: CollectingRig, what: int, thing: ObjectSettings, operator: Operator, journal: Journal) -> None:
    rig.clear()
    operator.place(what, thing)
    while not operator.ready():
        rig.loop.sleep(_ASK_AGAIN_S)
    journal.event(rig.loop.now, "object", f"the finger is above {thing.name}", what=what, name=thing.name)
