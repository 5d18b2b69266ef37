"""Reader for recordings of the rig, complete or damaged.

A checksum in every `Tap` verifies the messages before it.
"""

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import msgspec
from msgspec import Struct

from ..extras import extra
from .mcap_file import McapFile
from .rig_recording import TOPICS, Tap

with extra("mcap"):
    from mcap.records import Channel, Message

_DECODERS = {topic: msgspec.json.Decoder(kind) for topic, kind in TOPICS.items()}


class Entry(NamedTuple):
    """One message of a recording.

    Attributes:
        topic: Topic.
        log_time_ns: Nanoseconds since 1970.
        data: Raw bytes.
        content: Decoded message, None if it cannot be decoded.
        intact: Whether it can be decoded and, for a `Tap`, its checksum matches the messages before it.
    """

    topic: str
    log_time_ns: int
    data: bytes
    content: Struct | None
    intact: bool


class RecordingReader(McapFile):
    """Reads the messages of a file in order, up to its end or unreadable damage.

    Args:
        path: The file.

    Attributes:
        damaged: Once read: number of undecodable messages and of taps with a wrong checksum.

    Raises:
        InputError: The file cannot be read or is not an MCAP file.
    """

    def __init__(self, path: str | Path) -> None:
        super().__init__(path)
        self.damaged = 0

    def __iter__(self) -> Iterator[Entry]:
        """Messages with a known topic."""
        self.damaged = crc = 0
        topics: dict[int, str] = {}
        for record in self.records():
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message) and record.channel_id not in topics:
                self.damaged += 1
            elif isinstance(record, Message) and (topic := topics[record.channel_id]) in TOPICS:
                entry = _entry(topic, record, crc)
                self.damaged += not entry.intact
                crc = 0 if topic == "/tap" else zlib.crc32(record.data, crc)
                yield entry

    def lost(self) -> str:
        """What was lost, as a phrase, empty if nothing; once read."""
        parts = []
        if self.lost_bytes:
            parts.append(f"the last {self.lost_bytes} bytes are damaged")
        damaged = self.damaged + self.misplaced
        if damaged:
            which = "message before is" if damaged == 1 else "messages before are"
            parts.append(f"{damaged} {which} damaged")
        return " and ".join(parts)


def _entry(topic: str, message: Message, crc: int) -> Entry:
    try:
        content = _DECODERS[topic].decode(message.data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return Entry(topic, message.log_time, message.data, None, False)
    intact = not isinstance(content, Tap) or content.crc == crc
    return Entry(topic, message.log_time, message.data, content, intact)
