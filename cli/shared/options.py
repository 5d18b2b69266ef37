"""Arguments and options that several commands share."""

import inspect
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from ...models.errors import InputError
from ...models.measurement.registry import NAMES
from ...models.settings import Checked, FitSettings, SettingError

if TYPE_CHECKING:
    from ...models.setting_file import Setting

Data = Annotated[
    list[Path],
    typer.Argument(
        metavar="DATA...",
        help="Taps: .nc, .mcap, .npz, .csv, .mat or a folder of .csv files. One is split; two are TRAIN and TEST.",
        show_default=False,
    ),
]
WhereCell = Annotated[
    str | None,
    typer.Option("--where-cell", metavar="WIDTH", help="Cells of positions of this width, such as 3mm or 0.5mm."),
]
WhatCell = Annotated[
    str | None,
    typer.Option("--what-cell", metavar="WIDTH", help="Group objects by size into cells of this width."),
]
SplitMethod = Annotated[
    str | None,
    typer.Option(
        "--split",
        metavar="METHOD",
        help="sessions, leave-one-session-out, halves or parity; "
        "default sessions, the last tests, or parity where there is one session.",
    ),
]
TrainSessions = Annotated[
    str | None, typer.Option("--train", metavar="LIST", help="Sessions to train with, such as 0,1.")
]
TestSessions = Annotated[str | None, typer.Option("--test", metavar="LIST", help="Sessions to test, such as 2.")]
Force = Annotated[bool, typer.Option("--force", help="Overwrite existing files.")]
_MODEL_HELP = f"Measurement model: {', '.join(NAMES)}, or session: before any other, such as session:profile"
Model = Annotated[str, typer.Option("--model", metavar="NAME", help=f"{_MODEL_HELP}.")]
ModelOrAll = Annotated[str, typer.Option("--model", metavar="NAME", help=f"{_MODEL_HELP}; all for each in turn.")]
AllowUnconverged = Annotated[bool, typer.Option("--allow-unconverged", help="Use a model whose fit did not converge.")]
Bins = Annotated[
    int, typer.Option("--bins", min=1, max=65536, help="Bins of the histogram, by which all models are judged.")
]
Pseudocount = Annotated[
    float, typer.Option("--pseudocount", min=0.0, help="Counts added to every bin of the histogram.")
]
Power = Annotated[
    str,
    typer.Option(
        "--power",
        help="Root of the likelihood: J, JK, none, an exponent, or learned[:N] on training sessions left out in turn, "
        "for beliefs after N taps (default 20).",
    ),
]
Exponent = Annotated[str, typer.Option("--power", help="Root of the likelihood in use: J, JK, none or an exponent.")]
Saturation = Annotated[
    float | None,
    typer.Option(
        "--saturation",
        metavar="N",
        help="All taps of an episode together count as N at most, as they are not independent; default no limit.",
        show_default=False,
    ),
]
SettingFile = Annotated[
    Path | None,
    typer.Option(
        "--setting",
        metavar="FILE",
        help="A setting file that options are taken from; those given here win.",
        show_default=False,
    ),
]
ValueRange = Annotated[
    Literal["global", "taxel"], typer.Option("--range", help="Bins across the range of all taxels or of each.")
]
Border = Annotated[
    Literal["uniform", "uniform_what", "prior", "clamp", "circular"],
    typer.Option("--border", help="What a move does to belief that leaves the range."),
]
Thresholds = Annotated[str | None, typer.Option(help="Belief thresholds, such as 0.5,0.9,0.99.")]
Seed = Annotated[int, typer.Option("--seed", min=0, max=2**63 - 1, help="Of every random draw.")]
TrainingTaps = Annotated[
    bool, typer.Option("--training-taps", help="Also play test taps that trained the model; default leaves them out.")
]
Theta = Annotated[float, typer.Option("--theta", help="Belief in an object needed to decide.")]
ThetaX = Annotated[float, typer.Option("--theta-x", help="Belief in a position needed for a move; 0 always moves.")]
Fixation = Annotated[
    int | None,
    typer.Option("--fixation", help="Fixation point as 0-based class index; default the middle.", show_default=False),
]
Passive = Annotated[bool, typer.Option("--passive", help="Never move.")]
Deadline = Annotated[
    int, typer.Option("--deadline", min=1, max=10**6, help="Taps after which the most probable classes are taken.")
]
Workers = Annotated[
    int | None, typer.Option("--workers", min=1, help="How many at a time; default as many as there are cores.")
]


OPTIONS: dict[str, Any] = {
    "bins": Bins,
    "pseudocount": Pseudocount,
    "power": Power,
    "saturation": Saturation,
    "value_range": ValueRange,
    "unconverged": AllowUnconverged,
    "threshold": Theta,
    "theta_x": ThetaX,
    "fixation": Fixation,
    "passive": Passive,
    "deadline": Deadline,
    "border": Border,
    "where_cell": WhereCell,
    "what_cell": WhatCell,
    "split": SplitMethod,
    "train": TrainSessions,
    "test": TestSessions,
    "training_taps": TrainingTaps,
}
"""Usual options of the fields of settings records."""


FITTING = "bins", "pseudocount", "power", "value_range"
CELLS = "where_cell", "what_cell"
DIVIDED = *CELLS, "split", "train", "test"


def given(context: typer.Context, option: str) -> bool:
    """Whether an option stands on the command line, by the name of its parameter."""
    source = context.get_parameter_source(option)
    return source is not None and not source.name.startswith("DEFAULT")


def merged[R: Checked](context: typer.Context, setting: "Setting | None", record: R) -> R:
    """The values of a settings record: what stands on the command line, else what a setting says, else the default.

    Args:
        context: Of the command.
        setting: The setting, if there is one.
        record: `FitSettings` or `PlaySettings` as the command got it.
    """
    if setting is None:
        return record
    names = [name for name in record.__struct_fields__ if given(context, name)]
    known: Any = setting.fit if isinstance(record, FitSettings) else setting.play
    return known.changed(**{name: getattr(record, name) for name in names})


class Fields:
    """The fields of a settings record that a command has as options, in the annotation of a parameter.

    Args:
        names: Fields with their usual options, see `OPTIONS`.
        others: Fields with options of the command's own.
    """

    def __init__(self, *names: str, **others: Any) -> None:
        self.options: dict[str, Any] = {name: OPTIONS[name] for name in names} | others


def spelled_out(command: Callable[..., None]) -> Callable[..., None]:
    """A command for Typer: each parameter annotated with `Fields` is spelled out as one option per field.

    The defaults are those of the record that is the parameter's default. A value that the record refuses is named by
    its option.
    """
    parameters, records = [], {}
    for name, parameter in inspect.signature(command, eval_str=True).parameters.items():
        fields = next(
            (part for part in getattr(parameter.annotation, "__metadata__", ()) if isinstance(part, Fields)), None
        )
        if fields is None:
            parameters.append(parameter)
            continue
        records[name] = parameter.default, fields.options
        parameters += [
            parameter.replace(name=field, annotation=option, default=getattr(parameter.default, field))
            for field, option in fields.options.items()
        ]

    parameters.sort(key=lambda parameter: parameter.default is not parameter.empty)
    signature = inspect.Signature(parameters)

    @wraps(command)
    def spelled(*positional: Any, **named: Any) -> None:
        bound = signature.bind(*positional, **named)
        bound.apply_defaults()
        values = dict(bound.arguments)
        for name, (default, options) in records.items():
            try:
                values[name] = default.changed(**{field: values.pop(field) for field in options})
            except SettingError as error:
                option = options[error.name].__metadata__[0]
                names = option.param_decls or (option.default,)  # where Typer looks for the name in an annotation
                raise InputError(f"{names[0]} {error.problem}") from None
        command(**values)

    spelled.__signature__ = signature  # type: ignore[attr-defined]
    spelled.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    del spelled.__wrapped__
    return spelled


def parse_thresholds(text: str | None) -> list[float] | None:
    """Belief thresholds separated by commas.

    Raises:
        InputError: The text is something else.
    """
    if text is None:
        return None
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"--thresholds needs numbers such as 0.5,0.9,0.99, got {text!r}.") from None
