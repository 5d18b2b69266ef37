"""Opens a rig from `rig.toml` and brings it back to rest."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from ..emulator.shared_clock import SharedClock, SocketConnection
from ..errors import NotAtRest, PortBusy, RigError
from ..journal import Journal
from ..link.loop import Clock, HostClock, Loop
from ..skin.fingertip import make_skin
from ..stage.stage import Stage
from .rest import never_opened, resting_place, still_pressing
from .rig import Rig
from .settings import RigFile


@contextmanager
def open_rig(settings: RigFile, journal: Journal, home: bool = False) -> Iterator[Rig]:
    """Connected rig of a file; brought to rest and closed at the end of the block in any case.

    Args:
        settings: Settings of the rig.
        journal: Journal for all events.
        home: Whether to home the stage first.

    Raises:
        RigError: A device is missing, unexpected or failing; or the finger could not be lifted off the object.
    """
    with unconnected(settings, journal) as rig, connected(rig, home):
        yield rig


@contextmanager
def unconnected(settings: RigFile, journal: Journal) -> Iterator[Rig]:
    """Rig of a file on its own clock, not connected yet.

    Raises:
        RigError: The devices are emulated, and the emulator does not answer.
    """
    with ExitStack() as stack:
        clock: Clock = HostClock()
        emulator = None
        if settings.emulator is not None:
            emulator = stack.enter_context(SocketConnection(settings.emulator.control))
            clock = SharedClock(emulator) if settings.emulator.shared_clock else clock
        rig = build_rig(settings, clock, journal)
        rig.emulator = emulator
        yield rig


def build_rig(settings: RigFile, clock: Clock, journal: Journal) -> Rig:
    """Rig of a file on a given clock, not connected yet."""
    loop = Loop(clock)
    stage = Stage(settings.stage, loop, journal)
    return Rig(settings, loop, stage, make_skin(settings.sensor, loop, journal), journal)


@contextmanager
def connected(rig: Rig, home: bool = False) -> Iterator[Rig]:
    """The rig, connected inside the block and at rest after it.

    Raises:
        RigError: As `Rig.connect` and `Rig.close`; the first failure, unless the finger may still be pressing. A note
            on any error says where the finger is.
    """
    try:
        rig.connect(home)
        yield rig
    except BaseException as trouble:
        try:
            rig.close()
        except RigError as worse:
            told = trouble if isinstance(trouble, NotAtRest) else still_pressing(trouble, worse)
            told.add_note(rig.rest)
            raise told from (None if told is trouble else trouble)
        unknown = rig.rest == resting_place()
        if isinstance(trouble, PortBusy) and unknown:
            trouble.add_note("Finger position unknown: another program drives it.")
        elif isinstance(trouble, NotAtRest) and not unknown:
            trouble.add_note(f"{rig.rest.removesuffix('.')}, after another attempt.")
        elif not never_opened(trouble, rig):
            trouble.add_note(rig.rest)
        raise
    rig.close()
