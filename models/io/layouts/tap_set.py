"""A tap set from files of any layout, by a map: read, resampled, cut and freed of useless taxels."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...blocks import over_blocks
from ...cutting.presses import Presses, presses_of_column, presses_of_events
from ...cutting.resampling import resampled_taps
from ...cutting.taxels import UsableTaxels, usable_taxels, with_taxels
from ...errors import InputError
from ...preprocessing import Preprocessing
from ...settings import Missing
from ...taps import TapSet
from ..recording import Recording
from ..streams import segment, stream_starts
from .assemble import Mapped, read_mapped
from .labels import as_known, as_numbers, label_source
from .mapping import TapMap, load_map


class MappedTaps(NamedTuple):
    """Taps from files of any layout.

    Attributes:
        taps: The taps.
        told: What was cut and left out, one sentence each.
    """

    taps: TapSet
    told: tuple[str, ...]


def load_mapped(
    sources: str | Path | Sequence[str | Path],
    how: TapMap | str | Path,
    missing: Missing = "refuse",
    folder: str | Path | None = None,
) -> MappedTaps:
    r"""Taps from files of any layout.

    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     Path(folder, "rod_4mm.csv").write_text("t;f1;f2\n0;1,5;2\n0,1;3;4\n")
    ...     how = TapMap(taxels="f*", time="t", decimal=",", tap="file", what="file:{what}_{where}.csv")
    ...     taps = load_mapped(folder, how).taps
    24
    >>> taps.taps.tolist(), taps.what_name, taps.where.tolist(), taps.where_unit
    ([[[1.5, 2.0], [3.0, 4.0]]], ['rod'], [4.0], 'mm')

    Args:
        sources: Files and folders; without labels of sessions each of them is one.
        how: The map, or its file.
        missing: What to do with samples that are NaN, see `load_taps`.
        folder: Where tables of labels are looked for beside the sources; default that of the map's file.

    Raises:
        InputError: A file or the map is missing or damaged, or they do not fit; the message names file, array or
            column, place and key of the map.
    """
    if not isinstance(how, TapMap):
        how, folder = load_map(how), Path(how).parent if folder is None else folder
    paths = [sources] if isinstance(sources, str | Path) else list(sources)
    mapped = read_mapped(paths, how, missing, folder)
    if how.trigger is None:
        taps, told = _cut_already(mapped, how), mapped.left_out
        left_out = _useless(taps, how)
        if left_out is not None:
            taps, told = with_taxels(taps, left_out.used), (*told, left_out.sentence())
    else:
        taps, told = cut_streams(mapped.recording, how, _presses(mapped, how))
    return MappedTaps(_with_origin(taps, how), tuple(filter(None, told)))


def cut_streams(recording: Recording, how: TapMap, presses: Presses | None = None) -> tuple[TapSet, tuple[str, ...]]:
    """Taps cut from streams as the map says, and what was lost, one sentence each.

    Raises:
        InputError: No tap was found, or settings contradict each other.
    """
    record = _record(recording, how)
    told: tuple[str, ...] = ()
    left_out = _dead(recording) if "dead" in how.leave_out else None  # one that is always in contact begins no tap
    if left_out is not None:
        record, told = replace(record, taxels=left_out.used), (left_out.sentence(),)
    cut = segment(recording, record, presses)
    useless = _useless(cut.taps, how)
    if useless is not None:
        used = [k for k in range(recording.samples.shape[1]) if record.taxels is None or k in record.taxels]
        told = (*told, useless.sentence([str(k) for k in used]))
        cut = segment(recording, replace(record, taxels=tuple(used[k] for k in useless.used)), presses)
    first = f"{len(cut.taps)} taps from {cut.streams} stream{'s' * (cut.streams != 1)}."
    return cut.taps, (first, *cut.lost, *told)


def _record(recording: Recording, how: TapMap) -> Preprocessing:
    """How frames become taps."""
    rate = recording.rate_hz if how.rate is None else how.rate
    if how.resample is not None and rate is None:
        raise InputError("resample (--resample) needs the rate of the recording: time (--time) or rate (--rate).")
    values: dict[str, Any] = {
        "samples": how.window,
        "rate_hz": rate if how.resample is None else how.resample,
        "tare": how.tare or "none",
        "tare_samples": how.tare_samples or 0,
        "highpass_hz": how.highpass or 0.0,
        "trigger": "press" if how.trigger in ("signal", "events") else how.trigger,
        "trigger_level": how.level or 0.0,
        "pre_samples": how.pre or 0,
        "sensor_hz": None if how.resample is None else rate,
    }
    return Preprocessing(**values)


def _presses(mapped: Mapped, how: TapMap) -> Presses | None:
    """Where presses begin, if a signal or events tell."""
    recording = mapped.recording
    if how.trigger == "signal":
        return presses_of_column(np.asarray(mapped.rises), stream_starts(recording), f"signal (--signal) {how.signal}")
    if how.trigger != "events":
        return None
    source = label_source("events", how.events or "")
    if source.kind != "table" or recording.file is None:
        raise InputError(f"events (--events) must be TABLE.csv:COLUMN, a table of times, got {how.events!r}.")
    columns = mapped.tables.columns(source.name, mapped.files[0])
    column = source.column or next(iter(columns))
    if column not in columns:
        raise InputError(f"{source.name}: no column {column!r}; columns: {', '.join(columns)[:200]}.")
    at, _ = as_numbers("events", as_known(columns[column]))
    of = _files_of_events(columns, mapped)
    return presses_of_events(
        at, "frames" if recording.time is None else "s", recording.file, time=recording.time, of=of
    )


def _files_of_events(columns: Any, mapped: Mapped) -> NDArray[np.intp] | None:
    """Number of the file of each event, by the column that names files."""
    known = {name: n for n, file in enumerate(mapped.files) for name in (file.below, file.path.name, file.path.stem)}
    for texts in columns.values():
        numbers = [known.get(str(text), -1) for text in texts.tolist()]
        if max(numbers) >= 0:
            return np.array(numbers, dtype=np.intp)
    return None


def _cut_already(mapped: Mapped, how: TapMap) -> TapSet:
    """Tap set of taps."""
    recording = mapped.recording
    if recording.is_stream:
        raise InputError(
            f"{mapped.files[0].path}: holds streams: say what a tap is with tap (--tap), or cut taps with --trigger."
        )
    samples, rate = recording.samples, recording.rate_hz
    if how.resample is None:
        record = Preprocessing(samples=samples.shape[1], rate_hz=rate)
    else:
        if rate is None:
            raise InputError("resample (--resample) needs the rate of the recording: time (--time) or rate (--rate).")
        samples = resampled_taps(samples, rate, how.resample)
        record = Preprocessing(samples=samples.shape[1], rate_hz=how.resample, sensor_hz=rate)
    return recording.labels.tapset(samples, record, mapped.missing)


def _useless(taps: TapSet, how: TapMap) -> UsableTaxels | None:
    """Taxels to be left out, if any."""
    if not how.leave_out:
        return None
    found = usable_taxels(taps, dead="dead" in how.leave_out, saturated="saturated" in how.leave_out)
    return found if found.dead or found.saturated else None


def _dead(recording: Recording) -> UsableTaxels | None:
    """Taxels of streams that have one value throughout, if some do and not all."""
    ends = [(block.min(axis=0), block.max(axis=0)) for block in over_blocks(recording.samples, lambda block, _: block)]
    low, high = np.min([low for low, _ in ends], axis=0), np.max([high for _, high in ends], axis=0)
    dead = tuple(np.flatnonzero(low == high).tolist())
    used = tuple(k for k in range(len(low)) if k not in dead)
    return UsableTaxels(used, dead, ()) if dead and used else None


def _with_origin(taps: TapSet, how: TapMap) -> TapSet:
    """The taps with their citation."""
    if how.citation is None:
        return taps
    return TapSet(taps.dataset.assign_attrs(citation=how.citation), taps.scanned)
