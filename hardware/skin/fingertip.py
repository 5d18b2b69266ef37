"""iCub fingertip behind an SLCAN adapter, as a `Skin`.

The start sequence follows the stock driver (`CanBusSkin.cpp`): configure the board, wait, enable the triangle (the
board then calibrates), wait, start. The board acknowledges none of these, so only arriving readings confirm success.
"""

import numpy as np
from numpy.typing import NDArray

from ..errors import NoAnswer, RigError, SensorFault, WrongDevice
from ..journal import Journal
from ..link.loop import Loop
from ..link.port import Port
from ..rig.settings import IcubSettings, SensorSettings
from .can_adapter import CanAdapter
from .icub import (
    BoardVersion,
    Head,
    MessageClass,
    Pairing,
    Sensor,
    SkinReading,
    Tail,
    address,
    board_command,
    decode,
    start_command,
    stop_command,
    triangles_command,
    version_command,
)
from .line_sensor import LineSensor
from .monitor import Skin, SkinMonitor
from .skin import SkinCounts, SkinFrame, SkinLimits, ignore_frame
from .slcan import RemoteFrame, SlcanFrame

SETTLE_S = 0.5
"""Waiting time in seconds after configuring the board, as in the stock driver; suffices for a calibration too."""
VERSION_S = 0.3
FIRST_READING_S = 1.5
PAIRING_PERIODS = 0.75
"""If halves of two ticks are joined because the others were lost, one reading is missing, so the loss is found."""
_LAST = 255
_BLIND_END = 0.5  # a taxel at rest with a mean this close to the end of the range may be saturated
_TAXELS = np.arange(12)


class Fingertip:
    """A triangle of 12 taxels.

    Args:
        settings: Settings of the sensor.
        loop: Loop that reads the port.
        journal: Journal for readings, commands and faults.
        port: Port to use instead of that of the settings.

    Attributes:
        port: Port of the adapter.
        on_frame: Called with every reading once the stream is started.
        monitor: Checks of the readings.
        version: Version of the board, None if it does not answer.
    """

    def __init__(self, settings: IcubSettings, loop: Loop, journal: Journal, port: Port | None = None) -> None:
        self.port = port or Port(settings.port, settings.baud)
        self.on_frame = ignore_frame
        self.version: BoardVersion | None = None
        self._settings = settings
        self._loop = loop
        self._journal = journal
        self._adapter = CanAdapter(self.port, settings.acks, loop, journal, self._receive)
        self.monitor = SkinMonitor(_limits(settings, self.port.address), loop, journal)
        self._sensor = Sensor(settings.board, settings.triangle)
        self._order = np.array(settings.order)
        self._others: set[Sensor] = set()
        self._pairing = self._new_pairing()
        self._streaming = False

    @property
    def taxels(self) -> int:
        """`K`."""
        return self._settings.taxels

    @property
    def rate_hz(self) -> float:
        """Configured readings per second."""
        return self._settings.rate_hz

    @property
    def counts(self) -> SkinCounts:
        """Counts of faults so far."""
        counts = self.monitor.counts
        counts.unpaired = self._pairing.lost_heads + self._pairing.lost_tails
        counts.dropped = self._adapter.dropped
        counts.refused = self._adapter.refused
        return counts

    def listen(self) -> None:
        """Opens the port, configures board and triangle and starts the readings.

        Raises:
            RigError: The device is missing or unexpected; the port is closed again.
        """
        try:
            self._adapter.open()
            self._ask_version()
            self._set_up()
            self._wait_for_readings()
        except BaseException:
            self.stop()
            raise

    def stop(self) -> None:
        """Stops the readings and closes the port; never raises a `RigError`."""
        self._streaming = False
        self.monitor.begin()
        self._adapter.close(stop_command(self._settings.board))

    def _ask_version(self) -> None:
        self.version = None
        self._adapter.transmit(version_command(self._settings.board), "version (1C)")
        until = self._loop.now + VERSION_S
        while self.version is None and self._loop.now < until:
            self._loop.turn(until)
        self._journal.event(self._loop.now, "board", _described(self.version))

    def _set_up(self) -> None:
        settings, board = self._settings, self._settings.board
        self._adapter.transmit(stop_command(board), "stop (07 01)")
        command = board_command(board, period_ms=settings.period_ms, no_load=settings.no_load)
        self._adapter.transmit(command, "board (4D)")
        self._loop.sleep(SETTLE_S)
        triangle = settings.triangle
        self._adapter.transmit(triangles_command(board, triangle, triangle), "triangle (50)")
        self._loop.sleep(SETTLE_S)
        self._pairing = self._new_pairing()
        self._others.clear()
        self.monitor.begin()
        self._streaming = True
        self._adapter.transmit(start_command(board), "start (07 00)")

    def _wait_for_readings(self) -> None:
        wait_s = FIRST_READING_S + 3.0 / self.rate_hz
        if not self.monitor.comes(wait_s):
            raise self._no_readings(wait_s)

    def _no_readings(self, wait_s: float) -> RigError:
        name, sensor = self.port.address, f"board {self._sensor.board}, triangle {self._sensor.triangle}"
        if self._adapter.is_noise:
            return self._adapter.noise()
        if self._pairing.waiting:
            return SensorFault(
                f"{name}: only half readings arrive from {sensor}; the other halves are lost on the link."
            )
        if self._others:
            others = ", ".join(f"board {board}, triangle {triangle}" for board, triangle in sorted(self._others))
            return WrongDevice(
                f"{name}: no readings from {sensor}, but from {others}; check sensor.board and sensor.triangle."
            )
        return NoAnswer(
            f"{name}: no readings from {sensor} within {wait_s:.1f} s; check its power, the CAN bus and that an SLCAN "
            f"adapter is at this port."
        )

    def _new_pairing(self) -> Pairing:
        return Pairing(PAIRING_PERIODS / self._settings.rate_hz)

    def _receive(self, frame: SlcanFrame | RemoteFrame, time_s: float) -> None:
        unit = decode(frame)
        if isinstance(unit, BoardVersion) and unit.board == self._sensor.board:
            self.version = unit
        if not self._streaming:
            return
        if isinstance(unit, Head | Tail) and unit.sensor == self._sensor:
            if reading := self._pairing.push(unit, time_s):
                self._take(reading)
        elif address(frame.identifier).message_class != MessageClass.COMMAND:
            self.monitor.counts.foreign += 1
            if isinstance(unit, Head | Tail):
                self._others.add(unit.sensor)

    def _take(self, reading: SkinReading) -> None:
        raw = np.frombuffer(reading.taxels, np.uint8)[self._order].astype(np.float64)
        frame = SkinFrame(reading.time_s, raw, _LAST - raw, self._valid(reading, raw))
        self._journal.frame(frame)
        self.monitor.take(frame, frame.time_s)
        self.on_frame(frame)

    def _valid(self, reading: SkinReading, raw: NDArray[np.float64]) -> NDArray[np.bool_]:
        if reading.error or (raw == 0).all() or (raw == _LAST).all():
            return np.zeros(len(raw), bool)
        if reading.out_of_range:
            return ((reading.out_of_range >> _TAXELS) & 1 == 0)[self._order]
        return np.ones(len(raw), bool)


def make_skin(settings: SensorSettings, loop: Loop, journal: Journal) -> Skin:
    """Driver of a sensor."""
    if isinstance(settings, IcubSettings):
        return Fingertip(settings, loop, journal)
    return LineSensor(settings, loop, journal)


def _described(version: BoardVersion | None) -> str:
    if version is None:
        return "the board does not report its version"
    firmware = ".".join(map(str, version.firmware))
    return f"board {version.board} of type {version.board_type} has firmware {firmware}"


def _limits(settings: IcubSettings, name: str) -> SkinLimits:
    return SkinLimits(
        name=name,
        taxels=settings.taxels,
        rate_hz=settings.rate_hz,
        idle_low=settings.no_load - settings.no_load_band,
        idle_high=settings.no_load + settings.no_load_band,
        highest=_LAST - _BLIND_END,
        noise_limit=settings.noise_limit,
        overload=_LAST - settings.overload,
        stuck_readings=settings.stuck_readings,
        stale_s=settings.stale_s,
    )
