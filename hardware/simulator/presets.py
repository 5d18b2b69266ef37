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
"""Settings by name: the paper's rig; without nuisances; with strong common noise; with every second frame repeated;
with identical sessions."""


def preset(name: str, others: Sequence[str] = ()) -> RigSettings:
    """Settings of a preset.

    Args:
        name: A key of `PRESETS`.
        others: Further names that the caller accepts, for the message.

    Raises:
        InputError: The preset is unknown.
    """
    if name not in PRESETS:
        raise InputError(f"Unknown preset {name!r}; choose from {', '.join([*PRESETS, *others])}.")
    return PRESETS[name]
