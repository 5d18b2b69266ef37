"""Whether a recording will fit on its disk, asked before anything moves."""

import shutil
from pathlib import Path

from ...models.errors import InputError
from ..rig.settings import RigFile

_MARGIN = 2.0  # a journal must not fail for want of a few bytes
_FRAME_BYTES, _TAXEL_BYTES, _OTHER_BYTES_PER_S = 130, 18, 20_000


def space_needed(taps: int, rig: RigFile) -> int:
    """Bytes that a recording of so many taps takes, generously."""
    taxels = len(rig.sensor.order) or rig.sensor.taxels
    per_s = rig.sensor.rate_hz * (_FRAME_BYTES + _TAXEL_BYTES * taxels) + _OTHER_BYTES_PER_S
    return int(_MARGIN * taps * rig.tap.period_s * per_s)


def check_space(path: str | Path, needed: int) -> None:
    """Whether a file of this size fits beside its neighbours.

    Raises:
        InputError: It does not, or the folder is not there.
    """
    try:
        free = shutil.disk_usage(Path(path).parent).free
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}.") from error
    if free < needed:
        raise InputError(
            f"{path} may grow to {needed / 1e6:.0f} MB and there are {free / 1e6:.0f} MB left on its disk."
        )
