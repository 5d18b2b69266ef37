"""Version of the kit, apart from that of the package, and where its exact answers come from.

CHANGELOG.md beside this file says what each version changed.
"""

from importlib.metadata import version
from typing import Any

from ..arithmetic import DIGITS

KIT_VERSION = "1.5.0"
RELEASED = "2026-11-28"
LICENSE = "CC0-1.0"
"""Of cases, answers, schemas and descriptions; the program that makes them has a licence of its own."""
METHOD = "the equations of the paper one by one, sharing no code with the engines that are checked"


def provenance() -> dict[str, Any]:
    """What the exact answers come from, as every case says."""
    return {
        "kit": KIT_VERSION,
        "program": "solidtouch",
        "program_version": version("solidtouch"),
        "method": METHOD,
        "library": "mpmath",
        "library_version": version("mpmath"),
        "digits": DIGITS,
    }
