"""Rig: a stage that moves a tactile sensor, with the same interface as simulated and replayed rigs.

On any failure (an exception, Ctrl-C or a device), the finger is stopped and lifted off the object before the error is
reported.
"""

import math
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.cutting.tap_cutter import TapCutter
from ...models.preprocessing import Preprocessing
from ..emulator.shared_clock import Connection
from ..errors import (
    OutOfLimits,
    PortLost,
    PositionUnknown,
    RigError,
    SensorFault,
    SensorOverload,
    StageFault,
)
from ..journal import Journal
from ..link.loop import Loop
from ..sensor import clipped_move
from ..skin.monitor import Skin, implausible, touches
from ..skin.skin import SkinFrame
from ..stage.leg import check_side, check_tap_speed
from ..stage.stage import Stage
from .deferred_signals import signals_deferred
from .rest import resting_place, still_pressing
from .settings import RigFile

_ROUNDING = 1e-6
_DEPTH_MARGIN_MM = 0.05
_AWAY_MM = 0.05
_LATE_S = 0.5
_RELEASE_S = 1.0
_SEEN_S = 0.3  # the end of a motion shows in two reports, a tenth of a second apart


@dataclass
class TapTally:
    """Numbers of taps.

    Attributes:
        accepted: Accepted taps.
        rejected: Taps with implausible readings, which were repeated.
        touched: Accepted taps that touched something.
    """

    accepted: int = 0
    rejected: int = 0
    touched: int = 0


class Rig:
    """A `TouchSensor` consisting of a stage and a skin.

    A tap is a press and a release in one motion, sent just after a reading, so that contact falls on the same sample of
    each tap. A tap with incomplete or implausible readings is repeated.

    Args:
        settings: Settings of the rig.
        loop: Loop that reads both devices.
        stage: Stage, connected by `connect`.
        skin: Skin, started by `connect`.
        journal: Journal for all events.

    Attributes:
        label: Label of the next taps in the journal, as JSON values.
        tally: Numbers of taps so far.
        rest: Where `close` left the finger, as a sentence.
        slow_mm_s: Speed of all moves but taps; `None` for that of the axes.
        emulator: Clock of emulated devices, which takes orders such as putting objects under the finger; else None.
    """

    def __init__(self, settings: RigFile, loop: Loop, stage: Stage, skin: Skin, journal: Journal) -> None:
        self.settings = settings
        self.loop = loop
        self.stage = stage
        self.skin = skin
        self.label: Mapping[str, Any] = {}
        self.tally = TapTally()
        self.rest = resting_place()
        self.slow_mm_s: float | None = None
        self.emulator: Connection | None = None
        self._journal = journal
        self._cutter = TapCutter(self.preprocessing)
        self._frames: deque[SkinFrame] = deque(maxlen=self.preprocessing.frames)
        self._arrived = self._rest_from = 0
        self._tap: tuple[NDArray[np.float64], tuple[SkinFrame, ...]] | None = None
        self._place_mm = settings.range.start_mm + settings.range.cell_mm / 2
        self._pressed_s = -np.inf
        skin.on_frame = self._take

    @property
    def preprocessing(self) -> Preprocessing:
        """Preprocessing of the taps."""
        return self.settings.preprocessing

    @property
    def place_mm(self) -> float:
        """Commanded position along x of the rig frame."""
        return self._place_mm

    @property
    def where_index(self) -> int:
        """Index of the current position."""
        limits = self.settings.range
        cell = np.floor((self._place_mm - limits.start_mm) / limits.cell_mm + _ROUNDING)
        return int(np.clip(cell, 0, limits.where_classes - 1))

    @property
    def step(self) -> float:
        """Length of a step in mm."""
        return self.settings.range.cell_mm

    @property
    def room(self) -> tuple[int, int]:
        """Steps left to either end of the range."""
        return self.where_index, self.settings.range.where_classes - 1 - self.where_index

    def connect(self, home: bool = False) -> None:
        """Opens both devices, starts the readings, and lifts the finger off the object.

        Args:
            home: Whether to home the stage first, see `home`.

        Raises:
            PositionUnknown: The stage needs homing.
            RigError: A device is missing, unexpected or failing.
        """
        check_tap_speed(self.settings, self.stage.connect(will_home=home).values)
        if not home and (position := self.stage.position_mm) is not None:
            check_side(self.settings.stage, position[1])
        self.skin.listen()
        self._journal.event(self.loop.now, "stream", "the readings start")
        if home:
            self.home()
        if self.stage.position_mm is None:
            port = self.settings.stage.port
            raise PositionUnknown(f"{port}: position unknown; clear the path of the stage and home it (--home).")
        if pressing := self.may_press:
            self.clear()
        if home or pressing:
            self.skin.stop()  # a board that calibrated under load reads wrong afterwards
            self.skin.listen()
        self.skin.monitor.measure_baseline()
        if not pressing:
            self.clear()
        self._cutter = TapCutter(self.preprocessing)
        self._journal.event(self.loop.now, "stream", "taps are cut from here on")
        self._rest_from = self._arrived
        self.go(self._place_mm)

    def home(self) -> None:
        """Homes the stage, which moves it to its limit switches while the readings are watched for an overload.

        The path cannot be watched, as the controller sends no reports meanwhile.

        Raises:
            SensorOverload: A taxel saturated; the controller was reset.
            RigError: A device failed, or there are no readings.
        """
        monitor = self.skin.monitor
        self._wait_for_frames(1)
        pressed = monitor.overloaded(self._frames[-1])

        def overloaded(now_s: float) -> None:
            monitor.check(now_s)
            if not pressed and monitor.overloaded(self._frames[-1]):
                raise SensorOverload(f"{self.settings.sensor.port}: a taxel saturated while homing.")

        with self.loop.guarded(overloaded):
            self.stage.home()

    @property
    def may_press(self) -> bool:
        """Whether the finger may be nearer to the object than `tap.clear_mm`."""
        position = self.stage.position_mm
        return position is None or position[1] > self.settings.tap.clear_mm + _AWAY_MM

    def clear(self) -> None:
        """Moves to `tap.clear_mm`, off the object, or from farther away.

        Raises:
            RigError: A device does not respond, or the finger touched something on its way towards the object.
        """
        monitor = self.skin.monitor
        free = nullcontext() if self.may_press else self.loop.guarded(monitor.check_free)
        with self.loop.guarded(monitor.check), free:
            self.stage.move(y_mm=self.settings.tap.clear_mm, speed_mm_s=self.slow_mm_s)

    def go(self, x_mm: float) -> None:
        """Moves to a position along the finger, clear of the object.

        Raises:
            OutOfLimits: The position lies outside the range; nothing moved.
            RigError: A device failed; the rig is at rest.
        """
        limits = self.settings.range
        if not limits.start_mm - _ROUNDING <= x_mm <= limits.end_mm + _ROUNDING:
            raise OutOfLimits(
                f"x = {x_mm:g} mm is outside the range of {self.settings.name}, "
                f"{limits.start_mm:g} to {limits.end_mm:g} mm."
            )
        self._check_connected()
        with self.resting_on_trouble():
            self._lift()
            self._pass(float(x_mm))
        self._place_mm = float(x_mm)

    def move(self, delta: int) -> int:
        """Moves by `delta` positions, at most to the end of the range; returns the steps made."""
        steps = clipped_move(delta, self.room)
        if steps:
            self.go(self._place_mm + steps * self.settings.range.cell_mm)
        return steps

    def tap(self) -> NDArray[np.float64]:
        """Samples of one tap, shape (J, K).

        Raises:
            SensorFault: The readings of several taps were implausible, or the sensor failed.
            RigError: A device failed; in either case the rig is at rest.
        """
        self._check_connected()
        reasons: list[str] = []
        while len(reasons) <= self.settings.tap.retries:
            with self.resting_on_trouble():
                samples, reason = self._attempt()
            self._journal.tap(self.loop.now, reason is None, reason or "")
            if reason is None:
                self.tally.accepted += 1
                self.tally.touched += touches(samples, self.settings.tap.lead_samples, self.settings.sensor.noise_limit)
                return samples
            self.tally.rejected += 1
            reasons.append(reason)
        raise SensorFault(
            f"{self.settings.sensor.port}: no plausible tap in {len(reasons)} attempts: {'; '.join(reasons)}."
        )

    def close(self) -> None:
        """Lifts the finger off the object, unless there were no readings yet, and closes both devices.

        Raises:
            RigError: The finger could not be lifted; both devices are closed nevertheless.
        """
        with signals_deferred():
            try:
                if self.stage.position_mm is not None:
                    self._rest() if self._arrived else self.stage.stop()
                    with suppress(RigError):
                        self.loop.wait_for(lambda: not self.skin.monitor.touches, _RELEASE_S, "The finger touches.")
                    self.rest = resting_place(self.stage.position_mm, self.may_press, self.skin.monitor.touches)
            finally:
                self.skin.stop()
                self.stage.close()

    def _attempt(self) -> tuple[NDArray[np.float64], str | None]:
        """Samples of one press and release, and why they are implausible, or None."""
        settings, sensor = self.settings, self.settings.sensor
        with self.loop.guarded(self.skin.monitor.check), self.loop.guarded(self.stage.check):
            self._stand()
            lead = math.ceil(settings.tap.lead_samples / self.preprocessing.ratio)
            self._wait_for_frames(self._rest_from + lead - 1 - self._arrived)
            if (early_s := self._pressed_s + settings.tap.period_s - self.loop.now) > 0:
                self.loop.sleep(early_s - 0.5 / sensor.rate_hz)
            self._wait_for_frames(1)
            self.skin.monitor.check_rest(tuple(self._frames)[-lead:])
            self._tap = None
            self._pressed_s = self.loop.now
            self._journal.press(self._pressed_s, {**self.label, "x_mm": self._place_mm})
            self._cutter.press()
            unanswered = self.stage.counts.unanswered
            self._press()
            ended_s = self.loop.now
            samples, frames = self._wait_for_tap()
            self._rest_from = self._arrived
        if self.stage.counts.unanswered > unanswered:
            return samples, "an answer of the stage was lost, so the press lasted too long"
        if ended_s - frames[-1 - self.preprocessing.frames_behind].time_s > _SEEN_S:
            return samples, "the finger was still moving when the readings of the tap ended"
        if self.preprocessing.sensor_hz is None:
            trace = implausible(samples, settings.tap.lead_samples, sensor.noise_limit)
        else:  # resampling would smear a reading that jumped
            readings = np.array([frame.values for frame in frames])
            before = sum(frame.time_s <= self._pressed_s for frame in frames)
            trace = implausible(readings, before, sensor.noise_limit)
        return samples, self.skin.monitor.verdict(frames) or trace

    def _check_connected(self) -> None:
        if self.stage.report is None or not (self.stage.port.is_open or self.skin.port.is_open):
            raise PositionUnknown(f"{self.settings.name}: the rig is not connected.")

    def _lift(self) -> None:
        """Moves to `tap.clear_mm` if a failure left the finger elsewhere."""
        position = self.stage.position_mm
        if position is None or abs(position[1] - self.settings.tap.clear_mm) > _AWAY_MM:
            self.clear()

    def _stand(self) -> None:
        """Moves to the position of the tap if a failure left the finger elsewhere."""
        self._lift()
        position = self.stage.position_mm
        if position is None or abs(position[0] - self._place_mm) > _AWAY_MM:
            self._pass(self._place_mm)

    def _pass(self, x_mm: float) -> None:
        """Moves along the finger, and stops if it touches something."""
        monitor = self.skin.monitor
        with (
            self.loop.guarded(monitor.check),
            self.loop.guarded(monitor.check_free),
            self.loop.guarded(self.stage.check),
        ):
            self.stage.move(x_mm=x_mm, speed_mm_s=self.slow_mm_s)

    def _press(self) -> None:
        tap = self.settings.tap
        speed = self.settings.stage.y.speed_mm_s if tap.speed_mm_s is None else tap.speed_mm_s
        with self.loop.guarded(self._watch):
            self.stage.path([(self._place_mm, tap.depth_mm, speed), (self._place_mm, tap.clear_mm, speed)])

    def _watch(self, now_s: float) -> None:  # noqa: ARG002 - the signature of a guard
        """Guard during a press.

        Raises:
            SensorOverload: A taxel saturated.
            StageFault: The finger is deeper than commanded.
        """
        frame = self._frames[-1]
        if self.skin.monitor.overloaded(frame):
            k, port = int(np.argmax(frame.values)), self.settings.sensor.port
            if not frame.valid[k]:
                raise SensorFault(f"{port}: taxel {k} is saturated and reported as broken.")
            raise SensorOverload(f"{port}: taxel {k} saturated and the finger was lifted; reduce tap.depth_mm.")
        position = self.stage.position_mm
        if position is not None and position[1] > self.settings.tap.depth_mm + _DEPTH_MARGIN_MM:
            raise StageFault(
                f"{self.settings.stage.port}: the finger was at y = {position[1]:.3f} mm, deeper than "
                f"tap.depth_mm = {self.settings.tap.depth_mm:g}, and was lifted."
            )

    def _take(self, frame: SkinFrame) -> None:
        self._frames.append(frame)
        self._arrived += 1
        for cut in self._cutter.push(frame.values[np.newaxis]):
            self._tap = cut.samples, tuple(self._frames)

    def _wait_for_frames(self, n: int) -> None:
        wanted = self._arrived + n
        self.loop.wait_for(
            lambda: self._arrived >= wanted,
            n / self.settings.sensor.rate_hz + _LATE_S,
            f"{self.settings.sensor.port}: {n} readings did not arrive in time.",
        )

    def _wait_for_tap(self) -> tuple[NDArray[np.float64], tuple[SkinFrame, ...]]:
        J = self.preprocessing.samples
        self.loop.wait_for(
            lambda: self._tap is not None,
            self.preprocessing.frames / self.settings.sensor.rate_hz + _LATE_S,
            f"{self.settings.sensor.port}: the {J} readings of a tap did not arrive in time.",
        )
        if self._tap is None:  # impossible after wait_for; for the type checker
            raise SensorFault(f"{self.settings.sensor.port}: lost the samples of a tap.")
        return self._tap

    @contextmanager
    def resting_on_trouble(self) -> Iterator[None]:
        """Brings the rig to rest if the block fails, including by Ctrl-C."""
        try:
            yield
        except BaseException as trouble:
            with signals_deferred():
                try:
                    self._rest()
                except RigError as worse:
                    raise still_pressing(trouble, worse) from trouble
            raise

    def _rest(self) -> None:
        """Stops the finger and lifts it off the object, never towards it, regardless of guards.

        Raises:
            RigError: The stage does not respond.
        """
        with self.loop.unguarded():
            try:
                self._retract()
            except PortLost:
                if not self.stage.port.is_open:
                    raise
                self._retract()  # the error was the sensor's, which is no longer read
        self._rest_from = self._arrived
        self._journal.event(self.loop.now, "rest", "the finger is off the object")

    def _retract(self) -> None:
        self.stage.stop()
        if self.may_press:
            self.stage.move(y_mm=self.settings.tap.clear_mm)
