"""Checks that a recording will fit on its disk, before anything moves."""

import shutil
from pathlib import Path

from ...models.errors import InputError
from ..rig.settings import RigFile

_MARGIN = 2.0  # safety factor: a journal must not fail for a few bytes
_FRAME_BYTES, _TAXEL_BYTES, _OTHER_BYTES_PER_S = 130, 18, 20_000


def space_needed(taps: int, rig: RigFile) -> int:
    """Upper estimate of the size in bytes of a recording of so many taps."""
    taxels = len(rig.sensor.order) or rig.sensor.taxels
    per_s = rig.sensor.rate_hz * (_FRAME_BYTES + _TAXEL_BYTES * taxels) + _OTHER_BYTES_PER_S
    return int(_MARGIN * taps * rig.tap.period_s * per_s)


def check_space(path: str | Path, needed: int) -> None:
    """Checks that a file of this size fits on the disk.

    Raises:
        InputError: It does not fit, or the folder does not exist.
    """
    try:
        free = shutil.disk_usage(Path(path).parent).free
    except OSError as error:
        raise InputError(f"{path}: cannot write: {error.strerror or error}.") from error
    if free < needed:
        raise InputError(f"{path}: may need {needed / 1e6:.0f} MB, but only {free / 1e6:.0f} MB are free on the disk.")
