"""What happens on a rig, kept as it happens in a file that a killed process leaves readable.

Every message is handed to the system at once, so that it survives the end of this process, and every tap is synced to
the disk, so that it survives the end of the power. While a finger may press, a full disk raises nothing: the driver
must first be able to take it off. The error comes with the next `press` or `tap`.
"""

import fcntl
import os
import shutil
import time
import zlib
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

import msgspec
import numpy as np
from mcap.writer import CompressionType, Writer
from msgspec import UNSET, Struct

from ...models.errors import InputError
from ...models.io.rig_reader import Entry, RecordingReader
from ...models.io.rig_recording import (
    TOPICS,
    About,
    Command,
    Event,
    Frame,
    Press,
    Status,
    Tap,
    json_schema,
)
from ...models.storage import check_writable
from ..rig.deferred_signals import undisturbed
from ..skin.skin import SkinFrame


def _plain(value: Any) -> Any:
    """What JSON has no word for: arrays and numbers of NumPy as such, anything else as text."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)


_ENCODER = msgspec.json.Encoder(enc_hook=_plain)


class Recorder:
    """A `Journal` that keeps everything in an MCAP file; see `models/io/rig_recording.py` for its layout.

    `create` and `resume` open one. As a context manager it ends the file with a summary, whatever happened inside.

    Args:
        path: Its name, for messages.
        file: Open for writing, empty.
        wall_ns: Nanoseconds since 1970 at the first message to come.

    Attributes:
        path: Its name.
        presses: Presses since it was opened.
        taps: Taps accepted since it was opened that have a label.
    """

    def __init__(self, path: Path, file: IO[bytes], wall_ns: int) -> None:
        self.path = path
        self.presses = 0
        self.taps = 0
        self._labelled = False
        self._file = file
        self._wall_ns = wall_ns
        self._start_s: float | None = None
        self._crc = 0
        self._sequence = 0
        self._failure: InputError | None = None
        self._finished = False
        self._writer = Writer(file, use_chunking=False, compression=CompressionType.NONE, enable_data_crcs=True)
        self._writer.start(library=f"solidtouch {version('solidtouch')}")
        self._channels = {
            topic: self._writer.register_channel(
                topic, "json", self._writer.register_schema(kind.__name__, "jsonschema", json_schema(kind))
            )
            for topic, kind in TOPICS.items()
        }

    @classmethod
    def create(
        cls, path: str | Path, about: About, wall_ns: Callable[[], int] = time.time_ns, force: bool = False
    ) -> Self:
        """Starts a new file and syncs its beginning, so that a disk that takes nothing is found out now.

        Args:
            path: The file.
            about: What is recorded.
            wall_ns: Nanoseconds since 1970, asked once.
            force: Whether an existing file may be replaced.

        Raises:
            InputError: The file exists, another program records to it, or it cannot be written.
        """
        path = Path(path)
        if path.suffix.lower() != ".mcap":
            raise InputError(f"{path} must end in .mcap, the format that it is written in.")
        if path.is_file() and not force:
            raise InputError(f"{path} exists already; --resume continues it.")
        check_writable(path, force)
        try:
            if path.exists():
                _remove(path)
            file = path.open("xb")
            return _begun(lambda: cls._started(path, file, about, wall_ns()), path, file)
        except OSError as error:
            raise InputError(f"{path} cannot be written: {error.strerror or error}.") from error

    @classmethod
    def resume(cls, path: str | Path, wall_ns: Callable[[], int] = time.time_ns) -> Self:
        """Goes on with a file, whether it was ended properly or not.

        What can be read of it is copied to a new file beside it, which takes its place once it is safely on the disk;
        if anything fails before, the old file is as it was.

        Raises:
            InputError: The file cannot be read or written, is no recording, or another program records to it.
        """
        path = Path(path).resolve()
        entries = RecordingReader(path)
        try:
            with path.open("rb") as old:
                _lock(old, path)
                if not os.path.samestat(os.fstat(old.fileno()), path.stat()):
                    raise InputError(f"{path} is being recorded by another program.")  # which has just resumed it
                temporary = path.with_name(f".{path.name}.resumed")
                temporary.unlink(missing_ok=True)  # of one that was killed here
                file = temporary.open("xb")
                return _begun(lambda: cls._continued(path, file, temporary, entries, wall_ns()), temporary, file)
        except OSError as error:
            raise InputError(f"{path} cannot be continued: {error.strerror or error}.") from error

    @classmethod
    def _started(cls, path: Path, file: IO[bytes], about: About, wall_ns: int) -> Self:
        _lock(file, path)
        recorder = cls(path, file, wall_ns)
        recorder._keep("/rig", wall_ns, _ENCODER.encode(about))
        recorder.sync()
        _sync_folder(path)
        return recorder

    @classmethod
    def _continued(cls, path: Path, file: IO[bytes], temporary: Path, entries: Iterable[Entry], wall_ns: int) -> Self:
        _lock(file, path)
        recorder = cls(path, file, wall_ns)
        for entry in entries:
            if not recorder._sequence and not isinstance(entry.content, About):
                break
            if entry.content is not None:
                recorder._keep(entry.topic, entry.log_time_ns, entry.data)
        if not recorder._sequence:
            raise InputError(f"{path} says not what was recorded, so it cannot be continued; delete it.")
        recorder.sync()
        shutil.copymode(path, temporary)
        temporary.replace(path)
        _sync_folder(path)
        return recorder

    def frame(self, frame: SkinFrame) -> None:
        """One reading of all taxels, as sent."""
        device_ms = UNSET if frame.device_ms is None else frame.device_ms
        raw, values, valid = frame.raw.tolist(), frame.values.tolist(), frame.valid.tolist()
        self._write("/frame", frame.time_s, Frame(frame.time_s, raw, values, valid, device_ms))

    def status(self, time_s: float, state: str, position_mm: tuple[float, float] | None) -> None:
        """A status report of the stage."""
        self._write("/status", time_s, Status(time_s, state, *(position_mm or ())))

    def command(self, time_s: float, port: str, data: bytes) -> None:
        """Bytes sent to a device."""
        text = data.decode("ascii", "backslashreplace")
        self._write("/command", time_s, Command(time_s, port, text, data.hex()))

    def event(self, time_s: float, kind: str, text: str, **details: Any) -> None:
        """Anything else worth knowing."""
        self._write("/event", time_s, Event(time_s, kind, text, details))

    def press(self, time_s: float, label: Mapping[str, Any]) -> None:
        """A tap starts.

        Raises:
            InputError: The file cannot be written any more.
        """
        self._write("/press", time_s, Press(time_s, dict(label)))
        self.presses += 1
        self._labelled = "trial" in label
        self._check()

    def tap(self, time_s: float, accepted: bool, reason: str) -> None:
        """The tap pressed last is complete; it is on the disk when this returns.

        Raises:
            InputError: The file cannot be written any more.
        """
        self._write("/tap", time_s, Tap(time_s, accepted, reason, self._crc))
        self.sync()
        self.taps += accepted and self._labelled

    def sync(self) -> None:
        """Has the system put all that was written on the disk.

        Raises:
            InputError: The file cannot be written any more.
        """
        if self._failure is None and not self._finished:
            try:
                os.fsync(self._file.fileno())
            except OSError as error:
                self._fail(error)
        self._check()

    def finish(self) -> None:
        """Ends the file with a summary and closes it; what comes later is forgotten.

        Raises:
            InputError: The file could not be written to its end; what it holds can be read all the same.
        """
        if self._finished:
            return
        with undisturbed():
            self._finished = True
            try:
                if self._failure is None:
                    self._writer.finish()
                    self._file.flush()
                    os.fsync(self._file.fileno())
            except OSError as error:
                self._fail(error)
            finally:
                with suppress(OSError):
                    self._file.close()
        self._check()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Ends the file; an exception from inside is not hidden by a failure to do so."""
        if error is None:
            self.finish()
        else:
            with suppress(InputError):
                self.finish()

    def _write(self, topic: str, time_s: float, content: Struct) -> None:
        if self._start_s is None:
            self._start_s = time_s
        self._keep(topic, self._wall_ns + round(1e9 * (time_s - self._start_s)), _ENCODER.encode(content))

    def _keep(self, topic: str, log_time_ns: int, data: bytes) -> None:
        """Hands one message to the system, whole even if Ctrl-C comes meanwhile."""
        if self._failure is not None or self._finished:
            return
        with undisturbed():
            try:
                self._writer.add_message(self._channels[topic], log_time_ns, data, log_time_ns, self._sequence)
                self._file.flush()
            except OSError as error:
                self._fail(error)
            self._sequence += 1
            self._crc = 0 if topic == "/tap" else zlib.crc32(data, self._crc)

    def _fail(self, error: OSError) -> None:
        self._failure = InputError(
            f"{self.path} cannot be written any more: {error.strerror or error}; what it holds so far can be read."
        )
        self._failure.__cause__ = error

    def _check(self) -> None:
        if self._failure is not None:
            raise self._failure


def _begun[T](start: Callable[[], T], path: Path, file: IO[bytes]) -> T:
    """What `start` returns; if it fails, the new file is closed and removed."""
    try:
        return start()
    except BaseException:
        with suppress(OSError):
            file.close()
        path.unlink(missing_ok=True)
        raise


def _remove(path: Path) -> None:
    """Removes a file that no program records to."""
    with path.open("rb") as file:
        _lock(file, path)
        path.unlink()


def _lock(file: IO[bytes], path: Path) -> None:
    """Keeps other programs from recording to the file for as long as it is open.

    Raises:
        InputError: Another program does.
    """
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise InputError(f"{path} is being recorded by another program.") from error
    except OSError:  # some network disks know no locks
        return


def _sync_folder(path: Path) -> None:
    """Has the system put the name of a new file on the disk."""
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
