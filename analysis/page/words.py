"""Sentences and lists shared by the pages of several studies."""

import platform
from collections.abc import Sequence
from importlib.metadata import version

STORED = (
    "Stored taps: test taps are drawn with replacement up to the deadline, as in the paper, so long trials repeat taps."
)
"""What trials that draw with replacement estimate."""
STORED_ONLY = f"{STORED} Errors on fresh taps (each drawn at most once per trial) differ."
"""The same where fresh taps are not played."""


def listed(names: Sequence[str]) -> str:
    """Names with commas and an "and"."""
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)


def versions(packages: Sequence[str]) -> dict[str, str]:
    """Of Python and these packages, by name."""
    return {"python": platform.python_version()} | {name: version(name) for name in packages}
