"""A data collection: taps of known objects at known places, each safely recorded before the next starts."""

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
    """What a collection needs of a rig.

    Attributes:
        loop: Turned while the operator is waited for, so that readings do not pile up.
        label: What the next taps are called; the rig hands it to its journal with every press.
    """

    loop: Loop
    label: Mapping[str, Any]

    def clear(self) -> None:
        """Takes the finger off the object."""
        ...

    def go(self, x_mm: float) -> None:
        """Moves to a place along the finger, clear of the object."""
        ...

    def tap(self) -> NDArray[np.float64]:
        """The samples of one tap; when it returns, the journal has them."""
        ...


class Operator(Protocol):
    """Who puts objects under the finger: a person, or the emulator."""

    def place(self, what: int, thing: ObjectSettings) -> None:
        """Asks for an object, without waiting.

        Args:
            what: Its number in the plan.
            thing: Its name and size.
        """
        ...

    def ready(self) -> bool:
        """Whether it is there."""
        ...


class Recovered(NamedTuple):
    """A recording that goes on.

    Attributes:
        recorder: Open at its end.
        trials: The trials that it holds already.
        lost: What could not be read of it as a phrase, empty where everything could.
    """

    recorder: Recorder
    trials: frozenset[int]
    lost: str


def resume_recording(path: str | Path, about: About) -> Recovered:
    """Goes on with a recording after its last accepted tap.

    Args:
        path: The file.
        about: Rig and plan of what is to be recorded now.

    Raises:
        InputError: The file cannot be read or written, is in use, or was recorded with another rig or plan; it is as
            it was.
    """
    recorded = read_rig(path)
    if different := differences(about, recorded.about):
        raise InputError(f"{path} cannot be continued: {'; '.join(different)}.")
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
        rig: Connected.
        taps: What is still to be tapped.
        objects: The table that `what` points into.
        settle_taps: Taps after each change of the object that get no label.
        operator: Changes the objects.
        journal: Hears of every change.
        progress: Called after every tap with a label.

    Raises:
        RigError: A device failed; the rig has been brought to rest, and all taps before are recorded.
        InputError: The recording cannot be written any more.
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
