"""`rig.toml` of an emulated bench: ports, limits, and a tap equal to that of the simulator."""

import json
import math
from pathlib import Path
from typing import Any, Literal

import msgspec

from ...models.errors import InputError
from ..rig.settings import (
    AxisSettings,
    EmulatorSettings,
    IcubSettings,
    LineSettings,
    RangeSettings,
    RigFile,
    SensorSettings,
    StageSettings,
    TapSettings,
)
from ..simulator.physics import taxel_positions_mm
from ..simulator.settings import RigSettings

SensorKind = Literal["icub", "lines"]
CLEARANCE_MM = 1.0
"""Distance from the clear position to the nearest point of the objects."""
TRAVEL_MM = 200.0
"""Length of the axes; machine coordinates run from minus this to 0, at the limit switches."""

_HOME_MM = 30.0
_X_MARGIN_MM = 2.0
_Y_MARGIN_MM = 0.5
_X_SPEED_MM_S = 15.0
_Y_SPEED_MM_S = 10.0  # down and up takes about half a second, like a contact of the simulator
_LEAD_S = 0.2
_NOISE_LIMITS = 3.0
_LEAST_NOISE_LIMIT = 4.0
_ICUB_TAXELS = 12
_MARK = "# An emulated bench, written by `solidtouch emulate`."


def emulated_rig(
    folder: Path, settings: RigSettings, kind: SensorKind, name: str = "emulated", shared_clock: bool = True
) -> RigFile:
    """Settings of a rig of emulated devices.

    Machine home lies outside the range and away from the objects. The deepest point of a tap indents the finger as much
    as in the simulator.

    Args:
        folder: Folder of the ports and the socket.
        settings: The simulated finger and its objects.
        kind: Type of the sensor electronics.
        name: Name of the rig.
        shared_clock: Whether drivers use the emulator's time.

    Raises:
        InputError: The sensor does not support the rate or the number of taxels, or the range exceeds the axis.
    """
    length_mm = settings.end_mm - settings.start_mm
    if length_mm + _HOME_MM + _X_MARGIN_MM > TRAVEL_MM:
        raise InputError(f"The range of {length_mm:g} mm exceeds the travel of the emulated stage, {TRAVEL_MM:g} mm.")
    depth_mm = CLEARANCE_MM + settings.depth_mm
    return RigFile(
        name=name,
        sensor=_sensor(str(folder / "finger"), settings, kind),
        stage=StageSettings(
            port=str(folder / "stage"),
            x=AxisSettings(
                letter="X",
                origin_mm=-_HOME_MM - settings.end_mm,
                low_mm=settings.start_mm - _X_MARGIN_MM,
                high_mm=settings.end_mm + _X_MARGIN_MM,
                speed_mm_s=_X_SPEED_MM_S,
            ),
            y=AxisSettings(
                letter="Y",
                origin_mm=-_HOME_MM,
                direction=-1,
                low_mm=-_X_MARGIN_MM,
                high_mm=depth_mm + _Y_MARGIN_MM,
                speed_mm_s=_Y_SPEED_MM_S,
            ),
        ),
        range=RangeSettings(start_mm=settings.start_mm, end_mm=settings.end_mm, cell_mm=settings.cell_mm),
        tap=_tap(settings, depth_mm),
        emulator=EmulatorSettings(control=str(folder / "control"), shared_clock=shared_clock),
    )


def write_rig(path: Path, rig: RigFile, objects: list[str]) -> None:
    """Writes `rig.toml`, with the names of the objects in a comment.

    Raises:
        InputError: The file exists and was not written by the emulator, or it cannot be written.
    """
    if path.exists() and not path.read_bytes().startswith(_MARK.encode()):
        raise InputError(f"{path}: not written by the emulator, so not overwritten; choose another folder.")
    head = f"{_MARK}\n# Its objects: {', '.join(objects)}.\n\n"
    try:
        path.write_text(head + toml(rig), encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot write: {error.strerror}.") from error


def toml(rig: RigFile) -> str:
    """The settings as TOML text."""
    return "\n".join(_lines("", msgspec.to_builtins(rig)))


def _sensor(port: str, settings: RigSettings, kind: SensorKind) -> SensorSettings:
    K = len(settings.taxels)
    positions = taxel_positions_mm(settings.taxels).round(3).tolist()
    noise = math.hypot(settings.white_counts, settings.taxel_noise_counts, settings.common_noise_counts)
    limit = round(max(_LEAST_NOISE_LIMIT, _NOISE_LIMITS * noise), 3)
    if kind == "lines":
        return LineSettings(
            port=port, taxels=K, rate_hz=settings.rate_hz, noise_limit=limit, overload=254.0, positions_mm=positions
        )
    period_ms = round(1000 / settings.rate_hz)
    if abs(period_ms * settings.rate_hz - 1000) > 1e-6 * 1000 or not 1 <= period_ms <= 209:
        raise InputError(f"The iCub skin board sends every 1 to 209 ms; {settings.rate_hz:g} Hz is out of range.")
    if K > _ICUB_TAXELS:
        raise InputError(f"The iCub's fingertip has {_ICUB_TAXELS} taxels, not {K}; --sensor lines takes any number.")
    return IcubSettings(port=port, period_ms=period_ms, noise_limit=limit, order=list(range(K)), positions_mm=positions)


def _tap(settings: RigSettings, depth_mm: float) -> TapSettings:
    samples = settings.preprocessing.samples
    lead = min(round(_LEAD_S * settings.rate_hz), samples // 3)
    return TapSettings(
        depth_mm=depth_mm,
        samples=samples,
        lead_samples=max(lead, 1),
        period_s=settings.tap_period_s,
    )


def _lines(table: str, content: dict[str, Any]) -> list[str]:
    """Lines of a TOML table, its own values before its subtables."""
    values = {key: value for key, value in content.items() if value is not None and not isinstance(value, dict)}
    tables = {key: value for key, value in content.items() if isinstance(value, dict)}
    lines = [f"[{table}]"] if table and values else []
    lines += [f"{key} = {_value(value)}" for key, value in values.items()]
    lines += [""] if values else []
    for key, value in tables.items():
        lines += _lines(f"{table}.{key}" if table else key, value)
    return lines


def _value(value: Any) -> str:
    return str(value) if isinstance(value, float) else json.dumps(value, ensure_ascii=False)
