"""Recordings of the rig to a `TapSet`, cut by the same `TapCutter` as at the rig."""

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from ..cutting.tap_cutter import TapCutter
from ..errors import InputError, check_format
from ..preprocessing import Preprocessing
from ..taps import RIG_UNIT, TapSet
from .recording import naming
from .rig_reader import Entry, RecordingReader
from .rig_recording import FORMAT, About, Event, Frame, Press, Tap, TapLabel


class RecordedTap(NamedTuple):
    """An accepted, labelled tap.

    Attributes:
        label: Label of the tap.
        samples: Samples, shape (J, K).
    """

    label: TapLabel
    samples: NDArray[np.float64]


class RigTaps(NamedTuple):
    """Taps of a file, and what was lost.

    Attributes:
        about: Header of the recording.
        taps: Accepted taps.
        lost: What was lost, as a phrase; empty if nothing.
        began_ns: Start of the recording, in nanoseconds since 1970.
    """

    about: About
    taps: list[RecordedTap]
    lost: str
    began_ns: int


class _Replay:
    """Cuts the frames of a recording exactly as the rig did, or drops them.

    After damage the cutter restarts. The state of a high-pass filter, or when the first of resampled frames came, is
    then lost, and with it the taps up to the next stream.

    Args:
        preprocessing: Preprocessing of the taps.
    """

    def __init__(self, preprocessing: Preprocessing) -> None:
        self._preprocessing = preprocessing
        self._remembers = preprocessing.highpass_hz > 0 or preprocessing.sensor_hz is not None
        self._spoiled = False
        self._restart()

    def take(self, entry: Entry) -> RecordedTap | None:
        """Tap accepted by a message, or None."""
        match entry.content:
            case _ if not entry.intact:
                self._spoiled = self._remembers
                self._restart()
            case Event(kind="stream"):
                self._spoiled = False
                self._restart()
            case Frame(values=values):
                self._frames.append(values)
            case Press(label=label):
                self._push()
                self._cutter.press()
                self._label, self._samples = label, None
            case Tap(accepted=accepted):
                self._push()
                label, self._label = self._label, {}
                if accepted and self._samples is not None and not self._spoiled:
                    return _labelled(label, self._samples)
        return None

    def _restart(self) -> None:
        self._cutter = TapCutter(self._preprocessing)
        self._frames: list[list[float]] = []
        self._label: dict[str, Any] = {}
        self._samples: NDArray[np.float64] | None = None

    def _push(self) -> None:
        frames, self._frames = self._frames, []
        if not frames:
            return
        try:
            for cut in self._cutter.push(frames):
                self._samples = cut.samples
        except ValueError:  # damage changed the length of a frame; the checksum will show it
            self._restart()


def _labelled(label: dict[str, Any], samples: NDArray[np.float64]) -> RecordedTap | None:
    try:
        return RecordedTap(msgspec.convert(label, TapLabel), samples)
    except msgspec.ValidationError:
        return None


def read_rig(path: str | Path) -> RigTaps:
    """Accepted, labelled taps of a recording, in order, without a tap in progress at the end.

    Raises:
        InputError: The file cannot be read, or its header is missing.
    """
    reader = RecordingReader(path)
    with naming(path):
        entries = iter(reader)
        first = next(entries, None)
        if first is None or not isinstance(first.content, About):
            raise InputError("not a recording of the rig: the header is missing.")
        check_format(first.content.format, "a recording", FORMAT)
        taps = list(_taps(entries, Preprocessing.from_json(first.content.preprocessing)))
    return RigTaps(first.content, taps, reader.lost(), first.log_time_ns)


def _taps(entries: Iterator[Entry], preprocessing: Preprocessing) -> Iterator[RecordedTap]:
    replay = _Replay(preprocessing)
    for entry in entries:
        if (tap := replay.take(entry)) is not None:
            yield tap


def taps_from_recording(path: str | Path) -> TapSet:
    """Tap set of the labelled taps of a recording.

    Raises:
        InputError: The file cannot be read, is not a recording of the rig, or has no accepted, labelled tap.
    """
    return tapset(read_rig(path), path)


def tapset(recorded: RigTaps, path: str | Path) -> TapSet:
    """Tap set of the labelled taps of a recording, once read.

    Raises:
        InputError: There are none, or a label points outside its table.
    """
    with naming(path):
        if not recorded.taps:
            lost = f"; {recorded.lost}" if recorded.lost else ""
            raise InputError(f"the recording has no accepted, labelled tap{lost}.")
        return _labelled_set(recorded)


def _labelled_set(recorded: RigTaps) -> TapSet:
    about, taps = recorded.about, recorded.taps
    edges = np.asarray(about.where_edges_mm, dtype=np.float64)
    sizes = {tap.samples.shape[1] for tap in taps}
    if len(sizes) > 1:
        raise InputError(f"taps have different numbers of taxels, {min(sizes)} to {max(sizes)}.")
    (K,) = sizes
    positions = about.taxel_position_mm
    if len(positions) % K:
        raise InputError(f"{len(positions)} taxel coordinates do not match frames of {K} taxels.")
    labels = [tap.label for tap in taps]
    return TapSet.from_arrays(
        np.stack([tap.samples for tap in taps]),
        np.array([label.what for label in labels]),
        about.objects,
        preprocessing=Preprocessing.from_json(about.preprocessing),
        where=np.array([label.where_mm for label in labels]),
        where_value=(edges[:-1] + edges[1:]) / 2,
        where_edges=edges,
        where_unit="mm",
        what_value=about.sizes_mm or None,
        what_unit="mm" if about.sizes_mm else "",
        session=np.array([label.session for label in labels]),
        trial=np.array([label.trial for label in labels]),
        taxel_position=np.reshape(positions, (K, -1)) if positions else None,
        units=RIG_UNIT,
        sensor=about.sensor,
        source=_source(recorded),
    )


def _source(recorded: RigTaps) -> str:
    began = datetime.fromtimestamp(recorded.began_ns / 1e9, tz=UTC)
    lost = f"; {recorded.lost}" if recorded.lost else ""
    return f"recorded on {recorded.about.name}, {began:%Y-%m-%d %H:%M:%S} UTC{lost}"
