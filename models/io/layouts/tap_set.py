"""A tap set from files of any layout, by a map: read, resampled, cut and freed of useless taxels."""

import re
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...blocks import over_blocks
from ...cutting.presses import Presses, presses_of_column, presses_of_events
from ...cutting.taxels import UsableTaxels, dead_taxels, usable_taxels, with_taxels
from ...errors import InputError, counted
from ...preprocessing import Preprocessing
from ...settings import Missing
from ...taps import TapSet
from ..joining import relabel
from ..recording import Labels, Recording, naming
from ..streams import segment, stream_starts
from .assemble import Mapped, read_mapped
from .file_rows import file_rows
from .files import SourceFile
from .label_tables import TableColumn
from .label_values import as_known
from .labels import label_source
from .mapping import TapMap, check_cutting, load_map, option
from .pieces import Piece
from .times import in_seconds, time_unit, unit_since_1970

_FRAMES = re.compile(r"(?:^|[\W_])(?:frame|sample|row|index|idx)s?$", re.IGNORECASE)
"""Names of columns of numbers of frames."""


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
    check_cutting(how)
    paths = [sources] if isinstance(sources, str | Path) else list(sources)
    mapped = read_mapped(paths, how, missing, folder)
    if how.trigger is not None:
        presses = _presses(mapped, how)
        unlabelled = 0
        if presses is not None and mapped.labels is not None and mapped.labels.of_taps:
            every, presses = presses, mapped.labels.labelled(presses)
            unlabelled = len(every.row) - len(presses.row)
        labels_of = None if mapped.labels is None else partial(mapped.labels.at, presses=presses)
        taps, told = cut_streams(mapped.recording, how, presses, labels_of)
        if unlabelled:
            told = (*told, f"{counted(unlabelled, 'press')} left out: without a label.")
    elif mapped.recording.is_stream:
        raise InputError(
            f"{mapped.files[0].path}: holds streams: say what a tap is with {option('tap')}, or cut taps with "
            f"{option('trigger')}."
        )
    else:
        taps, told = cut_already(mapped.recording, how, mapped.missing)
    return MappedTaps(relabel(taps, what_unit=how.what_unit, citation=how.citation), (*mapped.left_out, *told))


def cut_streams(
    recording: Recording,
    how: TapMap,
    presses: Presses | None = None,
    labels_of: Callable[[list[int]], Labels] | None = None,
) -> tuple[TapSet, tuple[str, ...]]:
    """Taps cut from streams as the map says, and what was cut and lost, one sentence each.

    Args:
        recording: Streams.
        how: The map.
        presses: Where presses begin, if a signal or events tell.
        labels_of: As for `segment`.

    Raises:
        InputError: No tap was found, or settings contradict each other.
    """
    record = _record(recording, how)
    told: tuple[str, ...] = ()
    left_out = _dead(recording) if "dead" in how.leave_out else None  # one that is always in contact begins no tap
    if left_out is not None:
        record, told = replace(record, taxels=left_out.used), (left_out.sentence(),)
    with naming(f"{option('trigger')} {how.trigger}"):
        cut = segment(recording, record, presses, labels_of)
        if (useless := _useless(cut.taps, how)) is not None:
            used = range(recording.samples.shape[1]) if record.taxels is None else record.taxels
            told = (*told, useless.sentence([str(k) for k in used]))
            record = replace(record, taxels=tuple(used[k] for k in useless.used))
            cut = segment(recording, record, presses, labels_of)
    return cut.taps, (*cut.told, *told)


def _record(recording: Recording, how: TapMap) -> Preprocessing:
    """How frames become taps."""
    rate = _rate(recording, how)
    values: dict[str, Any] = {
        "samples": how.window,
        "rate_hz": how.resample or rate,
        "tare": how.tare or "none",
        "tare_samples": how.tare_samples or 0,
        "highpass_hz": how.highpass or 0.0,
        "trigger": "press" if how.trigger in ("signal", "events") else how.trigger,
        "trigger_level": how.level or 0.0,
        "pre_samples": how.pre or 0,
        "sensor_hz": None if how.resample is None else rate,
    }
    rates = [option(key) for key in ("resample", "highpass") if getattr(how, key)]
    with naming(", ".join(rates)) if rates else nullcontext():
        return Preprocessing(**values)


def _rate(recording: Recording, how: TapMap) -> float | None:
    """Rate of the recording in hertz, which filters need."""
    rate = recording.rate_hz if how.rate is None else how.rate
    for key in ("resample", "highpass"):
        if getattr(how, key) and rate is None:
            raise InputError(f"{option(key)} requires the rate of the recording: {option('time')} or {option('rate')}.")
    return rate


def _presses(mapped: Mapped, how: TapMap) -> Presses | None:
    """Where presses begin, if a signal or events tell."""
    recording = mapped.recording
    if how.trigger == "signal":
        name = f"{option('signal')} {how.signal}"
        if mapped.rises is not None and mapped.rises.shape != (frames := len(recording.samples),):
            raise InputError(f"{name}: has shape {mapped.rises.shape}, expected one value for each of {frames} frames.")
        return presses_of_column(np.asarray(mapped.rises), stream_starts(recording), name)
    if how.trigger != "events":
        return None
    with naming(option("events")):
        if recording.file is None or mapped.labels is None:
            raise InputError("presses are in streams, but these files hold taps.")
        at, name, stated, of = _events(mapped, mapped.labels.pieces, how)
        if len(at) == len(recording.samples):
            raise InputError(f"{name} has a value for each frame, so it is not the times of presses.")
        in_frames = recording.time is None or _FRAMES.search(name) is not None
        unit = time_unit(name, stated) or unit_since_1970(at) or mapped.labels.pieces[0].time_unit
        at = in_seconds("events", name, at, "s" if in_frames or not unit else unit)
        if not in_frames:
            return presses_of_events(at, recording.file, time=recording.time, of=of)
        if how.one_based:
            at = at - 1
        if how.keep is not None and recording.row is not None:  # frames are numbered before some are left out
            at = np.where((at < 0) | (at != np.round(at)), np.nan, at)
            return presses_of_events(at, recording.file, time=recording.row.astype(np.float64), of=of)
        return presses_of_events(at, recording.file, of=of)


def _events(
    mapped: Mapped, pieces: Sequence[Piece], how: TapMap
) -> tuple[NDArray[Any], str, str, NDArray[np.intp] | None]:
    """Times or frames of presses, the name and the unit of their column or array, and the file of each if known."""
    source = label_source("events", how.events or "")
    if source.kind != "table":
        parts = [piece.tables["events"].reshape(-1) for piece in pieces]
        of = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
        return as_known(np.concatenate(parts)), source.name, pieces[0].label_units.get("events", ""), of
    columns = [mapped.tables.column(source, file) for file in mapped.files]
    tables = {column.path: column for column in columns}
    whose = {path: [n for n, of in enumerate(columns) if of.path == path] for path in tables}
    at = as_known(np.concatenate([column.values for column in tables.values()]))
    files = [_files_of_events(column, mapped.files, whose[path]) for path, column in tables.items()]
    known = [of for of in files if of is not None]
    return at, columns[0].name, columns[0].unit, np.concatenate(known) if len(known) == len(files) else None


def _files_of_events(
    column: TableColumn, files: Sequence[SourceFile], numbers: Sequence[int]
) -> NDArray[np.intp] | None:
    """Number of the file of each event of a table of some files, -1 for that of none; `None` if nothing tells."""
    of = np.full(len(column.values), -1)
    if len(numbers) == 1 < len(files):
        of[:] = numbers[0]
    found = file_rows(column.texts_beside, [files[number] for number in numbers]).rows
    for number in numbers if found else ():
        of[found[files[number].path]] = number
    return of if (of >= 0).any() else None


def cut_already(recording: Recording, how: TapMap, missing: Missing) -> tuple[TapSet, tuple[str, ...]]:
    """Taps that need no cutting, resampled and freed of taxels as the map says, and what was left out.

    Args:
        recording: Taps.
        how: The map.
        missing: What to do with samples that are NaN, see `load_taps`.

    Raises:
        InputError: The recording holds streams, or the map does not fit it.
    """
    rate = _rate(recording, how)
    if how.resample is None or rate is None or recording.is_stream:
        return without_useless(replace(recording, rate_hz=rate).tapset(missing), how)
    from ...cutting.resampling import resampled_taps  # noqa: PLC0415 - numba takes a quarter of a second to import

    with naming(option("resample")):
        samples = resampled_taps(recording.samples, rate, how.resample)
    record = Preprocessing(samples=samples.shape[1], rate_hz=how.resample, sensor_hz=rate)
    return without_useless(recording.labels.tapset(samples, record, missing), how)


def without_useless(taps: TapSet, how: TapMap) -> tuple[TapSet, tuple[str, ...]]:
    """Taps without the taxels that the map leaves out, and which these are, in a sentence.

    Raises:
        InputError: No taxel would be left, or the taps were cut at contact.
    """
    useless = _useless(taps, how)
    if useless is None:
        return taps, ()
    with naming(option("leave_out")):
        return with_taxels(taps, useless.used), (useless.sentence(),)


def _useless(taps: TapSet, how: TapMap) -> UsableTaxels | None:
    """Taxels to be left out, if any."""
    if not how.leave_out:
        return None
    with naming(option("leave_out")):
        found = usable_taxels(taps, dead="dead" in how.leave_out, saturated="saturated" in how.leave_out)
    return found if found.dead or found.saturated else None


def _dead(recording: Recording) -> UsableTaxels | None:
    """Taxels of streams that have one value throughout or none, if some do and not all."""
    ends = over_blocks(recording.samples, lambda block, _: [np.fmin.reduce(block), np.fmax.reduce(block)])
    dead = dead_taxels(np.array(list(ends)))
    used = tuple(k for k in range(recording.samples.shape[1]) if k not in dead)
    return UsableTaxels(used, dead, ()) if dead and used else None
