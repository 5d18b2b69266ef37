"""The map of a recording: which files, which arrays or columns are samples, and where the labels stand.

`docs/reference/maps.md` lists the keys; a map is a TOML file with these keys, and each is an option of `convert`.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from msgspec import Meta
from msgspec.structs import force_setattr

from ...errors import InputError
from ...settings import Checked, SettingError, wanted
from ..toml import parse_settings, read_settings

if TYPE_CHECKING:
    from .formats.contents import TextTable

type Format = Literal["text", "npy", "npz", "mat", "hdf5", "netcdf", "zarr", "parquet", "arrow", "jsonl", "mcap"]
type TimeUnit = Literal["s", "ms", "us", "ns"]
type Trigger = Literal["clock", "contact", "signal", "events"]
type Useless = Literal["dead", "saturated", "both"]
type Length = Literal["shortest", "longest"] | Annotated[int, Meta(ge=1, le=10**9)]
type Names = Annotated[str | tuple[str, ...], wanted("a name or a list of names")]

AXES = ("tap", "sample", "taxel", "what", "where", "session", "trial")
LABELS = ("what", "where", "session", "trial")
CUTTING = ("trigger", "level", "window", "pre", "tare", "tare_samples", "highpass", "resample", "leave_out")
_CUTTING_ALONE = ("window", "tare", "tare_samples", "highpass", "signal", "events")
ORIGIN = ("sensor", "source", "licence", "citation")
EXTRA = "extra:"
"""What the key of a further array begins with, which may be called like a label."""
PLANE = ("x", "y", "angle")
"""What a position in a plane consists of; the angle may be left out."""
_Positive = Annotated[float, wanted("a positive number", gt=0, le=1e12)]
_Number = Annotated[float, wanted("a number", ge=-1e12, le=1e12)]
_Count = Annotated[int, wanted("a number of samples", ge=0, le=10**9)]


def option(key: str) -> str:
    """A key of the map and its option, for messages; of an axis of a plane or a further array those of its list.

    >>> option("what_value"), option("x"), option("extra:temperature")
    ('what_value (--what-value)', 'where (--where) x', 'extra (--extra) temperature')
    """
    if key in TapMap.__struct_fields__:
        return f"{key} (--{key.replace('_', '-')})"
    return f"where (--where) {key}" if key in PLANE else f"extra (--extra) {key.removeprefix(EXTRA)}"


class TapMap(Checked, frozen=True, kw_only=True):
    """A map; every key may be left out, see docs/reference/maps.md.

    >>> TapMap(taxels="Signal*", what="file:{what}_*.csv", tap="file").tap
    'file'

    Attributes:
        files: Pattern of the files below a folder.
        format: Of the files, where their names do not tell.
        delimiter: Of text tables, as `TextTable`; likewise the next four.
        decimal: Decimal mark.
        skip_rows: Lines before the header.
        comment: What begins a comment.
        header: Whether there is a header.
        taxels: Columns that are taxels, or a slice of the taxels of `taps`.
        taxel: Column that says which taxel a row is of, where each sample of each taxel has one, or several that do.
        taps: Array of the samples.
        axes: Its axes, separated by commas.
        tap: Column that numbers the taps, or several, `"file"` or `"row"`; `"restart:COLUMN"` or `"ends:ARRAY"`.
        keep: Which rows or taps are kept, by a column.
        time: Column or array of times.
        time_unit: Its unit.
        rate: Samples per second.
        what: Where the object of a tap stands.
        where: Where its position stands, or two or three sources of a position in a plane.
        session: Where its session stands.
        trial: Where its number stands.
        what_names: Names that `what` indexes.
        where_values: Positions that `where` indexes, or their names in order.
        one_based: Whether these indices count from 1.
        what_value: Where the sizes of objects stand.
        what_unit: Unit of the sizes.
        where_unit: Unit of the positions.
        where_scale: Factor from numbers in the file to `where_unit`.
        where_round: Positions are rounded to a multiple of this, in `where_unit`.
        units: Unit of the samples.
        scale: Factor from numbers in the file to `units`.
        extra: Further columns or arrays that are kept, one value for each tap.
        length: Of all taps, where they differ in length.
        align: What falls on the same sample of all taps.
        resample: Rate in hertz that samples are resampled to.
        leave_out: Kinds of taxels that are left out.
        trigger: Start of a tap in a stream: as in `Preprocessing`, or a press by a signal or a table of events.
        signal: Column or array that rises at each press.
        events: Table or array of the times of presses, or of their frames where no time is known.
        level: Preprocessed value that counts as contact.
        window: Samples of a tap.
        pre: Samples before contact.
        tare: What is subtracted.
        tare_samples: Samples averaged for it.
        highpass: Cut-off frequency in hertz.
        sensor: Name of the sensor.
        source: Origin of the recording.
        licence: Its licence.
        citation: How to cite it.

    Raises:
        SettingError: A value is out of range.
    """

    files: str | None = None
    format: Format | None = None
    delimiter: Names | None = None
    decimal: Annotated[Literal[".", ","], wanted("a point or a comma")] = "."
    skip_rows: Annotated[int, wanted("an integer from 0 to 1000000", ge=0, le=10**6)] = 0
    comment: str = ""
    header: bool = True
    taxels: Names | None = None
    taxel: Names | None = None
    taps: Names | None = None
    axes: str | None = None
    tap: Names | None = None
    keep: str | None = None
    time: str | None = None
    time_unit: Annotated[TimeUnit | None, wanted("s, ms, us or ns")] = None
    rate: _Positive | None = None
    what: str | None = None
    where: Names | None = None
    session: str | None = None
    trial: str | None = None
    what_names: Names | None = None
    where_values: Annotated[str | tuple[float | str, ...], wanted("a list of positions, or their array")] | None = None
    one_based: bool = False
    what_value: str | None = None
    what_unit: str | None = None
    where_unit: str | None = None
    where_scale: _Number = 1.0
    where_round: _Positive | None = None
    units: str | None = None
    scale: _Number = 1.0
    extra: Names = ()
    length: Annotated[Length | None, wanted("shortest, longest or a number of samples")] = None
    align: Annotated[Literal["contact", "peak"] | None, wanted("contact or peak")] = None
    resample: _Positive | None = None
    leave_out: Annotated[Useless | tuple[Useless, ...], wanted("dead, saturated or both")] = ()
    trigger: Annotated[Trigger | None, wanted("clock, contact, signal or events")] = None
    signal: str | None = None
    events: str | None = None
    level: _Number | None = None
    window: _Count | None = None
    pre: _Count | None = None
    tare: Annotated[Literal["none", "stream", "tap"] | None, wanted("none, stream or tap")] = None
    tare_samples: _Count | None = None
    highpass: Annotated[float, wanted("a number of at least 0", ge=0, le=1e12)] | None = None
    sensor: str | None = None
    source: str | None = None
    licence: str | None = None
    citation: str | None = None

    def __post_init__(self) -> None:
        """Checks every value; a list of one source, array or delimiter is that one, one further array a list."""
        super().__post_init__()
        for key in ("where", "tap", "taps", "taxel", "delimiter"):
            if isinstance(several := getattr(self, key), tuple) and len(several) == 1:
                force_setattr(self, key, several[0])
        if isinstance(self.where, tuple) and not 0 < len(self.where) <= len(PLANE):
            raise SettingError("where", f"must be one source, or x, y and an angle, got {len(self.where)}.")
        for key in ("extra", "leave_out"):
            if isinstance(one := getattr(self, key), str):
                force_setattr(self, key, (one,))
        if "both" in self.leave_out:
            force_setattr(self, "leave_out", ("dead", "saturated"))
        for key in ("scale", "where_scale"):
            if not getattr(self, key):
                raise SettingError(key, "must not be 0.")

    @property
    def taxel_columns(self) -> tuple[str, ...]:
        """Columns that say which taxel a row is of."""
        return (self.taxel,) if isinstance(self.taxel, str) else self.taxel or ()

    @property
    def text_table(self) -> "TextTable":
        """How a table of text is written."""
        from .formats.contents import TextTable  # noqa: PLC0415 - loads NumPy

        return TextTable(
            delimiter=self.delimiter,
            decimal=self.decimal,
            skip_rows=self.skip_rows,
            comment=self.comment,
            header=self.header,
        )

    @property
    def label_texts(self) -> dict[str, str]:
        """Where labels stand that have a key, by label; those of a plane by axis."""
        found: dict[str, str] = {}
        for key in LABELS:
            text = getattr(self, key)
            found |= dict(zip(PLANE, text, strict=False)) if isinstance(text, tuple) else {key: text} if text else {}
        return found

    @property
    def axis_names(self) -> tuple[str, ...] | None:
        """The axes of `taps` in their order, or `None`.

        Raises:
            InputError: One is unknown, or neither taps, samples nor taxels are among them.
        """
        if self.axes is None:
            return None
        names = tuple(name.strip() for name in self.axes.split(","))
        for name in names:
            if name not in AXES:
                raise InputError(f"axes (--axes) has {name!r}; axes are {', '.join(AXES)}.")
        if not {"sample", "taxel"} & set(names):
            raise InputError(f"axes (--axes) must have sample or taxel, got {self.axes!r}.")
        return names

    @property
    def says_something(self) -> bool:
        """Whether any key tells how files are laid out, so that the layout of this software does not apply."""
        told = {"units", "what_unit", "where_unit", "rate", *CUTTING, *ORIGIN}
        default = type(self)()
        return any(getattr(self, name) != getattr(default, name) for name in self.__struct_fields__ if name not in told)


def check_cutting(how: TapMap) -> None:
    """Checks that the keys that cut streams go together.

    Raises:
        InputError: One requires another; the message names both.
    """
    cut, tare, window = how.trigger, how.tare in ("stream", "tap"), how.window or 0
    pressed = cut in ("contact", "signal", "events")
    alone = [key for key in _CUTTING_ALONE if cut is None and getattr(how, key) is not None]
    rules = [
        *((key, True, f"{option('trigger')}, such as contact") for key in alone),
        ("trigger", cut is not None and not window, f"{option('window')}, the number of samples of a tap"),
        ("trigger", cut == "contact" and not how.level, f"{option('level')}, the value that counts as contact"),
        ("align", how.align == "contact" and not how.level, f"{option('level')}, the value that counts as contact"),
        ("trigger", cut in ("signal", "events") and not getattr(how, cut), f"{option(cut or '')}, where presses are"),
        ("level", how.level and "contact" not in (cut, how.align), f"{option('trigger')} or {option('align')} contact"),
        ("pre", how.pre and not pressed and not how.align, f"a press, by {option('trigger')} or {option('align')}"),
        ("pre", how.pre and cut and how.pre >= window, f"a larger {option('window')}"),
        ("tare", tare and not how.tare_samples, f"{option('tare_samples')}, the number of samples to average"),
        ("tare_samples", how.tare_samples and not tare, f"{option('tare')} stream or tap"),
        ("tare_samples", how.tare == "tap" and (how.tare_samples or 0) > window, f"a larger {option('window')}"),
    ]
    for key, wrong, needed in rules:
        if wrong:
            raise InputError(f"{option(key)} {getattr(how, key)} requires {needed}.")


def load_map(path: str | Path) -> TapMap:
    """Map from a TOML file.

    Raises:
        InputError: The file is missing or not TOML, or a key is unknown or its value wrong; the message names both.
    """
    from ..recording import naming  # noqa: PLC0415 - commands begin without what it loads

    text = read_settings(path)
    with naming(path):
        return parse_settings(text, TapMap)
