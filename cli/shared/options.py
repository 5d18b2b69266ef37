"""Arguments and options that several commands share."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from ...models.errors import InputError
from ...models.measurement.registry import NAMES
from ...models.settings import Checked, FitSettings, SettingError
from .completion import model_names, model_names_or_all

if TYPE_CHECKING:
    from ...models.setting_file import Setting

Data = Annotated[
    list[Path],
    typer.Argument(
        metavar="DATA...",
        help="Taps: .nc, .zarr, .mcap, .npz, .csv, .mat or a folder of .csv files. One file is split; two are TRAIN "
        "and TEST.",
        show_default=False,
    ),
]
WhereCell = Annotated[
    str | None,
    typer.Option(
        "--where-cell", metavar="WIDTH", help="Divide positions into cells of this width, such as 3mm or 0.5mm."
    ),
]
WhatCell = Annotated[
    str | None,
    typer.Option("--what-cell", metavar="WIDTH", help="Group objects by size into cells of this width, such as 2mm."),
]
SplitMethod = Annotated[
    str | None,
    typer.Option(
        "--split",
        metavar="METHOD",
        help="How to split one file: sessions (the last one tests), leave-one-session-out, halves or parity; "
        "default: sessions, or parity for a single session.",
    ),
]
TrainSessions = Annotated[str | None, typer.Option("--train", metavar="LIST", help="Training sessions, such as 0,1.")]
TestSessions = Annotated[str | None, typer.Option("--test", metavar="LIST", help="Test sessions, such as 2.")]
Style = Annotated[
    Literal["page", "paper", "talk"],
    typer.Option("--style", help="Figures for a page, for a column of a paper (88 mm, 7 pt), or for slides (16:9)."),
]
Force = Annotated[bool, typer.Option("--force", help="Overwrite existing files.")]
_MODEL_HELP = (
    f"Measurement model: {', '.join(NAMES)}, or FILE.py:FUNCTION for a NumPyro function of yours; session:NAME adds an "
    "unknown gain and offset to any model"
)
Story = Annotated[
    str | None,
    typer.Option(
        "--story",
        metavar="FILE.py:FUNCTION",
        help="NumPyro function of the fitted model, if it is one of yours and the fit needs its code.",
        show_default=False,
    ),
]
Model = Annotated[str, typer.Option("--model", metavar="NAME", help=f"{_MODEL_HELP}.", autocompletion=model_names)]
ModelOrAll = Annotated[
    str,
    typer.Option(
        "--model",
        metavar="NAME",
        help=f"{_MODEL_HELP}; all checks each model in turn.",
        autocompletion=model_names_or_all,
    ),
]
AllowUnconverged = Annotated[
    bool, typer.Option("--allow-unconverged", help="Use the model even if its fit did not converge.")
]
Bins = Annotated[
    int,
    typer.Option("--bins", min=1, max=65536, help="Number of histogram bins; all models are evaluated on these bins."),
]
Pseudocount = Annotated[float, typer.Option("--pseudocount", min=0.0, help="Count added to every histogram bin.")]
Power = Annotated[
    str,
    typer.Option(
        "--power",
        help="Exponent of the likelihood: J (1/J), JK (1/JK), none, a number, or learned[:N] from training sessions "
        "by cross-validation, for beliefs after N taps (20 if omitted).",
    ),
]
Exponent = Annotated[
    str, typer.Option("--power", help="Exponent of the likelihood: J (1/J), JK (1/JK), none or a number.")
]
Saturation = Annotated[
    float | None,
    typer.Option(
        "--saturation",
        metavar="N",
        help="Cap an episode's evidence at N taps, because taps are correlated; default: no cap.",
        show_default=False,
    ),
]
SettingFile = Annotated[
    Path | None,
    typer.Option(
        "--setting",
        metavar="FILE",
        help="Read options from this setting file; options on the command line take precedence.",
        show_default=False,
    ),
]
ValueRange = Annotated[
    Literal["global", "taxel"],
    typer.Option("--range", help="Range of the bins: common to all taxels, or of each taxel."),
]
Integrate = Annotated[
    int,
    typer.Option(
        "--integrate",
        metavar="D",
        min=0,
        help="Decide by the mean likelihood over D draws from the posterior; 0 decides at one value.",
    ),
]
FitMethod = Annotated[
    Literal["closed", "svi", "nuts", "map", "laplace"],
    typer.Option(
        "--fit",
        help="Fit of functions of yours: closed (the default) means svi; map finds the mode of the posterior, laplace "
        "its mode and curvature, nuts samples it. Built-in models keep their fast fit, but the command fit samples any "
        "model with nuts.",
    ),
]
Steps = Annotated[
    int | None,
    typer.Option(
        "--steps",
        metavar="N",
        help="Maximum number of steps of a fit of a function of yours, in runs of 800 (default 4000); with --fit nuts "
        "the number of steps of each chain (default 750).",
        show_default=False,
    ),
]
Device = Annotated[
    Literal["cpu", "gpu"],
    typer.Option("--device", help="Where functions of yours are fitted, and chains of any model run."),
]
Border = Annotated[
    Literal["uniform", "uniform_what", "prior", "clamp", "circular"],
    typer.Option("--border", help="How to treat belief shifted beyond the range."),
]
Thresholds = Annotated[str | None, typer.Option(help="Belief thresholds, such as 0.5,0.9,0.99.")]
Seed = Annotated[int, typer.Option("--seed", min=0, max=2**63 - 1, help="Random seed.")]
TrainingTaps = Annotated[
    bool, typer.Option("--training-taps", help="Keep test taps that trained the model; by default they are left out.")
]
Missing = Annotated[
    Literal["refuse", "drop"],
    typer.Option(
        "--missing", help="Refuse taps with samples that are NaN, or drop these samples from fit and likelihood."
    ),
]
Theta = Annotated[float, typer.Option("--theta", help="Belief in an object required for a decision.")]
ThetaX = Annotated[float, typer.Option("--theta-x", help="Belief in a position required for a move; 0 always moves.")]
Fixation = Annotated[
    int | None,
    typer.Option(
        "--fixation", help="Fixation point as a position index from 0; default: the middle.", show_default=False
    ),
]
Passive = Annotated[bool, typer.Option("--passive", help="Never move.")]
Deadline = Annotated[
    int,
    typer.Option(
        "--deadline", min=1, max=10**6, help="Maximum number of taps; the most probable classes are then decided."
    ),
]
Workers = Annotated[
    int | None, typer.Option("--workers", min=1, help="Number of parallel workers; default: one per core.")
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        "--scheduler", metavar="ADDRESS", help="Run on the Dask cluster with this scheduler.", show_default=False
    ),
]
Patience = Annotated[
    float,
    typer.Option("--patience", metavar="S", min=0.0, help="Seconds to wait for a lost scheduler or lost workers."),
]


OPTIONS: dict[str, Any] = {
    "bins": Bins,
    "pseudocount": Pseudocount,
    "power": Power,
    "saturation": Saturation,
    "value_range": ValueRange,
    "integrate": Integrate,
    "method": FitMethod,
    "steps": Steps,
    "device": Device,
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
    "missing": Missing,
}
"""Default command-line options of the fields of settings records."""


FITTING = "bins", "pseudocount", "power", "value_range", "integrate", "method", "steps", "device"
CELLS = "where_cell", "what_cell"
DIVIDED = *CELLS, "split", "train", "test"


def given(context: typer.Context, option: str) -> bool:
    """Whether an option was given on the command line, by the name of its parameter."""
    source = context.get_parameter_source(option)
    return source is not None and not source.name.startswith("DEFAULT")


def merged[R: Checked](context: typer.Context, setting: "Setting | None", record: R) -> R:
    """Values of a settings record: from the command line, else from a setting file, else the default.

    Args:
        context: Context of the command.
        setting: The setting, if any.
        record: `FitSettings` or `PlaySettings` with the values of the command line.
    """
    if setting is None:
        return record
    names = [name for name in record.__struct_fields__ if given(context, name)]
    known: Any = setting.fit if isinstance(record, FitSettings) else setting.play
    return known.changed(**{name: getattr(record, name) for name in names})


class Fields:
    """Annotation of a parameter: the fields of a settings record that a command offers as options.

    Args:
        names: Fields with their default options, see `OPTIONS`.
        others: Fields with options specific to the command.
    """

    def __init__(self, *names: str, **others: Any) -> None:
        self.options: dict[str, Any] = {name: OPTIONS[name] for name in names} | others


@dataclass(frozen=True)
class ReadAs:
    """Annotation of an option: what becomes of its texts before they are a field of a record."""

    read: Callable[[Any], Any]


def _field(option: Any, value: Any) -> Any:
    """Value of a field from that of its option."""
    return next((part.read(value) for part in option.__metadata__ if isinstance(part, ReadAs)), value)


def spelled_out(command: Callable[..., None]) -> Callable[..., None]:
    """Command for Typer, with one option per field for each parameter annotated with `Fields`.

    Defaults are those of the record that is the parameter's default. Errors of the record name the option.
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
                values[name] = default.changed(
                    **{field: _field(option, values.pop(field)) for field, option in options.items()}
                )
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
    """Belief thresholds from text with commas; `None` for `None`.

    Raises:
        InputError: The text is not a list of numbers.
    """
    if text is None:
        return None
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"--thresholds must be numbers such as 0.5,0.9,0.99, got {text!r}.") from None
