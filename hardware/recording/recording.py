"""Recorder: writes the journal of a rig to a file that stays readable if the process is killed.

Every message is passed to the system at once, so it survives the end of the process, and every tap is synced to disk,
so it survives a power failure. While a finger may be pressing, a full disk raises nothing, as the driver must first
lift the finger; the next `press` or `tap` raises the error.
"""

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
from msgspec import UNSET, Struct

from ...models.errors import InputError
from ...models.extras import extra, posix
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
from ...models.io.untrusted import in_bytes
from ...models.storage import check_writable
from ..rig.deferred_signals import signals_deferred
from ..rig.settings import RigFile
from ..skin.skin import SkinFrame

with posix("A recording of a rig"):
    import fcntl
with extra("mcap"):
    from mcap.writer import CompressionType, Writer


def _plain(value: Any) -> Any:
    """JSON value of an object that JSON lacks: lists and numbers for NumPy, text for anything else."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)


_ENCODER = msgspec.json.Encoder(enc_hook=_plain)


class Recorder:
    """A `Journal` that writes everything to an MCAP file, in the layout of `models/io/rig_recording.py`.

    `create` and `resume` open one. As a context manager it finishes the file with a summary in any case.

    Args:
        path: Path of the file, for messages.
        file: Empty file, open for writing.
        wall_ns: Nanoseconds since 1970 at the first message.

    Attributes:
        path: Path of the file.
        presses: Number of presses since it was opened.
        taps: Number of accepted, labelled taps since it was opened.
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
        """Creates a file and syncs its start, so that an unwritable disk is found at once.

        Args:
            path: The file.
            about: Rig and plan of the recording.
            wall_ns: Returns nanoseconds since 1970; called once.
            force: Whether to overwrite an existing file.

        Raises:
            InputError: The file exists, another program records to it, or it cannot be written.
        """
        path = Path(path)
        if path.suffix.lower() != ".mcap":
            raise InputError(f"{path}: the name of a recording must end in .mcap.")
        if path.is_file() and not force:
            raise InputError(f"{path}: already exists; resume the recording (--resume) or choose another name.")
        check_writable(path, force)
        try:
            if path.exists():
                _remove(path)
            file = path.open("xb")
            return _begun(lambda: cls._started(path, file, about, wall_ns()), path, file)
        except OSError as error:
            raise InputError(f"{path}: cannot write: {error.strerror or error}.") from error

    @classmethod
    def resume(
        cls, path: str | Path, wall_ns: Callable[[], int] = time.time_ns, check: Callable[[], object] = lambda: None
    ) -> Self:
        """Resumes a recording, whether or not it was finished properly.

        Its readable part is copied to a new file beside it, which replaces it once safely on disk; if anything fails
        before, the old file is unchanged.

        Args:
            path: The file.
            wall_ns: Returns nanoseconds since 1970; called once.
            check: Called before anything is written, when no other program can record to the file any more.

        Raises:
            InputError: The file cannot be read or written, is not a recording, or is in use by another program.
        """
        path = Path(path).resolve()
        entries = RecordingReader(path)
        try:
            with path.open("rb") as old:
                _lock(old, path)
                if not os.path.samestat(os.fstat(old.fileno()), path.stat()):
                    raise InputError(f"{path}: another program is recording to it.")  # it has just resumed it
                check()
                temporary = path.with_name(f".{path.name}.resumed")
                temporary.unlink(missing_ok=True)  # left by a process killed here
                file = temporary.open("xb")
                return _begun(lambda: cls._continued(path, file, temporary, entries, wall_ns()), temporary, file)
        except OSError as error:
            raise InputError(f"{path}: cannot resume the recording: {error.strerror or error}.") from error

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
            raise InputError(f"{path}: cannot resume: the description of rig and plan is missing; delete the file.")
        recorder.sync()
        shutil.copymode(path, temporary)
        temporary.replace(path)
        _sync_folder(path)
        return recorder

    def frame(self, frame: SkinFrame) -> None:
        """Records one reading of all taxels, as sent."""
        device_ms = UNSET if frame.device_ms is None else frame.device_ms
        raw, values, valid = frame.raw.tolist(), frame.values.tolist(), frame.valid.tolist()
        self._write("/frame", frame.time_s, Frame(frame.time_s, raw, values, valid, device_ms))

    def status(self, time_s: float, state: str, position_mm: tuple[float, float] | None) -> None:
        """Records a status report of the stage."""
        self._write("/status", time_s, Status(time_s, state, *(position_mm or ())))

    def command(self, time_s: float, port: str, data: bytes) -> None:
        """Records bytes sent to a device."""
        text = data.decode("ascii", "backslashreplace")
        self._write("/command", time_s, Command(time_s, port, text, data.hex()))

    def event(self, time_s: float, kind: str, text: str, **details: Any) -> None:
        """Records any other event."""
        self._write("/event", time_s, Event(time_s, kind, text, details))

    def press(self, time_s: float, label: Mapping[str, Any]) -> None:
        """Records the start of a tap.

        Raises:
            InputError: The file can no longer be written.
        """
        self._write("/press", time_s, Press(time_s, dict(label)))
        self.presses += 1
        self._labelled = "trial" in label
        self._check()

    def tap(self, time_s: float, accepted: bool, reason: str) -> None:
        """Records that the last tap is complete; it is on disk on return.

        Raises:
            InputError: The file can no longer be written.
        """
        self._write("/tap", time_s, Tap(time_s, accepted, reason, self._crc))
        self.sync()
        self.taps += accepted and self._labelled

    def sync(self) -> None:
        """Syncs all that was written to disk.

        Raises:
            InputError: The file can no longer be written.
        """
        if self._failure is None and not self._finished:
            try:
                os.fsync(self._file.fileno())
            except OSError as error:
                self._fail(error)
        self._check()

    def finish(self) -> None:
        """Finishes the file with a summary and closes it; later messages are ignored.

        Raises:
            InputError: The file could not be finished; what it holds stays readable.
        """
        if self._finished:
            return
        with signals_deferred():
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
        """Finishes the file; a failure to do so does not hide an exception from inside."""
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
        """Passes one message to the system, complete even if Ctrl-C is pressed meanwhile."""
        if self._failure is not None or self._finished:
            return
        with signals_deferred():
            try:
                self._writer.add_message(self._channels[topic], log_time_ns, data, log_time_ns, self._sequence)
                self._file.flush()
            except OSError as error:
                self._fail(error)
            self._sequence += 1
            self._crc = 0 if topic == "/tap" else zlib.crc32(data, self._crc)

    def _fail(self, error: OSError) -> None:
        self._failure = InputError(
            f"{self.path}: writing failed: {error.strerror or error}; the recording so far can be read."
        )
        self._failure.__cause__ = error

    def _check(self) -> None:
        if self._failure is not None:
            raise self._failure


def _begun[T](start: Callable[[], T], path: Path, file: IO[bytes]) -> T:
    """Result of `start`; if it fails, the new file is closed and removed."""
    try:
        return start()
    except BaseException:
        with suppress(OSError):
            file.close()
        path.unlink(missing_ok=True)
        raise


def _remove(path: Path) -> None:
    """Removes a file unless a program is recording to it."""
    with path.open("rb") as file:
        _lock(file, path)
        path.unlink()


def _lock(file: IO[bytes], path: Path) -> None:
    """Locks the file against recording by other programs while it is open.

    Raises:
        InputError: Another program is recording to it.
    """
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise InputError(f"{path}: another program is recording to it.") from error
    except OSError:  # some network disks do not support locks
        return


def _sync_folder(path: Path) -> None:
    """Syncs the name of a new file to disk."""
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


_MARGIN = 2.0  # safety factor: a journal must not fail for a few bytes
_FRAME_BYTES, _TAXEL_BYTES, _OTHER_BYTES_PER_S = 130, 18, 20_000


def space_needed(taps: int, rig: RigFile) -> int:
    """Upper estimate of the size in bytes of a recording of so many taps."""
    taxels = len(rig.sensor.order) or rig.sensor.taxels
    per_s = rig.sensor.rate_hz * (_FRAME_BYTES + _TAXEL_BYTES * taxels) + _OTHER_BYTES_PER_S
    return int(_MARGIN * taps * rig.tap.period_s * per_s)


def check_space(path: str | Path, needed: int) -> None:
    """Checks that a file of this size fits on the disk.

    Raises:
        InputError: It does not fit, or the folder does not exist.
    """
    try:
        free = shutil.disk_usage(Path(path).parent).free
    except OSError as error:
        raise InputError(f"{path}: cannot write: {error.strerror or error}.") from error
    if free < needed:
        raise InputError(f"{path}: may need {in_bytes(needed)}, but only {in_bytes(free)} are free on the disk.")
