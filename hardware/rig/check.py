"""Check of a rig at rest: devices, rate, noise, limits and problems."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from ..errors import RigError
from ..skin.skin import SkinFrame, taxel_names
from ..stage.leg import check_tap_speed
from .rest import never_opened, resting_place
from .rig import Rig
from .settings import StageSettings

_RATE_TOLERANCE = 0.02
_DRIFT_PER_MIN = 20.0
_DRIFT_S = 10.0  # over a shorter time slow noise looks like drift
_BLOCKS = 8
_LEAST_READINGS = 2 * _BLOCKS


@dataclass(frozen=True, eq=False)
class SensorReport:
    """Readings of an untouched sensor.

    Attributes:
        readings: Number of readings.
        rate_hz: Readings per second, from the first to the last.
        loss: Fraction of the readings lost.
        idle: Mean of each taxel as sent, shape (K,).
        noise: Standard deviation of each taxel about its drift, shape (K,).
        drift_per_min: Slope of each taxel in units per minute, shape (K,).
        drift_error: Half width of its 95% interval, shape (K,).
    """

    readings: int
    rate_hz: float
    loss: float
    idle: NDArray[np.float64]
    noise: NDArray[np.float64]
    drift_per_min: NDArray[np.float64]
    drift_error: NDArray[np.float64]


@dataclass
class RigReport:
    """Results of a check.

    Attributes:
        lines: Findings, as pairs of a name and a value.
        sensor: Statistics of the readings, None if there were none.
        wrong: Problems, one sentence each.
    """

    lines: list[tuple[str, str]] = field(default_factory=list)
    sensor: SensorReport | None = None
    wrong: list[str] = field(default_factory=list)


def sensor_report(frames: Sequence[SkinFrame], lost: int) -> SensorReport:
    """Rate, loss, noise and drift of readings without contact.

    Args:
        frames: Readings in the order of time, at least 16.
        lost: Number of readings lost meanwhile.
    """
    time_s = np.array([frame.time_s for frame in frames])
    raw = np.array([frame.raw for frame in frames])
    _, level, residual = _line(time_s, raw)
    drift, drift_error = _drift(time_s, raw)
    return SensorReport(
        readings=len(frames),
        rate_hz=float((len(frames) - 1) / (time_s[-1] - time_s[0])) if time_s[-1] > time_s[0] else np.inf,
        loss=lost / (len(frames) + lost),
        idle=level,
        noise=np.where((raw == raw[0]).all(axis=0), 0.0, np.sqrt((residual**2).sum(axis=0) / (len(frames) - 2))),
        drift_per_min=60.0 * drift,
        drift_error=60.0 * drift_error,
    )


def _line(
    time_s: NDArray[np.float64], values: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Slope, central level and residuals of a straight line fitted to each column."""
    centred = time_s - time_s.mean()
    slope, level = np.polyfit(centred, values, 1)
    return slope, level, values - level - np.outer(centred, slope)


def _drift(time_s: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Slope per second and half width of its 95% interval.

    The noise of successive readings is correlated, so the line is fitted to block means, which are nearly independent.
    """
    blocks = np.array_split(np.arange(len(time_s)), _BLOCKS)
    at_s = np.array([time_s[block].mean() for block in blocks])
    slope, _, residual = _line(at_s, np.array([values[block].mean(axis=0) for block in blocks]))
    freedom = _BLOCKS - 2
    error = np.sqrt((residual**2).sum(axis=0) / freedom / ((at_s - at_s.mean()) ** 2).sum())
    return slope, stdtrit(freedom, 0.975) * error


def check_rig(rig: Rig, seconds: float = 10.0, home: bool = False) -> RigReport:
    """Opens both devices, reads the sensor at rest, and closes them; nothing moves unless `home`.

    A failure of one device does not prevent the check of the other.

    Args:
        rig: Rig, not connected yet.
        seconds: Duration of the readings, in rig time.
        home: Whether to home the stage, which tests its switches.
    """
    report = RigReport()
    try:
        _look_at_stage(rig, report, home)
        _look_at_sensor(rig, report, seconds)
    except BaseException as trouble:
        if not never_opened(trouble, rig):
            trouble.add_note(resting_place(rig.stage.position_mm, rig.may_press, rig.skin.monitor.touches))
        raise
    finally:
        rig.skin.stop()
        rig.stage.close()
    return report


def _look_at_stage(rig: Rig, report: RigReport, home: bool) -> None:
    settings, stage = rig.settings.stage, rig.stage
    report.lines.append(("stage", settings.port))
    try:
        check_tap_speed(rig.settings, stage.connect(will_home=home).values)
        if home:
            rig.skin.listen()
            rig.home()
    except RigError as error:
        report.wrong.append(str(error))
    if (found := stage.report) is None:
        return
    report.lines.append(("  controller", f"{found.firmware}, {found.state} when opened"))
    for name, axis in (("x", settings.x), ("y", settings.y)):
        number = "XYZ".index(axis.letter)
        machine = sorted((axis.machine_mm(axis.low_mm), axis.machine_mm(axis.high_mm)))
        report.lines.append(
            (
                f"  {name} is {axis.letter}",
                f"{axis.low_mm:g} to {axis.high_mm:g} mm, in machine coordinates {machine[0]:g} to {machine[1]:g} of "
                f"-{found.values[130 + number]:g} to 0; at most {found.values[110 + number] / 60:g} mm/s, "
                f"{found.values[120 + number]:g} mm/s²",
            )
        )
    place = stage.position_mm
    report.lines.append(("  position", _placed(place, settings) if place else "unknown"))
    report.wrong.extend(found.notes)
    if place is None:
        report.wrong.append(f"{settings.port}: position unknown; home the stage first (--home).")


def _placed(place_mm: tuple[float, float], settings: StageSettings) -> str:
    axes = (settings.x, settings.y)
    inside = all(axis.low_mm <= mm <= axis.high_mm for mm, axis in zip(place_mm, axes, strict=True))
    beyond = "" if inside else ", outside the limits, as after homing; the first move brings it back"
    return f"x = {place_mm[0]:z.3f}, y = {place_mm[1]:z.3f} mm{beyond}"


def _look_at_sensor(rig: Rig, report: RigReport, seconds: float) -> None:
    sensor, skin = rig.settings.sensor, rig.skin
    report.lines.append(("sensor", sensor.port))
    frames: list[SkinFrame] = []
    try:
        if not skin.port.is_open:
            skin.listen()
        skin.monitor.measure_baseline()
        skin.on_frame = frames.append
        lost = skin.counts.lost
        with rig.loop.guarded(skin.monitor.check):
            rig.loop.sleep(seconds)
        lost = skin.counts.lost - lost
    except RigError as error:
        if str(error) not in report.wrong:
            report.wrong.append(str(error))
        return
    if len(frames) < _LEAST_READINGS:
        report.wrong.append(
            f"{sensor.port}: {len(frames)} readings in {seconds:g} s are too few to assess; read for longer."
        )
        return
    report.sensor = found = sensor_report(frames, lost)
    if abs(found.rate_hz / sensor.rate_hz - 1) > _RATE_TOLERANCE:
        report.wrong.append(f"{sensor.port}: {found.rate_hz:.2f} readings per second instead of {sensor.rate_hz:g}.")
    if found.loss > 0:
        total = len(frames) + lost
        report.wrong.append(f"{sensor.port}: {lost} of {total} readings were lost; taps with losses are repeated.")
    drifts = np.abs(found.drift_per_min) - found.drift_error > _DRIFT_PER_MIN
    for k in np.flatnonzero(drifts) if seconds >= _DRIFT_S else ():
        drift, error = found.drift_per_min[k], found.drift_error[k]
        report.wrong.append(
            f"{sensor.port}: taxel {k} drifts by {drift:+.1f} ± {error:.1f} per minute; let the sensor warm up."
        )
    if (still := found.noise == 0).any():  # a quiet taxel may read a constant
        report.lines.append(("  at rest", f"{taxel_names(still)} constant; touch to test"))
    others = {name: n for name, n in vars(skin.counts).items() if n and name not in ("frames", "lost")}
    if others:
        report.wrong.append(
            f"{sensor.port}: " + ", ".join(f"{n} {name}" for name, n in others.items()) + " since the port was opened."
        )
