"""`rig.toml`: the devices of a rig and the limits of its motion.

Lengths are millimetres of the rig frame: x runs along the finger, starting at the first position; y is the direction of
a tap, rising towards the object. Each axis defines its mapping to machine coordinates.
"""

import math
from itertools import pairwise
from pathlib import Path
from typing import Annotated, ClassVar, Literal, NamedTuple

import msgspec
from msgspec import Meta, Struct

from ...models.errors import InputError
from ...models.io.recording import naming
from ...models.io.toml import parse_settings, read_settings
from ...models.preprocessing import Preprocessing

Length = Annotated[float, Meta(ge=-10_000, le=10_000)]
"""A place in mm."""
Width = Annotated[float, Meta(ge=1e-4, le=10_000)]
"""A distance in mm."""
Speed = Annotated[float, Meta(ge=0.01, le=1000)]
"""In mm/s."""
Seconds = Annotated[float, Meta(ge=0.01, le=3600)]
Milliseconds = Annotated[float, Meta(ge=1, le=10_000)]
Baud = Annotated[int, Meta(ge=300, le=12_000_000)]
Readings = Annotated[int, Meta(ge=1, le=100_000)]
"""A number of readings of the sensor."""
_ROUNDING = 1e-6
_LEAST_STALE = 2  # periods
_PRESS_MARGIN_S = 0.3  # the finger may come to rest this much later, see `Rig`


class _RigTable(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of the file; unknown keys are refused."""


class AxisSettings(_RigTable, frozen=True):
    """One axis of the stage.

    Attributes:
        letter: Name of the axis in the controller.
        origin_mm: Rig zero in machine coordinates, which are negative in GRBL.
        direction: 1 if rig and machine coordinates rise together, -1 otherwise.
        low_mm: Lower limit of all moves, in the rig frame.
        high_mm: Upper limit of all moves, in the rig frame.
        speed_mm_s: Speed of moves, at most the maximum rate of the controller.
    """

    letter: Literal["X", "Y", "Z"]
    origin_mm: Length
    low_mm: Length
    high_mm: Length
    speed_mm_s: Speed
    direction: Literal[-1, 1] = 1

    def machine_mm(self, rig_mm: float) -> float:
        """Machine coordinate of a rig coordinate."""
        return self.origin_mm + self.direction * rig_mm

    def rig_mm(self, machine_mm: float) -> float:
        """Rig coordinate of a machine coordinate."""
        return self.direction * (machine_mm - self.origin_mm)


class StageSettings(_RigTable, frozen=True):
    """The stage and its controller.

    Attributes:
        port: Device or URL.
        x: The axis along the finger.
        y: The axis of the tap.
        baud: Bits per second (GRBL: 115200).
        boot_s: Timeout in seconds for the banner of a controller that is reset by opening the port.
        homing_s: Timeout of homing in seconds.
        homes_past_object: Whether homing may end beyond the limits of y on the side of the object.
    """

    port: str
    x: AxisSettings
    y: AxisSettings
    baud: Baud = 115200
    boot_s: Seconds = 5.0
    homing_s: Seconds = 120.0
    homes_past_object: bool = False


class _SensorTable(_RigTable, frozen=True, kw_only=True):
    """What all sensors have.

    Attributes:
        port: Device or URL of the sensor or its adapter.
        stale_ms: Silence in milliseconds after which the finger stops and the run ends; default: 160 or more, from the
            gaps between the first readings.
    """

    port: str
    stale_ms: Milliseconds | None = None

    @property
    def stale_s(self) -> float | None:
        """`stale_ms` in seconds."""
        return None if self.stale_ms is None else self.stale_ms / 1000


class Rest(NamedTuple):
    """Raw readings of an untouched taxel.

    Attributes:
        rising: Whether they rise under load.
        low: Lowest mean.
        high: Highest mean.
    """

    rising: bool
    low: float = -math.inf
    high: float = math.inf


class IcubSettings(_SensorTable, frozen=True, kw_only=True, tag_field="kind", tag="icub"):
    """A triangle of 12 taxels of the iCub's skin behind an SLCAN adapter.

    Attributes:
        baud: Bits per second of the port; adapters on USB ignore it.
        acks: Whether the adapter answers commands; `"auto"` detects it, stock CANable firmware does not.
        board: Address on the bus, 14 on both hands.
        triangle: Triangle; 0 to 4 are index, middle, ring and little finger, and thumb.
        period_ms: Time in milliseconds between two readings; 20 is the paper's 50 Hz.
        no_load: Reading of an untouched taxel after calibration, in counts.
        no_load_band: Largest deviation from it of the mean of an untouched taxel, in counts.
        noise_limit: Largest standard deviation of an untouched taxel, in counts.
        overload: Raw reading at or below which a taxel is overloaded and the finger retracts.
        stuck_readings: Number of consecutive identical readings that show a stuck sensor; 0 for no check.
        order: Byte of the frames for each taxel of the taps; default: as sent.
        positions_mm: Position of each taxel of the taps, two or three numbers each; default: none.
    """

    baud: Baud = 115200
    acks: Literal["auto", "none", "strict"] = "auto"
    board: Annotated[int, Meta(ge=1, le=14)] = 14
    triangle: Annotated[int, Meta(ge=0, le=15)] = 0
    period_ms: Annotated[int, Meta(ge=1, le=209)] = 20
    no_load: Annotated[int, Meta(ge=0, le=255)] = 240
    no_load_band: Annotated[float, Meta(gt=0, le=255)] = 15.0
    noise_limit: Annotated[float, Meta(gt=0, le=255)] = 4.0
    overload: Annotated[int, Meta(ge=0, le=255)] = 2
    stuck_readings: Annotated[int, Meta(ge=0, le=1_000_000)] = 25
    order: list[Annotated[int, Meta(ge=0, le=11)]] = msgspec.field(default_factory=lambda: list(range(12)))
    positions_mm: list[list[Length]] = []

    device: ClassVar[str] = "iCub fingertip"
    sent: ClassVar[int] = 12

    @property
    def taxels(self) -> int:
        """`K`."""
        return len(self.order)

    @property
    def rest(self) -> "Rest":
        """Readings of an untouched taxel."""
        return Rest(rising=False, low=self.no_load - self.no_load_band)

    @property
    def rate_hz(self) -> float:
        """Readings per second."""
        return 1000.0 / self.period_ms


class LineSettings(_SensorTable, frozen=True, kw_only=True, tag_field="kind", tag="lines"):
    """A sensor that sends one line per reading, `t_ms,v0,...`; see docs/how-to/line-sensor.md.

    Attributes:
        taxels: Number of values in a line, `K`.
        rate_hz: Readings per second.
        baud: Bits per second.
        rising: Whether values rise under load.
        idle_low: Lowest mean that an untouched taxel may have.
        idle_high: Highest mean that an untouched taxel may have.
        noise_limit: Largest standard deviation of an untouched taxel.
        overload: Raw value at or beyond which a taxel is overloaded; default: never.
        stuck_readings: Number of consecutive identical readings that show a stuck sensor; default: 0, no check.
        order: Value of the line for each taxel of the taps; default: as sent.
        positions_mm: Position of each taxel of the taps, two or three numbers each; default: none.
    """

    taxels: Annotated[int, Meta(ge=1, le=10_000)]
    rate_hz: Annotated[float, Meta(ge=0.01, le=100_000)]
    baud: Baud = 115200
    rising: bool = True
    idle_low: float = -math.inf
    idle_high: float = math.inf
    noise_limit: Annotated[float, Meta(gt=0)] = math.inf
    overload: float | None = None
    stuck_readings: Annotated[int, Meta(ge=0, le=1_000_000)] = 0
    order: list[Annotated[int, Meta(ge=0, le=9999)]] = []
    positions_mm: list[list[Length]] = []

    device: ClassVar[str] = "line sensor"

    @property
    def sent(self) -> int:
        """Number of values of a reading."""
        return self.taxels

    @property
    def rest(self) -> "Rest":
        """Readings of an untouched taxel."""
        return Rest(self.rising, self.idle_low, self.idle_high)


type SensorSettings = IcubSettings | LineSettings
"""Settings of a sensor, one table for each kind."""


class RangeSettings(_RigTable, frozen=True):
    """Positions along x, divided into classes of equal width.

    Attributes:
        start_mm: Lower end of the range.
        end_mm: Upper end of the range.
        cell_mm: Width of a class, and length of a step (paper: 1 mm).
    """

    start_mm: Length = 0.0
    end_mm: Length = 16.0
    cell_mm: Width = 1.0

    @property
    def where_classes(self) -> int:
        """`L`."""
        return round((self.end_mm - self.start_mm) / self.cell_mm)


class TapSettings(_RigTable, frozen=True):
    """Motion and preprocessing of a tap.

    Attributes:
        clear_mm: y of a position without contact.
        depth_mm: y of the deepest point.
        speed_mm_s: Speed of the tap; default: that of the y axis.
        samples: Number of samples, `J` (paper: 50).
        lead_samples: Number of samples before the press.
        period_s: Time from tap to tap (paper: 1 s).
        tare: `"tap"` subtracts the mean of the lead samples, `"none"` nothing.
        highpass_hz: Cut-off frequency of a high-pass filter over the whole stream, 0 for none.
        rate_hz: Samples per second, to which the sensor's readings are resampled; default: one sample per reading.
        taxels: Taxels of the sensor's that taps consist of, in increasing order; default: all.
        retries: Number of repetitions of an implausible tap.
    """

    depth_mm: Length
    clear_mm: Length = 0.0
    speed_mm_s: Speed | None = None
    samples: Readings = 50
    lead_samples: Readings = 10
    period_s: Seconds = 1.0
    tare: Literal["tap", "none"] = "tap"
    highpass_hz: Annotated[float, Meta(ge=0, le=100_000)] = 0.0
    rate_hz: Annotated[float, Meta(ge=0.01, le=100_000)] | None = None
    taxels: list[Annotated[int, Meta(ge=0, le=9999)]] | None = None
    retries: Annotated[int, Meta(ge=0, le=1000)] = 3


class EmulatorSettings(_RigTable, frozen=True):
    """Control socket of emulated devices; written by `solidtouch emulate`.

    Attributes:
        control: Path of the socket.
        shared_clock: Whether the emulator provides the time; otherwise the host's clock is used.
    """

    control: str
    shared_clock: bool = True


class RigFile(_RigTable, frozen=True):
    """Settings of a rig.

    Attributes:
        name: Name of the rig and its frame.
        sensor: The tactile sensor.
        stage: The stage.
        tap: Motion and preprocessing of a tap.
        range: Positions along x.
        emulator: Emulator, if the devices are emulated.
    """

    name: str
    sensor: SensorSettings
    stage: StageSettings
    tap: TapSettings
    range: RangeSettings = RangeSettings()
    emulator: EmulatorSettings | None = None

    @property
    def preprocessing(self) -> Preprocessing:
        """Preprocessing of the taps."""
        tap = self.tap
        return Preprocessing(
            samples=tap.samples,
            rate_hz=self.sensor.rate_hz if tap.rate_hz is None else tap.rate_hz,
            tare=tap.tare,
            tare_samples=tap.lead_samples if tap.tare == "tap" else 0,
            highpass_hz=tap.highpass_hz,
            trigger="press",
            pre_samples=tap.lead_samples,
            sensor_hz=None if tap.rate_hz is None else self.sensor.rate_hz,
            taxels=None if tap.taxels is None else tuple(tap.taxels),
        )


def load_rig(path: str | Path) -> RigFile:
    """Settings read from a file.

    Raises:
        InputError: The file is missing or not TOML, a key is unknown, missing or of the wrong type, or values
            contradict each other; the message names file and key.
    """
    text = read_settings(path)
    with naming(path):
        return parse_rig(text)


def parse_rig(text: str) -> RigFile:
    """Settings read from the text of a file.

    Raises:
        InputError: As `load_rig`.
    """
    rig = parse_settings(text, RigFile)
    _check(rig)
    return rig


def _check(rig: RigFile) -> None:
    for name in ("idle_low", "idle_high", "overload"):
        if math.isnan(getattr(rig.sensor, name, None) or 0.0):
            raise InputError(f"sensor.{name}: must be a number, got nan.")
    for name, axis in (("x", rig.stage.x), ("y", rig.stage.y)):
        if not axis.low_mm < axis.high_mm:
            raise InputError(f"stage.{name}: low_mm={axis.low_mm:g} must be below high_mm={axis.high_mm:g}.")
    if rig.stage.port == rig.sensor.port:
        raise InputError(f"stage.port: must differ from sensor.port, both are {rig.stage.port}.")
    if rig.stage.x.letter == rig.stage.y.letter:
        raise InputError(f"stage.y.letter: both axes are called {rig.stage.x.letter}.")
    _inside("range.start_mm", rig.range.start_mm, "x", rig.stage.x)
    _inside("range.end_mm", rig.range.end_mm, "x", rig.stage.x)
    _inside("tap.clear_mm", rig.tap.clear_mm, "y", rig.stage.y)
    _inside("tap.depth_mm", rig.tap.depth_mm, "y", rig.stage.y)
    if not rig.tap.clear_mm < rig.tap.depth_mm:
        raise InputError("tap.depth_mm: must be above clear_mm, as y rises towards the object.")
    cells = (rig.range.end_mm - rig.range.start_mm) / rig.range.cell_mm
    if round(cells) < 1 or abs(cells - round(cells)) > _ROUNDING * cells:
        raise InputError(f"range: must be a whole number of cells, at least 1, got {cells:g}.")
    if not rig.tap.lead_samples < rig.tap.samples:
        raise InputError("tap.lead_samples: must be below samples, as a tap needs samples after the press.")
    _check_sensor(rig.sensor)
    try:
        record = rig.preprocessing
    except InputError as error:
        raise InputError(f"tap: {error}") from error
    _check_taxels(rig)
    rate_hz = record.rate_hz or rig.sensor.rate_hz
    behind_s = record.frames_behind / rig.sensor.rate_hz
    seconds = rig.tap.samples / rate_hz + behind_s
    if seconds > rig.tap.period_s + _ROUNDING:
        wait = f", with {behind_s:g} s for resampling" if behind_s else ""
        raise InputError(f"tap.period_s: {rig.tap.samples} samples take {seconds:g} s{wait}, longer than the period.")
    pressed_s = 2 * (rig.tap.depth_mm - rig.tap.clear_mm) / (rig.tap.speed_mm_s or rig.stage.y.speed_mm_s)
    read_s = (rig.tap.samples - rig.tap.lead_samples) / rate_hz
    if pressed_s > read_s + _PRESS_MARGIN_S:
        raise InputError(
            f"tap.samples: press and release take at least {pressed_s:.2f} s, longer than the {read_s:g} s of samples "
            f"after the press; take more samples, or raise the speed of the tap."
        )


def _check_taxels(rig: RigFile) -> None:
    K = rig.sensor.taxels
    if rig.tap.taxels is not None and rig.tap.taxels[-1] >= K:
        raise InputError(f"tap.taxels: the sensor has {K} taxels, counted from 0, got {rig.tap.taxels[-1]}.")


def _check_sensor(sensor: SensorSettings) -> None:
    if sensor.stale_ms is not None and sensor.stale_ms < _LEAST_STALE * 1000 / sensor.rate_hz:
        least = _LEAST_STALE * 1000 / sensor.rate_hz
        raise InputError(f"sensor.stale_ms: must be at least {least:g}, two periods, got {sensor.stale_ms:g}.")
    _check_overload(sensor)
    sent, order = sensor.sent, sorted(sensor.order)
    if not sensor.taxels:
        raise InputError("sensor.order: a tap needs at least one taxel.")
    if any(a == b for a, b in pairwise(order)) or (order and order[-1] >= sent):
        raise InputError(f"sensor.order: must list distinct taxels out of 0 to {sent - 1}.")
    K = len(order) or sent
    sizes = {len(position) for position in sensor.positions_mm}
    if sensor.positions_mm and (len(sensor.positions_mm) != K or sizes not in ({2}, {3})):
        raise InputError(f"sensor.positions_mm: must give two or three numbers for each of the {K} taxels.")


def _check_overload(sensor: SensorSettings) -> None:
    """Checks that no reading at rest is an overload."""
    rising, low, high = sensor.rest
    if sensor.overload is None:
        return
    if not rising and low > -math.inf and sensor.overload >= low:
        raise InputError(
            f"sensor.overload: must be below {low:g}, the lowest reading at rest, got {sensor.overload:g}."
        )
    if rising and high < math.inf and sensor.overload <= high:
        raise InputError(
            f"sensor.overload: must be above {high:g}, the highest reading at rest, got {sensor.overload:g}."
        )


def _inside(key: str, value_mm: float, name: str, axis: AxisSettings) -> None:
    if not axis.low_mm <= value_mm <= axis.high_mm:
        raise InputError(
            f"{key}: {value_mm:g} mm is outside the limits of stage.{name}, {axis.low_mm:g} to {axis.high_mm:g} mm."
        )
