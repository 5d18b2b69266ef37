"""Settings records: division of taps, fit of a measurement model, and play of episodes; powers and saturations."""

import math
import re
import sys
from functools import cache
from typing import Annotated, Any, Literal, Self, get_args

import msgspec
from msgspec import Meta, Struct

from .errors import InputError

LEARNED = "learned"
"""Power to be learned from training sessions; `learned:N` maximises beliefs after N taps."""
TAPS = 20
"""Default number of taps for a learned power."""


def likelihood_exponent(power: str | float, J: int, K: int) -> float:
    """The exponent of the product in Eq. 1: 1/J as printed, 1/(J K), 1, or a number.

    Raises:
        InputError: The power is none of these.
    """
    named = {"J": 1.0 / J, "JK": 1.0 / (J * K), "none": 1.0}
    value = named.get(power) if isinstance(power, str) else float(power)
    if value is None or not (math.isfinite(value) and value > 0):
        raise InputError(f"The power must be J, JK, none or a positive number, got {power!r}.")
    return value


def check_saturation(saturation: float) -> None:
    """Checks that a saturation is a positive number of taps.

    Raises:
        InputError: It is NaN or not above 0; infinity stands for no limit.
    """
    if not saturation > 0:
        raise InputError(f"The saturation must be a positive number of taps, got {saturation}.")


def parse_power(text: str) -> str | float:
    """Power from its text on a command line.

    Raises:
        InputError: It is neither J, JK, none nor a positive number.
    """
    if text in ("J", "JK", "none"):
        return text
    try:
        number = float(text)
    except ValueError:
        number = -1.0
    if not (math.isfinite(number) and number > 0):
        raise InputError(f"The power must be J, JK, none or a positive number, got {text!r}.")
    return number


def parse_power_choice(text: str) -> str | float:
    """Power from its text on a command line, including `learned` and `learned:N`.

    Raises:
        InputError: It is none of these.
    """
    try:
        return text if learned_taps(text) else parse_power(text)
    except InputError as error:
        if text.startswith(LEARNED):
            raise
        raise InputError(f"{str(error).rstrip('.')}; {LEARNED} estimates it.") from None


def learned_taps(power: str | float) -> int | None:
    """Number of taps N of a learned power; `None` for other powers.

    Raises:
        InputError: It begins with `learned` and ends in no number of taps.
    """
    if not isinstance(power, str) or not power.startswith(LEARNED):
        return None
    matched = re.fullmatch(f"{LEARNED}(?::([0-9]{{1,6}}))?", power)
    taps = int(matched[1] or TAPS) if matched else 0
    if not taps:
        raise InputError(f"The power must be {LEARNED}, or {LEARNED}:N with a number of taps N, got {power!r}.")
    return taps


type ValueRange = Literal["global", "taxel"]
type Border = Literal["uniform", "uniform_what", "prior", "clamp", "circular"]
type Missing = Literal["refuse", "drop"]
type Method = Literal["closed", "svi", "nuts", "map", "laplace"]
type Device = Literal["cpu", "gpu"]
_LARGEST = sys.float_info.max


def wanted(description: str, **limits: Any) -> Meta:
    """Limits of a value, and their description for messages."""
    return Meta(**limits, extra={"wanted": description})


_Probability = Annotated[float, wanted("a number from 0 to 1", ge=0, le=1)]
_Spread = Annotated[float, wanted("a number of at least 0", ge=0, le=_LARGEST)]


class SettingError(InputError):
    """A value of a settings record is out of range.

    Attributes:
        name: Name of the field, with which the message begins.
        problem: The rest of the message.
    """

    def __init__(self, name: str, problem: str) -> None:
        super().__init__(f"{name} {problem}")
        self.name, self.problem = name, problem


class Checked(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Record that checks its values against their types; NumPy numbers become Python numbers.

    Raises:
        SettingError: A value is out of range.
    """

    def changed(self, **values: Any) -> Self:
        """Record with other values."""
        return msgspec.structs.replace(self, **values)

    def __post_init__(self) -> None:
        """Checks every value."""
        for field in _fields(type(self)):
            value = getattr(self, field.name)
            plain = value.item() if hasattr(value, "item") and not getattr(value, "ndim", 0) else value
            try:
                known = msgspec.convert(plain, field.type)
            except (msgspec.ValidationError, SystemError):  # before msgspec 0.22, where a number is beyond all doubles
                raise SettingError(field.name, f"must be {_description(field.type)}, got {value!r}.") from None
            msgspec.structs.force_setattr(self, field.name, known)


class FitSettings(Checked, frozen=True, kw_only=True):
    """Settings for the fit of a measurement model.

    >>> FitSettings(bins=50).changed(power="JK").bins
    50

    Attributes:
        bins: Number of histogram bins; all models are judged by probabilities of these bins.
        pseudocount: Counts added to every bin of the histogram.
        power: Exponent of the likelihood of a tap: `"J"` (1/J, as printed in Eq. 1), `"JK"`, `"none"` or a number;
            `"learned"` or `"learned:N"` where it is learned from training sessions.
        saturation: Number of taps that an episode's evidence counts as at most, see `inference.filter`; `None` for
            no limit.
        value_range: Whether bins span the range of all taxels together or of each.
        edges: Bin edges, shape (B + 1,) or (K, B + 1), instead of those of the training taps; they replace `bins`.
        method: `"closed"` for the fast fit of each model, which for a function of the user's is `"svi"`; `"nuts"` to
            sample its story, `"svi"`, `"map"` or `"laplace"` for functions. In studies built-in models always have
            the fast fit.
        steps: Maximum number of steps of the fit of a function, in whole runs of 800; of `"nuts"` the number of steps
            of each chain, two thirds of which adapt the sampler. `None` for 4000, and 750 of chains.
        device: Where JAX computes fits of functions and chains.
        integrate: Number of draws from the posterior over which decisions are integrated; 0 decides at one value.
        unconverged: Whether a fit that did not converge may be used.
        gain_sd: Session models: standard deviation of the log gain (about 0) between sessions; `None` to estimate it
            from the training taps.
        offset_sd: Session models: standard deviation of the offset between sessions, likewise.
        seed: Random seed of fits that draw random numbers.
    """

    bins: Annotated[int, wanted("an integer from 1 to 65536", ge=1, le=65536)] = 100
    pseudocount: Annotated[float, wanted("a number of at least 0", ge=0, le=_LARGEST)] = 0.01
    power: Annotated[str | float, wanted("J, JK, none, learned or a positive number")] = "J"
    saturation: Annotated[float, wanted("a positive number of taps", gt=0, le=_LARGEST)] | None = None
    value_range: ValueRange = "global"
    edges: Any = None
    method: Method = "closed"
    steps: Annotated[int, wanted("an integer of at least 50", ge=50)] | None = None
    device: Device = "cpu"
    integrate: Annotated[int, wanted("an integer of at least 0", ge=0)] = 0
    unconverged: bool = False
    gain_sd: _Spread | None = None
    offset_sd: _Spread | None = None
    seed: Annotated[int, wanted("an integer of at least 0", ge=0)] = 0

    def __post_init__(self) -> None:
        """Checks every value."""
        super().__post_init__()
        try:
            msgspec.structs.force_setattr(self, "power", parse_power_choice(str(self.power)))
        except InputError as error:
            raise SettingError("power", str(error).removeprefix("The power ")) from None

    @property
    def limit(self) -> float:
        """Saturation as a number, infinity for no limit."""
        return math.inf if self.saturation is None else self.saturation


class PlaySettings(Checked, frozen=True, kw_only=True):
    """Settings for episodes and trials; the defaults are the paper's as far as it states them.

    >>> PlaySettings(theta_x=0.3).move_threshold, PlaySettings(passive=True).move_threshold
    (0.3, 1.0)

    Attributes:
        threshold: Belief in an object needed to decide.
        border: Reading of Eq. 9 at the ends of the range: what becomes of belief shifted beyond them.
        theta_x: Belief in a position needed for a move.
        fixation: Fixation point as index of a position; `None` for the middle.
        passive: Whether the sensor stays in place.
        deadline: Number of taps after which the most probable object is taken.
    """

    threshold: _Probability = 0.95
    border: Border = "uniform"
    theta_x: _Probability = 0.0
    fixation: Annotated[int, wanted("a position index from 0", ge=0)] | None = None
    passive: bool = False
    deadline: Annotated[int, wanted("an integer from 1 to 1000000", ge=1, le=10**6)] = 100

    @property
    def move_threshold(self) -> float:
        """Belief in a position required for a move; 1 for passive episodes."""
        return 1.0 if self.passive else self.theta_x


class Division(Checked, frozen=True, kw_only=True):
    """Settings for grouping recorded taps into classes and splitting them into training and test taps.

    >>> Division(where_cell="2mm", split="sessions", test="2").where_cell
    '2mm'

    Attributes:
        where_cell: Width of the where cells with unit, such as `"3mm"`; `None` takes the positions of the file.
        what_cell: Width of the what cells, likewise.
        split: How one file is split, see `splits.split`.
        train: Sessions to train with, such as `"0,1"`.
        test: Sessions to test.
        training_taps: Whether to keep test taps that are among the training taps; the split's warning names them.
        missing: What to do with samples that are NaN: `"refuse"` the file, or `"drop"` them; tap sets remember it.
    """

    where_cell: str | None = None
    what_cell: str | None = None
    split: str | None = None
    train: str | None = None
    test: str | None = None
    training_taps: bool = False
    missing: Missing = "refuse"

    def refuse_split(self, reason: str) -> None:
        """Checks that no option is given that splits one file.

        Raises:
            InputError: One is given; the message ends with the reason.
        """
        for option, value in (("--split", self.split), ("--train", self.train), ("--test", self.test)):
            if value is not None:
                raise InputError(f"{option} splits one file; {reason}.")


@cache
def _fields(record: type[Struct]) -> tuple[msgspec.structs.FieldInfo, ...]:
    return msgspec.structs.fields(record)


def _description(kind: Any) -> str:
    """Description of the values that a type allows, for messages."""
    if hasattr(kind, "__value__"):
        return _description(kind.__value__)
    if hasattr(kind, "__metadata__"):
        return kind.__metadata__[0].extra["wanted"]
    options = get_args(kind)
    if type(None) in options:
        return f"{_description(options[0])} or none"
    return f"one of {', '.join(options)}" if options else {str: "text", bool: "true or false"}[kind]


def check_missing(missing: str) -> None:
    """Checks how missing samples are to be treated.

    Raises:
        InputError: It is neither `refuse` nor `drop`.
    """
    if missing not in ("refuse", "drop"):
        raise InputError(f"missing must be refuse or drop, got {missing!r}.")
