"""Journal of a rig: an interface for recording events as they happen."""

from collections.abc import Mapping
from typing import Any, Protocol

from .skin.skin import SkinFrame


class Journal(Protocol):
    """Records events; times are rig time in seconds."""

    def frame(self, frame: SkinFrame) -> None:
        """Records one reading of all taxels, as sent."""
        ...

    def status(self, time_s: float, state: str, position_mm: tuple[float, float] | None) -> None:
        """Records a status report of the stage, with its position in the rig frame if known."""
        ...

    def command(self, time_s: float, port: str, data: bytes) -> None:
        """Records bytes sent to a device."""
        ...

    def press(self, time_s: float, label: Mapping[str, Any]) -> None:
        """Records the start of a tap; the next frame is the first after the press.

        Args:
            time_s: Rig time.
            label: Label of the tap, as JSON values; empty for a tap without one.
        """
        ...

    def tap(self, time_s: float, accepted: bool, reason: str) -> None:
        """Records that the last tap is complete.

        Args:
            time_s: Rig time.
            accepted: Whether its readings are plausible.
            reason: Why it was rejected, as a phrase; empty if accepted.
        """
        ...

    def event(self, time_s: float, kind: str, text: str, **details: Any) -> None:
        """Records any other event, such as a loss or a fault.

        Args:
            time_s: Rig time.
            kind: Keyword for searches, such as `"lost"`.
            text: Description for a person.
            details: Further values, as JSON values.
        """
        ...


class NoJournal:
    """Records nothing."""

    def frame(self, frame: SkinFrame) -> None:
        """Does nothing."""

    def status(self, time_s: float, state: str, position_mm: tuple[float, float] | None) -> None:
        """Does nothing."""

    def command(self, time_s: float, port: str, data: bytes) -> None:
        """Does nothing."""

    def press(self, time_s: float, label: Mapping[str, Any]) -> None:
        """Does nothing."""

    def tap(self, time_s: float, accepted: bool, reason: str) -> None:
        """Does nothing."""

    def event(self, time_s: float, kind: str, text: str, **details: Any) -> None:
        """Does nothing."""
