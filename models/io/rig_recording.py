"""Layout of a recording of the rig: an MCAP file, readable by robot log viewers.

Every message is JSON with a schema; the file has no chunks and no compression, so messages are independent.

==============  =========  ============================================================================
topic           content    when
==============  =========  ============================================================================
``/rig``        `About`    first in the file
``/frame``      `Frame`    every reading of the sensor
``/status``     `Status`   every status report of the stage
``/command``    `Command`  everything sent to a device
``/event``      `Event`    anything else; kind ``stream`` marks a restart of the readings
``/press``      `Press`    the next frame is the first after the press
``/tap``        `Tap`      the last tap is complete; has a checksum of the messages since the previous one
==============  =========  ============================================================================

The log time is the wall clock when the file was opened plus the rig time since.
"""

from typing import Any

import msgspec
from msgspec import UNSET, Struct, UnsetType

FORMAT = 1


class About(Struct, frozen=True, kw_only=True):
    """Header of a recording.

    Attributes:
        name: Name of the rig.
        sensor: Name of the sensor.
        settings: Settings of the rig, including defaults.
        text: Text of the rig's file.
        preprocessing: Preprocessing of the taps, as JSON.
        where_edges_mm: Edges of the position classes, shape (L + 1,).
        taxel_position_mm: Positions of the taxels one after the other, K times 2 or 3 numbers, or none.
        plan: Plan of the collection, if any.
        session: Number of the recording session.
        objects: Names of the objects.
        sizes_mm: Size of each object, or none.
        software: Version of this software.
        format: Version of this layout; a header without one has the first.
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
    format: int = FORMAT


class Frame(Struct, frozen=True):
    """One reading of all taxels; its attributes are those of `SkinFrame`."""

    time_s: float
    raw: list[float]
    values: list[float]
    valid: list[bool]
    device_ms: float | UnsetType = UNSET


class Status(Struct, frozen=True):
    """A status report of the stage, with its position in the rig frame if known."""

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
    """Any other event."""

    time_s: float
    kind: str
    text: str
    details: dict[str, Any]


class Press(Struct, frozen=True):
    """Start of a tap; the label has the keys of a `TapLabel`, or fewer if the tap is not to be kept."""

    time_s: float
    label: dict[str, Any]


class Tap(Struct, frozen=True):
    """Completion of the last tap.

    Attributes:
        time_s: Rig time in seconds.
        accepted: Whether its readings are plausible.
        reason: Why it was rejected; empty if accepted.
        crc: CRC-32 of the data of all messages since the previous `Tap`, excluding this one.
    """

    time_s: float
    accepted: bool
    reason: str
    crc: int


class TapLabel(Struct, frozen=True):
    """Label of a tap to be kept.

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
    """JSON schema of a message, with an object at the top level as viewers require."""
    _, components = msgspec.json.schema_components([kind])
    return msgspec.json.encode(components[kind.__name__])
