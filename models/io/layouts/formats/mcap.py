"""MCAP files of robots: topics whose messages are JSON or those of ROS 2."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, override

import numpy as np
from numpy.typing import NDArray

from ....errors import InputError, counted
from ....extras import extra
from ...mcap_file import McapFile
from ...untrusted import in_bytes
from . import objects
from .columns import Part, gathered
from .contents import Contents, TextTable, Values, Variable
from .json_lines import decoded
from .registry import ROS1

with extra("mcap"):
    from mcap.records import Channel, Message, Metadata, Schema, Statistics

_FIRST = 20  # messages of a topic that tell its fields
_BYTES = 1 << 22  # of messages that are held at a time
_NANOSECONDS = 1e9
_TIMES = ("log_time", "publish_time")


class _Field(NamedTuple):
    """Where a variable is: its topic, and its path in a row, which holds the message under an empty name."""

    topic: str
    path: objects.Path


def open_mcap(path: Path, how: TextTable, most: int | None = None) -> Contents:  # noqa: ARG001 - as the other readers
    """Messages of an MCAP file, up to its end or damage, or those of the first `most` blocks, in the order of the file.

    A topic is a group: `TOPIC/field.sub` has a row for each of its messages, as do `TOPIC/log_time` and
    `TOPIC/publish_time`, in seconds since 1970. A time of ROS is a number of seconds, too.

    Raises:
        InputError: It is no such file, or holds no messages before it is damaged.
    """
    return McapContents(path, most)


class McapContents(Contents):
    """Topics of an MCAP file; the first 20 messages of a topic tell its fields.

    Args:
        path: The file.
        most: How many blocks of messages are read, each of 4 MiB; `None` for all.
    """

    def __init__(self, path: Path, most: int | None = None) -> None:
        self.path, self.unreadable, self.most = path, {}, most
        self.variables = found = {}
        self._places: dict[str, _Field] = {}
        first: dict[str, list[Any]] = {}
        lengths: dict[str, int] = {}
        messages = _Messages(path, most)
        for topic, message, decode in messages:
            lengths[topic] = lengths.get(topic, 0) + 1
            if topic not in self.unreadable and len(rows := first.setdefault(topic, [])) < _FIRST:
                try:
                    rows.append(_row(message, decode, topic, len(rows)))
                except InputError as error:
                    self.unreadable[topic] = str(error).rstrip(".")
        for topic, rows in first.items():
            if topic not in self.unreadable:
                self._add(found, topic, rows, lengths[topic])
        self.attributes = messages.attributes
        if messages.more:
            self.unreadable[objects.REST] = f"its first {in_bytes(messages.size)} of messages tell what there is"
        if messages.lost > 0:
            self.unreadable[f"{messages.lost} messages"] = "the summary of the file counts them, but they are damaged"
            self.damage = f"{counted(messages.lost, 'message')} left out: damaged."
        if messages.lost_bytes:
            self.unreadable["the end of the file"] = f"its last {messages.lost_bytes} bytes are damaged"
            self.damage = f"The last {messages.lost_bytes} bytes left out: damaged."
        if not self.variables:
            why = "".join(f"; {name}: {reason}" for name, reason in self.unreadable.items())
            raise InputError(f"there are no messages that can be read{why}.")

    def _add(self, into: dict[str, Variable], topic: str, rows: list[Any], length: int) -> None:
        found, paths = objects.fields(rows, length)
        for field, path in paths.items():
            name = f"{topic}/{field.removeprefix('.')}"
            if name not in into:
                time = path[0] in _TIMES
                into[name] = Variable((length,), found[field].dtype, "s") if time else found[field]
                self._places[name] = _Field(topic, path)

    @override
    def clock(self, name: str) -> str | None:
        return f"{self._places[name].topic}/{_TIMES[0]}"

    @override
    def read(self, names: Sequence[str], columns: Sequence[str] = ()) -> tuple[dict[str, Values], NDArray[Any] | None]:
        asked, numbers = [[self.named(name) for name in some] for some in (names, columns)]
        topics = {self._places[name].topic for name in numbers}
        if len(topics) > 1:
            raise InputError(f"{numbers[0]} and {numbers[-1]} are not of one topic.")
        used = topics | {self._places[name].topic for name in asked}

        def parts() -> Iterator[Part]:
            for topic, start, rows in _held(_Messages(self.path, self.most), used):
                yield self._part(topic, start, rows, asked, numbers)

        return gathered(parts, list(names), len(columns))

    def _part(self, topic: str, start: int, rows: list[Any], asked: list[str], numbers: list[str]) -> Part:
        """Variables of one topic in some of its messages."""
        mine = [name for name in asked if self._places[name].topic == topic]
        columns = [self._places[name].path for name in numbers if self._places[name].topic == topic]
        names = [(self._places[name].path, self.variables[name]) for name in mine]
        found = objects.part(rows, names, columns, lambda row: _named(topic, start + row))
        values = dict(zip(mine, found.values, strict=True))
        table = found.numbers if columns else np.empty((0, len(numbers)))
        return Part([values.get(name) for name in asked], table)


class _Messages:
    """Messages of a file: topic, message, and what decodes it.

    Args:
        path: The file.
        most: How many blocks of messages are read; `None` for all.

    Attributes:
        attributes: Once read: metadata of the file.
        size: Once read: bytes of its messages.
        more: Once read: whether there are more messages than `most` blocks.
        lost_bytes: Once read: number of damaged bytes at its end.
        lost: Once read: number of messages that the summary of the file counts, but that are not there.
    """

    def __init__(self, path: Path, most: int | None) -> None:
        self._bytes = np.inf if most is None else most * _BYTES
        try:
            self._file = McapFile(path)
        except InputError as error:
            raise InputError(str(error).removeprefix(f"{path}: ")) from error
        self.attributes: dict[str, str | float] = {}
        self.lost_bytes = self.lost = self.size = 0
        self.more = False

    def __iter__(self) -> Iterator[tuple[str, Message, Callable[[Message], object]]]:
        schemas: dict[int, Schema] = {}
        channels: dict[int, tuple[str, Callable[[Message], object]]] = {}
        for record in self._file.records():
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record.topic, _decoder(record, schemas.get(record.schema_id))
            elif isinstance(record, Metadata):
                self.attributes |= {f"{record.name}.{key}": value for key, value in record.metadata.items()}
            elif isinstance(record, Statistics):
                self.lost += record.message_count
            elif isinstance(record, Message) and record.channel_id in channels:
                if self.size >= self._bytes:
                    self.more = True
                    return
                self.lost, self.size = self.lost - 1, self.size + len(record.data)
                topic, decode = channels[record.channel_id]
                yield topic, record, decode
        self.lost_bytes = self._file.lost_bytes


def _held(messages: _Messages, topics: set[str]) -> Iterator[tuple[str, int, list[Any]]]:
    """Topic, number of the first, and rows of several messages at a time."""
    held: dict[str, list[Any]] = {topic: [] for topic in topics}
    starts, size = dict.fromkeys(topics, 0), 0
    for topic, message, decode in messages:
        if topic not in topics:
            continue
        rows = held[topic]
        rows.append(_row(message, decode, topic, starts[topic] + len(rows)))
        if (size := size + len(message.data)) > _BYTES:
            yield from ((each, starts[each], rows) for each, rows in held.items() if rows)
            starts = {each: starts[each] + len(rows) for each, rows in held.items()}
            held, size = {each: [] for each in topics}, 0
    yield from ((each, starts[each], rows) for each, rows in held.items() if rows)


def _named(topic: str, row: int) -> str:
    return f"message {row + 1} of {topic}"


def _row(message: Message, decode: Callable[[Message], object], topic: str, row: int) -> dict[str, object]:
    times = (message.log_time / _NANOSECONDS, message.publish_time / _NANOSECONDS)
    try:
        return {**dict(zip(_TIMES, times, strict=True)), "": decode(message)}
    except InputError:
        raise
    except Exception as error:  # on damaged bytes the library raises almost any exception
        raise InputError(f"{_named(topic, row)} is damaged.") from error


def _decoder(channel: Channel, schema: Schema | None) -> Callable[[Message], object]:
    """What decodes the messages of a channel, or says why that is not possible."""
    encoding, written = channel.message_encoding, schema.encoding if schema else "none"
    if encoding == "json":
        return lambda message: decoded(message.data, lambda: "a message is ")
    if encoding == "ros1":
        return _refuses(ROS1)
    if (encoding, written) != ("cdr", "ros2msg"):
        return _refuses(f"messages of encoding {encoding or 'none'} with a schema of encoding {written or 'none'}")
    try:
        with extra("mcap_ros2"):
            from mcap_ros2.decoder import DecoderFactory  # noqa: PLC0415
    except InputError as error:
        return _refuses(str(error).rstrip("."))
    try:
        found = DecoderFactory().decoder_for(encoding, schema)
    except Exception:  # on damaged definitions the library raises almost any exception
        found = None
    if found is None:
        return _refuses("the definition of its messages cannot be read")
    return lambda message: _plain(found(message.data))


def _refuses(why: str) -> Callable[[Message], object]:
    def decode(_: Message) -> object:
        raise InputError(why)

    return decode


def _plain(value: Any) -> Any:
    """Dicts and lists of a message of ROS 2, and its times in seconds."""
    if isinstance(value, list):
        return [_plain(each) for each in value] if value and hasattr(value[0], "_type") else value
    if not hasattr(value, "_type"):
        return value
    names = value.__slots__
    if names == ["sec", "nanosec"]:
        return value.sec + value.nanosec / _NANOSECONDS
    return {name: _plain(getattr(value, name)) for name in names}
