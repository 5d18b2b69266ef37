"""Options of `convert`, one for each key of a map."""

from collections.abc import Callable
from typing import Annotated, Any, Literal

import typer

from ...models.io.layouts.mapping import Format, TimeUnit, Trigger
from .options import ReadAs

_FILES, _TEXT, _SAMPLES = "Files", "Text tables", "Samples"
_LABELS, _CUTTING, _ORIGIN = "Labels", "Cutting streams", "Origin"


def _option(
    kind: Any,
    panel: str,
    text: str,
    metavar: str | None = None,
    read: Callable[[Any], Any] = lambda value: value,
    **more: Any,
) -> Any:
    told = typer.Option(help=text, rich_help_panel=panel, metavar=metavar, show_default=False, **more)
    return Annotated[kind, told, ReadAs(read)]


def _listed(texts: list[str] | tuple[str, ...] | None) -> tuple[str, ...]:
    """Words separated by commas, of an option that may be given several times."""
    return tuple(part.strip() for text in texts or () for part in text.split(","))


def _parts(texts: list[str] | None) -> str | tuple[str, ...] | None:
    """Names separated by commas, or one; `None` for none."""
    parts = _listed(texts)
    return None if not texts else texts[0] if len(parts) == 1 else parts


def _positions(texts: list[str] | None) -> str | tuple[float | str, ...] | None:
    """Numbers or names separated by commas, or the name of an array."""
    parts = _parts(texts)
    try:
        return tuple(map(float, parts)) if isinstance(parts, tuple) else parts
    except ValueError:
        return parts


def _length(text: str) -> str | int:
    """A number of samples, or a word."""
    return int(text) if text.isdecimal() else text


_SOURCE = "COLUMN, file:PATTERN, folder:PATTERN, TABLE.csv or =TEXT"
_Text = str | None
MAP_OPTIONS: dict[str, Any] = {
    "files": _option(_Text, _FILES, "Which files below each folder, such as '{what}/*_{where}mm.csv'.", "PATTERN"),
    "format": _option(
        Format.__value__ | None,
        _FILES,
        "Format of the files, if their names do not tell.",
    ),
    "delimiter": _option(
        list[str] | None, _TEXT, "Between cells: signs, tab or blank; default: found; repeatable.", "SIGNS"
    ),
    "decimal": _option(Literal[".", ","], _TEXT, "Decimal mark; default: a point."),
    "skip_rows": _option(int, _TEXT, "Lines before the header.", "N"),
    "comment": _option(str, _TEXT, "What begins a comment, such as '#'.", "TEXT"),
    "header": _option(bool, _TEXT, "Whether the table has a header."),
    "taxels": _option(
        list[str] | None,
        _SAMPLES,
        "Columns that are taxels: names, patterns such as 'Signal*' or a slice such as 3:15; repeatable.",
        "COLUMNS",
    ),
    "taxel": _option(
        list[str] | None, _SAMPLES, "Column that says which taxel a row is of, in a long table; repeatable.", "COLUMN"
    ),
    "taps": _option(list[str] | None, _SAMPLES, "Array that holds the samples; several are side by side.", "ARRAY"),
    "axes": _option(_Text, _SAMPLES, "Its axes, such as what,trial,sample,taxel.", "AXES"),
    "tap": _option(
        list[str] | None, _SAMPLES, "Column that numbers the taps; file or row: each is one; repeatable.", "COLUMN"
    ),
    "keep": _option(_Text, _SAMPLES, "Rows or taps that are kept, such as 'valid=1' or 'force>0.2'.", "CONDITION"),
    "length": _option(
        Any, _SAMPLES, "Length of taps that differ in length: shortest, longest or N samples.", "N", parser=_length
    ),
    "align": _option(
        Literal["contact", "peak"] | None, _SAMPLES, "What falls on the same sample of all taps; see --level and --pre."
    ),
    "resample": _option(float | None, _SAMPLES, "Resample to this rate.", "HZ"),
    "leave_out": _option(
        list[str] | None, _SAMPLES, "Taxels to be left out: dead, saturated or both.", "KINDS", read=_listed
    ),
    "time": _option(_Text, _SAMPLES, "Column or array of times.", "COLUMN"),
    "time_unit": _option(TimeUnit.__value__ | None, _SAMPLES, "Unit of the times."),
    "rate": _option(float | None, _SAMPLES, "Sampling rate; default: that by --time.", "HZ"),
    "units": _option(_Text, _SAMPLES, "Unit of the samples.", "UNIT"),
    "scale": _option(float, _SAMPLES, "Factor from numbers in the file to the unit.", "X"),
    "what": _option(_Text, _LABELS, f"Object of a tap: {_SOURCE}.", "SOURCE"),
    "where": _option(
        list[str] | None, _LABELS, "Position of a tap, likewise; given twice or three times: x, y and angle.", "SOURCE"
    ),
    "session": _option(_Text, _LABELS, "Recording session of a tap, likewise, or file.", "SOURCE"),
    "trial": _option(_Text, _LABELS, "Number of a tap, likewise.", "SOURCE"),
    "what_names": _option(
        list[str] | None,
        _LABELS,
        "Names that --what indexes: NAME,NAME,... or the array that holds them.",
        "NAMES",
        read=_parts,
    ),
    "where_values": _option(
        list[str] | None,
        _LABELS,
        "Positions that --where indexes: X,X,... or NAME,NAME,... or their array.",
        "VALUES",
        read=_positions,
    ),
    "one_based": _option(bool, _LABELS, "Indices count from 1, as in MATLAB."),
    "what_value": _option(_Text, _LABELS, "Size of an object: a source, or names, as in 'rod 4 mm'.", "SOURCE"),
    "what_unit": _option(_Text, _LABELS, "Unit of the object sizes.", "UNIT"),
    "where_unit": _option(_Text, _LABELS, "Unit of the positions.", "UNIT"),
    "where_scale": _option(float, _LABELS, "Factor from numbers in the file to the unit.", "X"),
    "where_round": _option(float | None, _LABELS, "Round positions to multiples of this.", "X"),
    "extra": _option(list[str] | None, _LABELS, "Further column or array to keep; repeatable.", "COLUMN"),
    "trigger": _option(
        Trigger.__value__ | None,
        _CUTTING,
        "Start of a tap: every WINDOW frames, when a taxel reaches LEVEL, or at presses that a signal or events tell.",
    ),
    "signal": _option(
        _Text, _CUTTING, "Column or array that rises at each press, or a condition such as 'phase=press'.", "SIGNAL"
    ),
    "events": _option(
        _Text, _CUTTING, "Table of the times of presses; frames if there is no time.", "TABLE.csv:COLUMN"
    ),
    "level": _option(
        float | None,
        _CUTTING,
        "Preprocessed value that counts as contact; negative if values fall under load.",
    ),
    "window": _option(int | None, _CUTTING, "Samples per tap."),
    "pre": _option(int | None, _CUTTING, "Samples of a tap before the contact, the press or the peak.", min=0),
    "tare": _option(
        Literal["none", "stream", "tap"] | None,
        _CUTTING,
        "Subtract the mean of the first samples of the stream or of each tap.",
    ),
    "tare_samples": _option(int | None, _CUTTING, "Number of samples to average for the tare."),
    "highpass": _option(float | None, _CUTTING, "Cut-off frequency of a high-pass filter.", "HZ"),
    "sensor": _option(_Text, _ORIGIN, "Name of the sensor."),
    "source": _option(_Text, _ORIGIN, "Origin of the recording."),
    "licence": _option(_Text, _ORIGIN, "Licence of the recording."),
    "citation": _option(_Text, _ORIGIN, "How to cite it."),
}
"""Command-line options of the keys of a map."""
for _name, _annotated in MAP_OPTIONS.items():
    _words = f"--{_name.replace('_', '-')}"
    _annotated.__metadata__[0].param_decls = (f"{_words}/--no-header" if _name == "header" else _words,)
