"""One recording from the pieces of files that a map describes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...cutting.ragged import EvenTaps, even_taps
from ...cutting.sampling_rate import common_rate
from ...errors import InputError, counted
from ...settings import Missing
from ..recording import Recording, changed, concatenated, naming
from .files import SourceFile, source_files, unmatched
from .gathering import with_all_taxels, with_ordered_labels
from .joined_labels import joined_labels
from .label_tables import LabelTables
from .labels import label_source
from .mapping import TapMap, option
from .pieces import Piece, pieces
from .stream_labels import StreamLabels
from .times import told_of_times

_SAME_RATE = 0.02
"""Rates of two files that differ by less in proportion are one: clocks of computers jitter."""


class Mapped(NamedTuple):
    """A recording as a map describes it.

    Attributes:
        recording: Taps or streams.
        missing: Whether samples are NaN, where taps that end earlier were filled.
        left_out: Files and taps that were left out, and how tables of labels were read, one sentence each.
        rises: For streams, the signal that rises at each press, shape (S,); `None` without.
        labels: For streams, those of the taps that are cut from them.
        files: The file of each piece; those of streams are numbered by these.
        tables: Tables beside the files.
    """

    recording: Recording
    missing: Missing
    left_out: tuple[str, ...]
    rises: NDArray[Any] | None
    labels: StreamLabels | None
    files: tuple[SourceFile, ...]
    tables: LabelTables


def read_mapped(
    sources: Sequence[str | Path], how: TapMap, missing: Missing = "refuse", folder: str | Path | None = None
) -> Mapped:
    """Taps or streams of files as a map describes them.

    Args:
        sources: Files and folders; without labels of sessions each of them is one.
        how: The map.
        missing: What to do with samples that are NaN, see `load_taps`.
        folder: Where tables of labels are looked for, that of the map.

    Raises:
        InputError: A file is missing or damaged, does not hold what the map says, or does not go with another; the
            message names file, array or column, and place, and the key of the map.
    """
    paths = [Path(source) for source in sources]
    files = source_files(paths, how)
    beside = [path if path.is_dir() else path.parent for path in paths]
    events = label_source("events", how.events or "")
    beside = [*([] if folder is None else [Path(folder)]), *dict.fromkeys(beside)]
    texts = filter(None, (*how.label_texts.values(), how.what_value, *how.extra))
    labels = {(of.name, of.column or of.key) for of in (label_source("label", text) for text in texts)}
    tables = LabelTables(beside, how.text_table, files, labels=labels, events=events.name, time=how.time or "")
    found = with_all_taxels(list(pieces(files, how, tables, missing)))
    found = with_ordered_labels(found, of_taps=how.trigger is not None)
    if not sum(piece.rows for piece in found):
        raise InputError(
            f"{paths[0]}: no taps{'' if how.keep is None else f' that {option("keep")} {how.keep!r} keeps'}."
        )
    found = [piece for piece in found if piece.rows]
    even, rate = _joined(found, how), how.rate or _common_rate(found)
    whose = tuple(piece.file for piece in found)
    of_files = dict.fromkeys(sentence for piece in found for sentence in piece.told)

    def told() -> tuple[str, ...]:
        return (*unmatched(paths, files, how), *of_files, *tables.told.values(), *_told_of_times(found, how, rate))

    if even is not None:
        ends = np.cumsum([piece.rows for piece in found])
        parts = np.split(even.kept, np.searchsorted(even.kept, ends[:-1]))
        begins = ends - [piece.rows for piece in found]
        some = [piece.labels_at(rows - begin) for piece, rows, begin in zip(found, parts, begins, strict=True)]
        kept = Recording(even.samples, joined_labels([each for each in some if each.rows], how, tables), rate)
        return Mapped(kept, even.missing, (*told(), *even.left_out), None, None, whose, tables)
    samples = _scaled(concatenated([np.asanyarray(piece.signal.samples) for piece in found]), how)
    if samples.ndim == 3:
        recording = Recording(samples, joined_labels(found, how, tables), rate)
        return Mapped(recording, missing, told(), None, None, whose, tables)
    labels = StreamLabels.of(found, how, tables, rate)
    file = np.repeat(np.arange(len(found)), [piece.rows for piece in found])
    times = [piece.time_s for piece in found if piece.time_s is not None]
    time = np.concatenate(times) if len(times) == len(found) else None
    row = np.concatenate([piece.row for piece in found])
    rises = None if how.signal is None else np.concatenate([np.asarray(piece.rises) for piece in found])
    return Mapped(
        Recording(samples, labels.frames, rate, file, time=time, row=row), missing, told(), rises, labels, whose, tables
    )


def _joined(found: Sequence[Piece], how: TapMap) -> EvenTaps | None:
    """Taps of one length, where the map says how to make them so; `None` where nothing has to be done."""
    first = found[0]
    for piece in found:
        with naming(piece.file.path):
            if piece.signal.cut != first.signal.cut:
                raise InputError(f"holds {_kind(piece)}, {first.file.path} {_kind(first)}.")
            if _taxels(piece) != _taxels(first):
                raise InputError(f"{_taxels(piece)} taxels, but {_taxels(first)} in {first.file.path}.")
    if not first.signal.cut:
        if how.align or how.length:
            key = "align" if how.align else "length"
            raise InputError(f"{option(key)} is for taps; these files hold streams, which --trigger cuts.")
        return None
    every = {len(tap) for piece in found for tap in piece.signal.samples}
    lengths = every - {0} or every
    if how.align is None and how.length is None and (len(lengths) > 1 or lengths == every):
        if len(lengths) > 1:
            raise InputError(
                f"taps have {min(lengths)} to {max(lengths)} samples; say their length with length (--length): "
                "shortest, longest or a number."
            )
        return None
    taps = [_scaled(np.asarray(tap), how) for piece in found for tap in piece.signal.samples]
    length = how.length or "shortest"
    align, short = how.align or "none", "leave out" if isinstance(length, int) else "fill"
    with naming(option("align" if how.align else "length")):
        return even_taps(taps, length, align=align, level=how.level or 0.0, pre=how.pre or 0, short=short)


def _scaled(samples: NDArray[Any], how: TapMap) -> NDArray[np.floating]:
    return samples if how.scale == 1 else changed(samples, lambda block: block * how.scale, samples.dtype)


def _kind(piece: Piece) -> str:
    return "taps" if piece.signal.cut else "a stream"


def _taxels(piece: Piece) -> int:
    return int(np.asarray(piece.signal.samples[0]).shape[-1]) if piece.rows else 0


def _told_of_times(found: Sequence[Piece], how: TapMap, rate: float | None) -> list[str]:
    """What to check of times that are uneven, or whose unit the map does not say, one sentence each."""
    timed = next((piece for piece in found if piece.time_s is not None), None)
    told = [] if how.rate is not None or rate is None else _told_of_steps(found, rate)
    if timed is None or timed.time_s is None or how.time_unit is not None:
        return told
    return [*told, *told_of_times(timed.time_s, timed.time_unit, rate if how.rate is None else None)]


def _told_of_steps(found: Sequence[Piece], rate: float) -> list[str]:
    """That times are uneven, in a sentence, if they are."""
    uneven = {piece.file.path: piece.pace.uneven for piece in found if piece.pace is not None and piece.pace.uneven}
    if not uneven:
        return []
    path, *others = uneven
    (short, long), more = uneven[path], f" and {counted(len(others), 'more file')}" if others else ""
    return [
        f"{path}{more}: steps of {option('time')} are {1e3 * short:.3g} to {1e3 * long:.3g} ms, but samples are taken "
        f"as even, at {rate:g} Hz, also by {option('resample')}; interpolate uneven ones in the files before."
    ]


def _common_rate(found: Sequence[Piece]) -> float | None:
    """Rate of all pieces."""
    timed = [(piece.file.path, piece.pace) for piece in found if piece.pace is not None]
    if not timed:
        return None
    rate, chance = common_rate([pace for _, pace in timed])
    path, first = timed[0]
    for (other, pace), by_chance in zip(timed, chance, strict=True):
        if abs(first.period_s / pace.period_s - 1) > max(_SAME_RATE, by_chance):
            raise InputError(
                f"{other}: {1 / pace.period_s:.4g} samples per second, {path} {1 / first.period_s:.4g}. If they are of "
                "one rate, say it with --rate; else convert files of each rate alone, with one --resample, and then "
                "these together: solidtouch convert a.nc b.nc all.nc."
            )
    return rate
