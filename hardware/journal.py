"""What happens on a rig, told as it happens to whoever keeps it."""

from collections.abc import Mapping
from typing import Any, Protocol

from .skin.skin import SkinFrame


class Journal(Protocol):
    """Keeps what happens; times are rig time in seconds."""

    def frame(self, frame: SkinFrame) -> None:
        """One reading of all taxels, as sent."""
        ...

    def status(self, time_s: float, state: str, position_mm: tuple[float, float] | None) -> None:
        """A status report of the stage, with its position in the rig frame where that is known."""
        ...

    def command(self, time_s: float, port: str, data: bytes) -> None:
        """Bytes sent to a device."""
        ...

    def press(self, time_s: float, label: Mapping[str, Any]) -> None:
        """A tap starts: the next frame is the first after the press.

        Args:
            time_s: When.
            label: What the tap is called, as JSON has it; empty for a tap that no one will look for.
        """
        ...

    def tap(self, time_s: float, accepted: bool, reason: str) -> None:
        """The tap pressed last is complete.

        Args:
            time_s: When.
            accepted: Whether its readings can be believed.
            reason: Why not, one phrase, else empty.
        """
        ...

    def event(self, time_s: float, kind: str, text: str, **details: Any) -> None:
        """Anything else worth knowing: losses, faults, the start of a tap and its end.

        Args:
            time_s: When.
            kind: A word to look for, such as `"lost"`.
            text: The sentence for a person.
            details: Values that go with it, as JSON has them.
        """
        ...


class NoJournal:
    """Keeps nothing."""

    def frame(self, frame: SkinFrame) -> None:
        """Forgets it."""

    def status(self, time_s: float, state: str, position_mm: tuple[float, float] | None) -> None:
        """Forgets it."""

    def command(self, time_s: float, port: str, data: bytes) -> None:
        """Forgets it."""

    def press(self, time_s: float, label: Mapping[str, Any]) -> None:
        """Forgets it."""

    def tap(self, time_s: float, accepted: bool, reason: str) -> None:
        """Forgets it."""

    def event(self, time_s: float, kind: str, text: str, **details: Any) -> None:
        """Forgets it."""
