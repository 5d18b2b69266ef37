"""How a recording of the rig is laid out: an MCAP file, which robot log viewers open.

Every message is JSON with a schema; the file has no chunks and no compression, so that each message is on its own.

==============  =========  ============================================================================
topic           content    when
==============  =========  ============================================================================
``/rig``        `About`    first in the file
``/frame``      `Frame`    every reading of the sensor
``/status``     `Status`   every status report of the stage
``/command``    `Command`  everything sent to a device
``/event``      `Event`    anything else; kind ``stream`` says that the readings start anew
``/press``      `Press`    the next frame is the first after the press
``/tap``        `Tap`      the tap pressed last is complete; carries a checksum of what came since the one before
==============  =========  ============================================================================

The log time is the wall clock when the file was opened plus the rig time since.
"""

from typing import Any

import msgspec
from msgspec import UNSET, Struct, UnsetType


class About(Struct, frozen=True, kw_only=True):
    """What was recorded, and how.

    Attributes:
        name: What the rig is called.
        sensor: What recorded the taps.
        settings: The settings of the rig, defaults included.
        text: The file that they come from.
        preprocessing: Record of how taps are prepared, as JSON.
        where_edges_mm: Edges of the where classes, shape (L + 1,).
        taxel_position_mm: Positions of the taxels one after the other, K times 2 or 3 numbers, or none.
        plan: The plan of the collection, if there is one.
        session: Number of the recording session.
        objects: Names of the objects.
        sizes_mm: Size of each object, or none.
        software: Version of this software.
    """

    name: str
    sensor: str
    settings: dict[str, Any]
    text: str
    preprocessing: str
    where_edges_mm: list[float]
    taxel_position_mm: list[float]
    plan: dict[str, Any]
    session: int
    objects: list[str]
    sizes_mm: list[float]
    software: str


class Frame(Struct, frozen=True):
    """One reading of all taxels; its attributes are those of `SkinFrame`."""

    time_s: float
    raw: list[float]
    values: list[float]
    valid: list[bool]
    device_ms: float | UnsetType = UNSET


class Status(Struct, frozen=True):
    """A status report of the stage, with its position in the rig frame where that is known."""

    time_s: float
    state: str
    x_mm: float | UnsetType = UNSET
    y_mm: float | UnsetType = UNSET


class Command(Struct, frozen=True):
    """Bytes sent to a device, as text with escapes and in full as hexadecimal digits."""

    time_s: float
    port: str
    text: str
    hex: str


class Event(Struct, frozen=True):
    """Anything else worth knowing."""

    time_s: float
    kind: str
    text: str
    details: dict[str, Any]


class Press(Struct, frozen=True):
    """A tap starts; the label is that of a `TapLabel`, or has fewer keys where the tap is not to be kept."""

    time_s: float
    label: dict[str, Any]


class Tap(Struct, frozen=True):
    """The tap pressed last is complete.

    Attributes:
        time_s: Rig time in seconds.
        accepted: Whether its readings can be believed.
        reason: Why not, else empty.
        crc: CRC-32 of the data of all messages since the `Tap` before, this one left out.
    """

    time_s: float
    accepted: bool
    reason: str
    crc: int


class TapLabel(Struct, frozen=True):
    """What a tap that is kept is called.

    Attributes:
        trial: Number of the tap in its session.
        what: Index of the object.
        where_mm: Commanded position in mm.
        session: Number of the recording session.
    """

    trial: int
    what: int
    where_mm: float
    session: int


TOPICS: dict[str, type[Struct]] = {
    "/rig": About,
    "/frame": Frame,
    "/status": Status,
    "/command": Command,
    "/event": Event,
    "/press": Press,
    "/tap": Tap,
}


def json_schema(kind: type[Struct]) -> bytes:
    """The JSON schema of a message, an object at its top as viewers need it."""
    _, components = msgspec.json.schema_components([kind])
    return msgspec.json.encode(components[kind.__name__])
