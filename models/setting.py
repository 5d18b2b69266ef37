"""A setting: everything that a person chooses for perception beside the taps, as a file.

The file is JSON, one object with the key `format` and a key for each field of `Setting`. Commands take their options
from it, and none is missing, so that the file says what was done without this software's defaults.
"""

import json
import math
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from .errors import InputError
from .grid import parse_length
from .json_object import read_object
from .measurement.histogram import HistogramModel
from .measurement.model import TapModel
from .power import likelihood_exponent
from .storage import complete_file

FORMAT = 1
type ValueRange = Literal["global", "taxel"]
type Border = Literal["uniform", "uniform_what", "prior", "clamp", "circular"]
_MOST_BINS, _MOST_TAPS = 65536, 10**6
_CLOSE = 1e-6  # numbers that differ by less in proportion are the same


@dataclass(frozen=True)
class Setting:
    """How to perceive; the defaults are the paper's as far as it has them.

    Attributes:
        model: Measurement model of the catalogue.
        power: Root of the likelihood: `"J"`, `"JK"`, `"none"` or an exponent.
        saturation: How many taps' evidence an episode carries at most, see `inference.saturation`; `None` for no limit.
        bins: Bins of the histogram, by which all models are judged.
        pseudocount: Counts added to every bin of the histogram.
        value_range: Whether bins span all taxels together or each.
        where_cell: Width of the where classes with unit, such as `"0.5mm"`; `None` takes those of the taps.
        what_cell: Width of the what classes, likewise.
        threshold: Belief in an object needed to decide.
        border: Reading of Eq. 9 at the ends of the range.
        theta_x: Belief in a position needed for a move.
        fixation: Fixation point as where index; `None` for the middle.
        passive: Whether to stay in place.
        deadline: Taps after which the most probable object is taken.
        note: Where the setting comes from, in words.

    Raises:
        InputError: A value is out of range; the message begins with its name.
    """

    model: str = "histogram"
    power: str | float = "J"
    saturation: float | None = None
    bins: int = 100
    pseudocount: float = 0.01
    value_range: ValueRange = "global"
    where_cell: str | None = None
    what_cell: str | None = None
    threshold: float = 0.95
    border: Border = "uniform"
    theta_x: float = 0.0
    fixation: int | None = None
    passive: bool = False
    deadline: int = 100
    note: str = ""

    def __post_init__(self) -> None:
        """Checks every value."""
        for field in fields(self):
            wanted = _KINDS[field.name](getattr(self, field.name))
            if wanted:
                raise InputError(f"{field.name} must be {wanted}, got {getattr(self, field.name)!r}.")

    def save(self, path: str | Path, force: bool = False) -> None:
        """Writes the setting, see `save_setting`."""
        save_setting(self, path, force)

    def check_model(self, model: TapModel, path: str | Path, setting_path: str | Path) -> None:
        """Whether a fitted model is the one that the setting speaks of, as far as both tell.

        Args:
            model: The fitted model.
            path: Its file, for the message.
            setting_path: That of the setting.

        Raises:
            InputError: Its name, power, saturation, bins, pseudocount or width of where cells differs.
        """
        ours: dict[str, str | float] = {
            "model": "session" if self.model == "session:histogram" else self.model,
            "power": likelihood_exponent(self.power, model.preprocessing.samples, model.K),
            "saturation": math.inf if self.saturation is None else self.saturation,
            "bins": self.bins,
        }
        theirs: dict[str, str | float] = {
            "model": model.name,
            "power": model.exponent,
            "saturation": model.saturation,
            "bins": model.edges.shape[-1] - 1,
        }
        if isinstance(model, HistogramModel):
            ours["pseudocount"], theirs["pseudocount"] = self.pseudocount, model.pseudocount
        ours["value_range"], theirs["value_range"] = self.value_range, ("global", "taxel")[model.edges.ndim - 1]
        edges = model.grid.where_edges
        if self.where_cell is not None and edges is not None:
            ours["where_cell"] = parse_length(self.where_cell, model.grid.where_unit, "where_cell")
            theirs["where_cell"] = float(np.diff(edges).mean())
        for key, value in theirs.items():
            wanted = ours[key]
            same = value == wanted if isinstance(value, str) else math.isclose(value, float(wanted), rel_tol=_CLOSE)
            if not same:
                raise InputError(
                    f"{path} was fitted with {key} {_printed(value)} and the setting {setting_path} says "
                    f"{_printed(wanted)}; perceive with a model of this setting, or take another setting."
                )


def save_setting(setting: Setting, path: str | Path, force: bool = False) -> None:
    """Writes a setting, complete or not at all.

    Args:
        setting: What to write.
        path: The file.
        force: Whether an existing file may be replaced.

    Raises:
        InputError: The file cannot be written, or exists and `force` is not set.
    """
    text = json.dumps({"format": FORMAT} | asdict(setting), indent=1, allow_nan=False, ensure_ascii=False)
    with complete_file(path, force) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def load_setting(path: str | Path) -> Setting:
    """The setting in a file.

    Raises:
        InputError: The file is missing or no setting, a key is missing or unknown, or a value is wrong; the message
            names the file and the key.
    """
    values = read_object(path, "setting")
    if values.pop("format", None) != FORMAT:
        raise InputError(f"{path} is no setting: its key format is not {FORMAT}.")
    names = [field.name for field in fields(Setting)]
    missing = [name for name in names if name not in values]
    unknown = [name for name in values if name not in names]
    if missing:
        raise InputError(f"{path} is no whole setting: the key {missing[0]} is missing.")
    if unknown:
        raise InputError(f"{path} has the key {unknown[0]!r}, which no setting has.")
    try:
        return Setting(**values)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _printed(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def _number(low: float, high: float, words: str) -> Callable[[Any], str]:
    return lambda value: "" if _is_number(value) and low <= value <= high else words


def _whole(low: int, high: float, words: str) -> Callable[[Any], str]:
    return lambda value: "" if _is_number(value) and isinstance(value, int) and low <= value <= high else words


def _positive(words: str) -> Callable[[Any], str]:
    return lambda value: "" if _is_number(value) and value > 0 else words


def _or_none(check: Callable[[Any], str]) -> Callable[[Any], str]:
    return lambda value: "" if value is None else f"{words} or null" if (words := check(value)) else ""


def _one_of(*names: str) -> Callable[[Any], str]:
    return lambda value: "" if value in names else f"one of {', '.join(names)}"


def _text(value: Any) -> str:
    return "" if isinstance(value, str) else "a text"


def _power(value: Any) -> str:
    return "" if value in ("J", "JK", "none") else _positive("J, JK, none or a positive number")(value)


def _model(value: Any) -> str:
    from .measurement.catalogue import split_name  # noqa: PLC0415 - it knows all fits and takes long to import

    try:
        split_name(str(value))
    except InputError:
        return "a model of the catalogue"
    return _text(value)


_PROBABILITY = _number(0.0, 1.0, "a number from 0 to 1")
_KINDS: dict[str, Callable[[Any], str]] = {
    "model": _model,
    "power": _power,
    "saturation": _or_none(_positive("a positive number of taps")),
    "bins": _whole(1, _MOST_BINS, f"a whole number from 1 to {_MOST_BINS}"),
    "pseudocount": _number(0.0, np.inf, "a number of counts, 0 or more"),
    "value_range": _one_of(*get_args(ValueRange.__value__)),
    "where_cell": _or_none(_text),
    "what_cell": _or_none(_text),
    "threshold": _PROBABILITY,
    "border": _one_of(*get_args(Border.__value__)),
    "theta_x": _PROBABILITY,
    "fixation": _or_none(_whole(0, np.inf, "a class index from 0")),
    "passive": lambda value: "" if isinstance(value, bool) else "true or false",
    "deadline": _whole(1, _MOST_TAPS, f"a whole number of taps from 1 to {_MOST_TAPS}"),
    "note": _text,
}
"""What is wanted of a value in words, empty where it is as wanted, by the name of the field."""
