"""Setting file: all options of perception apart from the taps.

The file is JSON, one object with the keys of `KEYS`, and none is missing, so that it says what was done without this
software's defaults.
"""

import json
import math
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np

from .errors import InputError, check_format
from .grid import parse_length
from .measurement.histogram import HistogramModel
from .measurement.model import TapModel
from .measurement.registry import split_name
from .settings import Checked, FitSettings, PlaySettings, SettingError, learned_taps, likelihood_exponent, wanted
from .storage import complete_file, read_object

FORMAT = 1
_FIT = ("power", "saturation", "bins", "pseudocount", "value_range")
_CELLS = ("where_cell", "what_cell")
_PLAY = ("threshold", "border", "theta_x", "fixation", "passive", "deadline")
KEYS = ("model", *_FIT, *_CELLS, *_PLAY, "note")
_CLOSE = 1e-6  # numbers that differ by less in proportion are the same


class Setting(Checked, frozen=True, kw_only=True):
    """Options of perception.

    Attributes:
        model: Measurement model of the catalogue.
        fit: How it is fitted; the file keeps what changes its likelihoods and not how they are computed.
        where_cell: Width of the where classes with unit, such as `"0.5mm"`; `None` takes those of the taps.
        what_cell: Width of the what classes, likewise.
        play: How episodes are played.
        note: Where the setting comes from.

    Raises:
        SettingError: A value is out of range.
    """

    model: Annotated[str, wanted("the name of a measurement model")] = "histogram"
    fit: FitSettings = FitSettings()
    where_cell: str | None = None
    what_cell: str | None = None
    play: PlaySettings = PlaySettings()
    note: str = ""

    def __post_init__(self) -> None:
        """Checks every value."""
        super().__post_init__()
        try:
            split_name(self.model)
        except InputError:
            raise SettingError("model", f"must be the name of a measurement model, got {self.model!r}.") from None
        if learned_taps(self.fit.power) is not None:
            raise SettingError("power", f"must be J, JK, none or a positive number, got {self.fit.power!r}.")

    @classmethod
    def of(cls, **values: Any) -> "Setting":
        """Setting with these values of the file, and defaults for the others.

        Raises:
            SettingError: A value is out of range.
        """
        return cls().changed(**values)

    def changed(self, **values: Any) -> Self:
        """Setting with other values, named as in the file.

        Raises:
            SettingError: A value is out of range.
        """
        fit, play = ({key: values.pop(key) for key in keys if key in values} for keys in (_FIT, _PLAY))
        return super().changed(fit=self.fit.changed(**fit), play=self.play.changed(**play), **values)

    def values(self) -> dict[str, Any]:
        """Values of the file, by key."""
        owners = {key: self.fit if key in _FIT else self.play if key in _PLAY else self for key in KEYS}
        return {key: getattr(owner, key) for key, owner in owners.items()}

    def save(self, path: str | Path, force: bool = False) -> None:
        """Writes the setting, atomically.

        Args:
            path: The file.
            force: Whether an existing file may be replaced.

        Raises:
            InputError: The file cannot be written, or exists and `force` is not set.
        """
        text = json.dumps({"format": FORMAT} | self.values(), indent=1, allow_nan=False, ensure_ascii=False)
        with complete_file(path, force) as temporary:
            temporary.write_text(text + "\n", encoding="utf-8")

    def check_model(self, model: TapModel, path: str | Path, setting_path: str | Path) -> None:
        """Checks that a fitted model matches the setting.

        Args:
            model: The fitted model.
            path: Its file, for the message.
            setting_path: That of the setting.

        Raises:
            InputError: Its name, power, saturation, bins, pseudocount or width of where cells differs.
        """
        ours: dict[str, str | float] = {
            "model": "session" if self.model == "session:histogram" else self.model,
            "power": likelihood_exponent(self.fit.power, *model.tap_shape),
            "saturation": self.fit.limit,
            "bins": self.fit.bins,
        }
        theirs: dict[str, str | float] = {
            "model": model.name,
            "power": model.exponent,
            "saturation": model.saturation,
            "bins": model.edges.shape[-1] - 1,
        }
        if isinstance(model, HistogramModel):
            ours["pseudocount"], theirs["pseudocount"] = self.fit.pseudocount, model.pseudocount
        ours["value_range"], theirs["value_range"] = self.fit.value_range, ("global", "taxel")[model.edges.ndim - 1]
        edges = model.grid.where_edges
        if self.where_cell is not None and edges is not None:
            ours["where_cell"] = parse_length(self.where_cell, model.grid.where_unit, "where_cell")
            theirs["where_cell"] = float(np.diff(edges).mean())
        for key, value in theirs.items():
            wanted = ours[key]
            same = value == wanted if isinstance(value, str) else math.isclose(value, float(wanted), rel_tol=_CLOSE)
            if not same:
                raise InputError(
                    f"{path} was fitted with {key} {_printed(value)}, but the setting {setting_path} has "
                    f"{_printed(wanted)}; use a model fitted with this setting, or another setting."
                )


def load_setting(path: str | Path) -> Setting:
    """Setting from a file.

    Raises:
        InputError: The file is missing or no setting, a key is missing or unknown, or a value is wrong; the message
            names the file and the key.
    """
    values = read_object(path, "setting")
    written = values.pop("format", None)
    check_format(written, f"{path}: a setting", FORMAT)
    if written != FORMAT:
        raise InputError(f"{path}: not a setting file: key 'format' is not {FORMAT}.")
    if missing := [key for key in KEYS if key not in values]:
        raise InputError(f"{path}: missing key {missing[0]!r}.")
    if unknown := [key for key in values if key not in KEYS]:
        raise InputError(f"{path}: unknown key {unknown[0]!r}.")
    try:
        return Setting.of(**values)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _printed(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
