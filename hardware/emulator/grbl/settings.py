"""Settings of an emulated GRBL controller: the numbered ones it stores, and its timing."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from .motion import MotionLimits, Steps, Vector

DEFAULTS: Mapping[int, float] = {
    0: 10, 1: 255, 2: 0, 3: 0, 4: 0, 5: 0, 6: 0,
    10: 1, 11: 0.01, 12: 0.002, 13: 0,
    20: 1, 21: 1, 22: 1, 23: 0, 24: 100.0, 25: 1000.0, 26: 250, 27: 1.0,
    30: 1000, 31: 0, 32: 0,
    100: 250.0, 101: 250.0, 102: 250.0,
    110: 3000.0, 111: 3000.0, 112: 3000.0,
    120: 500.0, 121: 500.0, 122: 500.0,
    130: 200.0, 131: 200.0, 132: 200.0,
}  # fmt: skip
"""Value of each `$n` (settings.md); unlike GRBL's defaults, for a stage with limit switches and homing."""

_FLAGS = {4, 5, 6, 13, 20, 21, 22, 32}
_WHOLE = _FLAGS | {0, 1, 2, 3, 10, 23, 26, 30, 31}


@dataclass(frozen=True)
class ControllerSettings:
    """An emulated controller.

    Attributes:
        values: `$n` that differ from `DEFAULTS`.
        firmware: `"Grbl"` or `"GrblHAL"`.
        version: Version of the firmware.
        homed: Whether it is homed before the port is opened; if not, it is as after power-up.
        start_mm: True start position; by default where homing ends, or mid-travel if not homed.
        work_offset_mm: Work zero (G54) in machine coordinates.
        receive_bytes: Size of the receive buffer; 1024 in grblHAL.
        homing_s: Duration of homing.
        line_s: Time from the end of a line to its answer.
        status_s: Time from `?` to its answer.
        start_s: Time from the `ok` of a G0 or G1 to its start, in which status reports Idle at the old position.
        ahead_s: Time of motion that is prepared and cannot change any more, up to 5 segments of 10 ms (stepper.c);
            braking begins behind it, and the reported speed is that at its end.
        write_s: Time to write a setting; bytes that arrive meanwhile are lost.
        alarm_s: Time to print an alarm, in which nothing else happens.
        reset_s: Time from a soft reset to the banner.
        boot_s: Time from power-up to the banner, including the boot loader.
        overrun_s: Overrun after the steps stop at speed, as its travel time at that speed.
    """

    values: Mapping[int, float] = field(default_factory=dict)
    firmware: str = "Grbl"
    version: str = "1.1h"
    homed: bool = False
    start_mm: Vector | None = None
    work_offset_mm: Vector = (0.0, 0.0, 0.0)
    receive_bytes: int = 128
    homing_s: float = 4.0
    line_s: float = 0.002
    status_s: float = 0.006
    start_s: float = 0.003
    ahead_s: float = 0.05
    write_s: float = 0.005
    alarm_s: float = 0.5
    reset_s: float = 0.004
    boot_s: float = 1.5
    overrun_s: float = 0.002


class Memory:
    """Numbered settings, which survive a loss of power.

    Args:
        changes: Values that differ from `DEFAULTS`.
    """

    def __init__(self, changes: Mapping[int, float]) -> None:
        self._values = {**DEFAULTS, **changes}

    def __getitem__(self, number: int) -> float:
        return self._values[number]

    def lines(self) -> list[str]:
        """Output of `$$`."""
        return [
            f"${number}={value:.0f}" if number in _WHOLE else f"${number}={value:.3f}"
            for number, value in self._values.items()
        ]

    def write(self, number: int, value: float) -> int:
        """Stores a value; returns 0, or the error number if refused (settings.c)."""
        soft_limits_without_homing = number == 20 and value > 0 and not self._values[22]
        refusals = {4: value < 0, 3: number not in self._values, 6: number == 0 and value < 3}
        refusals[10] = soft_limits_without_homing
        if code := next((code for code, refused in refusals.items() if refused), 0):
            return code
        self._values[number] = float(value > 0) if number in _FLAGS else value
        if number == 22 and not value:
            self._values[20] = 0.0
        return 0

    def axis(self, first: int) -> Vector:
        """Values of the three axes, from a setting number on."""
        return self._values[first], self._values[first + 1], self._values[first + 2]

    @property
    def axes(self) -> MotionLimits:
        """Limits of the axes; a stored rate of 0 gives a very slow axis."""
        x, y, z = (max(rate, 1e-3) / 60 for rate in self.axis(110))
        a, b, c = (max(value, 1e-3) for value in self.axis(120))
        p, q, r = (max(value, 1e-3) for value in self.axis(100))
        return MotionLimits((p, q, r), (x, y, z), (a, b, c))

    @property
    def home(self) -> Steps:
        """Position where homing ends: off the switches, at the negative end for axes in the mask `$23` (limits.c)."""
        off_mm, mask = self._values[27], int(self._values[23])
        x, y, z = (off_mm - travel if mask >> axis & 1 else -off_mm for axis, travel in enumerate(self.axis(130)))
        return self.axes.steps((x, y, z))

    def leaves_travel(self, place_mm: Vector) -> bool:
        """Whether soft limits are on and a position lies outside `-travel` to 0 on an axis."""
        outside = (not -travel <= mm <= 0.0 for mm, travel in zip(place_mm, self.axis(130), strict=True))
        return bool(self._values[20]) and any(outside)
