"""Study file of a sweep: data sets, axes of the grid, and settings common to all cells."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from ...hardware.simulator.settings import preset
from ...inference.episode import DEADLINE
from ...inference.moves.strategies import parse_strategy
from ...inference.names import MOVES
from ...inference.reference import Border
from ...models.errors import InputError
from ...models.io.recording import naming
from ...models.io.toml import parse_settings, read_settings
from ...models.measurement.registry import split_name
from ...models.settings import learned_taps, likelihood_exponent

Count = Annotated[int, Meta(ge=1)]
Natural = Annotated[int, Meta(ge=0)]
Text = Annotated[str, Meta(min_length=1)]
type _Some[T] = Annotated[tuple[T, ...], Meta(min_length=1)]


class _StudyTable(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of the file: keys that are not known are refused."""


class DataEntry(_StudyTable, frozen=True):
    """Where taps come from: a preset of the simulator or recorded files.

    Attributes:
        name: What the data set is called in the result.
        preset: Simulated rig; session 0 trains and session 1 tests.
        seeds: Of the simulated data sets, each a data set of its own called `name-seed`.
        files: One file that is split, or two, TRAIN and TEST; relative to the study file.
        split: How one file is split, as on the command line.
        train: Sessions to train with.
        test: Sessions to test.
        where_cell: Width of the where cells with unit, such as `"3mm"`.
        what_cell: Width of the what cells.
        training_taps: Whether to play test taps that stand among the training taps; default no.
    """

    name: Text
    preset: str | None = None
    seeds: _Some[Natural] | None = None
    files: Annotated[tuple[Text, ...], Meta(min_length=1, max_length=2)] | None = None
    split: str | None = None
    train: tuple[Natural, ...] | None = None
    test: tuple[Natural, ...] | None = None
    where_cell: str | None = None
    what_cell: str | None = None
    training_taps: bool | None = None


class GridAxes(_StudyTable, frozen=True):
    """The axes of the grid beside the data sets; every combination is a cell.

    Attributes:
        model: Likelihood models of the catalogue.
        bins: Bins of the histogram, by which all models are judged.
        value_range: Whether bins span all taxels together or each.
        pseudocount: Smoothing, in counts added to every bin.
        power: Root of the likelihood: `"J"`, `"JK"`, `"none"`, a number, `"learned"` or `"learned:N"`.
        border: Reading of Eq. 9 at the ends of the range.
        policy: `"passive"`, `"active"`, the threshold theta_X on the where belief for a move, or the name of another
            control strategy, see `inference.moves.strategies`.
        fixation: Fixation points as where classes from 0, or `"middle"`, the middle of each data set.
        seed: Of the trials.
    """

    model: _Some[str] = ("histogram",)
    bins: _Some[Annotated[int, Meta(ge=1, le=65536)]] = (100,)
    value_range: _Some[Literal["global", "taxel"]] = ("global",)
    pseudocount: _Some[Annotated[float, Meta(ge=0)]] = (0.01,)
    power: _Some[str | float] = ("J",)
    border: _Some[Border] = ("uniform",)
    policy: _Some[str | float] = ("passive", "active")
    fixation: _Some[Natural] | Literal["middle"] = "middle"
    seed: _Some[Natural] = (0,)


class StudyFile(_StudyTable, frozen=True):
    """The whole file.

    Attributes:
        name: What the study is called.
        trials: Trials of each cell.
        thresholds: theta_W; one trajectory answers all of them.
        data: Data sets, the first axis of the grid.
        grid: The other axes.
        deadline: Taps after which the most probable classes are taken.
        resamples: Of the test taps of a single data set; every cell is played on each, for intervals. 0 for none.
    """

    name: Text
    trials: Count
    thresholds: _Some[Annotated[float, Meta(ge=0, le=1)]]
    data: _Some[DataEntry]
    grid: GridAxes = GridAxes()
    deadline: Count = DEADLINE
    resamples: Natural = 0


def load_study(path: str | Path) -> StudyFile:
    """The study in a file.

    Raises:
        InputError: The file is missing or no TOML, a key is unknown, missing or of the wrong kind, or a value cannot
            be used; the sentence names file and key.
    """
    text = read_settings(path)
    with naming(path):
        return parse_study(text)


def parse_study(text: str) -> StudyFile:
    """The study in the text of a file.

    Raises:
        InputError: As `load_study`.
    """
    study = parse_settings(text, StudyFile)
    _check_once("thresholds", study.thresholds)
    for i, entry in enumerate(study.data):
        _check_data(f"data[{i}]", entry)
    _check_once("data", [entry.name for entry in study.data])
    _check_axes(study.grid)
    if study.resamples == 1:
        raise InputError("resamples: it takes 2 or more for an interval; 0 for none.")
    return study


def _check_data(key: str, entry: DataEntry) -> None:
    if (entry.preset is None) == (entry.files is None):
        raise InputError(f"{key}: it needs either preset or files.")
    if entry.preset is not None:
        _check_without(key, entry, ("split", "train", "test", "training_taps"), "files")
        _check_once(f"{key}.seeds", entry.seeds or ())
        with naming(f"{key}.preset"):
            preset(entry.preset)
    else:
        _check_without(key, entry, ("seeds",), "preset")


def _check_without(key: str, entry: DataEntry, names: tuple[str, ...], owner: str) -> None:
    for name in names:
        if getattr(entry, name) is not None:
            raise InputError(f"{key}.{name}: it goes with {owner} only.")


def _check_axes(axes: GridAxes) -> None:
    for key, values in msgspec.structs.asdict(axes).items():
        _check_once(f"grid.{key}", values if isinstance(values, tuple) else ())
    for model in axes.model:
        with naming("grid.model"):
            _, in_states = split_name(model)
        if in_states and "prior" in axes.border:
            raise InputError(f"grid.border: prior does not go with {model}, which carries a state.")
    if not all(map(math.isfinite, axes.pseudocount)):
        raise InputError("grid.pseudocount: the numbers must be finite.")
    for power in axes.power:
        with naming("grid.power"):
            if learned_taps(power) is None:
                likelihood_exponent(power, 1, 1)
    for policy in axes.policy:
        _check_policy(policy)


def _check_policy(policy: str | float) -> None:
    if not isinstance(policy, str):
        known = 0 < policy < 1
    elif policy in MOVES or ":" in policy:
        with naming("grid.policy"):
            if parse_strategy(policy).aims:
                raise InputError(f'{policy!r} is written "active" here, or with its theta_X as a number.')
        known = True
    else:
        known = policy == "active"
    if not known:
        others = ", ".join(form for form in MOVES if not form.startswith("fixation"))
        raise InputError(
            f"grid.policy: it must be passive, active or a number between 0 and 1, not {policy!r}; or one of {others}."
        )


def _check_once(key: str, values: Sequence[Any]) -> None:
    twice = [value for i, value in enumerate(values) if value in values[:i]]
    if twice:
        raise InputError(f"{key}: {twice[0]!r} stands there twice.")
