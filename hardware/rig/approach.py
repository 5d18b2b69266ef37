"""First approach to an object: slow, in small steps, until the finger touches it."""

import math
from dataclasses import dataclass, field

from .rig import Rig

SLOW_MM_S = 1.0
STEP_MM = 0.1
_READINGS = 5  # at each step; three show a touch
_NEAR_MM = 0.3
_RELEASE_S = 1.0
_ROUNDING = 1e-6


@dataclass
class Approach:
    """What an approach found.

    Attributes:
        clear_mm: Where it began.
        depth_mm: Where it would have ended without a touch.
        contact_mm: y of the first touch; `None` without one.
        wrong: Problems, one sentence each.
    """

    clear_mm: float
    depth_mm: float
    contact_mm: float | None = None
    wrong: list[str] = field(default_factory=list)


def approach(rig: Rig, x_mm: float) -> Approach:
    """Lowers the finger of a connected rig from `tap.clear_mm` until it touches, and lifts it.

    It goes to `tap.depth_mm` at most.

    Args:
        rig: The rig.
        x_mm: Where along the finger.

    Raises:
        OutOfLimits: The place lies outside the range.
        RigError: A device failed; the rig is at rest.
    """
    tap, monitor = rig.settings.tap, rig.skin.monitor
    found = Approach(tap.clear_mm, tap.depth_mm)
    rig.go(x_mm)
    pause_s = _READINGS / rig.settings.sensor.rate_hz
    steps = math.ceil((tap.depth_mm - tap.clear_mm) / STEP_MM - _ROUNDING)
    with rig.resting_on_trouble(), rig.loop.guarded(monitor.check), rig.loop.guarded(rig.stage.check):
        for i in range(1, steps + 1):
            y_mm = min(tap.clear_mm + i * STEP_MM, tap.depth_mm)
            rig.stage.move(y_mm=y_mm, speed_mm_s=SLOW_MM_S)
            rig.loop.sleep(pause_s)
            if monitor.touches:
                found.contact_mm = y_mm
                break
        rig.clear()
        rig.loop.sleep(_RELEASE_S)
    if found.contact_mm is None:
        found.wrong.append(
            f"nothing was touched between y = {tap.clear_mm:g} and {tap.depth_mm:g} mm: is the object in place, does y "
            f"rise towards it (stage.y.direction), is tap.depth_mm large enough?"
        )
    elif found.contact_mm < tap.clear_mm + _NEAR_MM:
        found.wrong.append(
            f"the object begins at y = {found.contact_mm:.1f} mm, less than {_NEAR_MM:g} mm from tap.clear_mm = "
            f"{tap.clear_mm:g}, so the finger may touch it in passing; lower clear_mm."
        )
    if monitor.touches:
        found.wrong.append(f"the readings have not returned {_RELEASE_S:g} s after the finger was lifted.")
    return found
