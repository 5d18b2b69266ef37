"""Named settings of the simulated rig."""

from collections.abc import Sequence
from dataclasses import replace

from ...models.errors import InputError
from .settings import RigSettings

_NO_DRIFT = RigSettings(session_gain_log_sd=0.0, session_taxel_gain_log_sd=0.0, mounting_x_mm=0.0, mounting_y_mm=0.0)

PRESETS = {
    "paper": RigSettings(),
    "ideal": replace(
        _NO_DRIFT,
        white_counts=1.7,
        taxel_noise_counts=0.0,
        common_noise_counts=0.0,
        walk_counts=0.0,
        tap_depth_log_sd=0.0,
        tap_time_samples=0.0,
        tap_position_mm=0.0,
    ),
    "broken": RigSettings(common_noise_counts=6.0),
    "hold2": RigSettings(hold_samples=2),
    "nodrift": _NO_DRIFT,
}
"""Settings by name: the paper's rig; one without nuisances; one with strong common noise; one that reads every second
frame; one whose sessions are all alike."""


def preset(name: str, others: Sequence[str] = ()) -> RigSettings:
    """The settings of that name.

    Args:
        name: A key of `PRESETS`.
        others: Further names that the caller would take, for the message.

    Raises:
        InputError: There is no such preset.
    """
    if name not in PRESETS:
        raise InputError(f"There is no preset {name!r}; the presets are {', '.join([*PRESETS, *others])}.")
    return PRESETS[name]
