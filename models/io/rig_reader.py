"""Reader for recordings of the rig, complete or damaged.

A killed process leaves a file without a summary, and a power failure one with arbitrary bytes at its end. Everything
before the damage is read; a checksum in every `Tap` verifies the messages before it.
"""

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, NamedTuple

import msgspec
from mcap.records import Channel, Chunk, Footer, McapRecord, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC
from msgspec import Struct

from ..errors import InputError
from .rig_recording import TOPICS, Tap
from .untrusted import check_size

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


class RecordingReader:
    """Reads the messages of a file in order, up to its end or unreadable damage.

    Args:
        path: The file.

    Attributes:
        path: The file.
        finished: Once read: whether the file was closed properly.
        lost_bytes: Once read: number of bytes at the end after the last complete record.
        damaged: Once read: number of undecodable messages and of taps with a wrong checksum.

    Raises:
        InputError: The file cannot be read or is not an MCAP file.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.finished = False
        self.lost_bytes = 0
        self.damaged = 0
        try:
            with self.path.open("rb") as file:
                begin = file.read(len(MCAP0_MAGIC))
        except OSError as error:
            raise InputError(f"{path}: cannot read: {error.strerror or error}.") from error
        if not MCAP0_MAGIC.startswith(begin):
            raise InputError(f"{path}: not an MCAP file.")

    def __iter__(self) -> Iterator[Entry]:
        """Messages with a known topic."""
        self.damaged = crc = 0
        topics: dict[int, str] = {}
        for record in self._records():
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
        if self.damaged:
            which = "message before is" if self.damaged == 1 else "messages before are"
            parts.append(f"{self.damaged} {which} damaged")
        return " and ".join(parts)

    def _records(self) -> Iterator[McapRecord]:
        with self.path.open("rb") as file:
            size = self.path.stat().st_size
            whole = 0
            for record in _until_damage(self.path, file, size):
                whole = file.tell()
                self.finished = isinstance(record, Footer)
                yield record
            self.lost_bytes = max(0, size - whole - (len(MCAP0_MAGIC) if self.finished else 0))


def _until_damage(path: Path, file: IO[bytes], size: int) -> Iterator[McapRecord]:
    """Records, also those in chunks, which this software does not write.

    Raises:
        InputError: A chunk would unpack to too much.
    """
    records = iter(StreamReader(file, record_size_limit=size, emit_chunks=True).records)
    while True:
        try:
            record = next(records)
            if isinstance(record, Chunk):
                check_size(path, record.uncompressed_size)
            found = breakup_chunk(record) if isinstance(record, Chunk) else [record]
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        except Exception:  # on damaged bytes the library raises almost any exception
            return
        yield from found


def _entry(topic: str, message: Message, crc: int) -> Entry:
    try:
        content = _DECODERS[topic].decode(message.data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return Entry(topic, message.log_time, message.data, None, False)
    intact = not isinstance(content, Tap) or content.crc == crc
    return Entry(topic, message.log_time, message.data, content, intact)
