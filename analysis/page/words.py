"""Sentences and lists that pages of several studies share."""

from collections.abc import Sequence

STORED = (
    "Stored taps: test taps are drawn with replacement up to the deadline, as in the paper, so long trials see the "
    "same taps again."
)
"""What trials that draw with replacement estimate."""
STORED_ONLY = f"{STORED} Errors on fresh taps, of which none is drawn twice in a trial, differ."
"""The same where fresh taps are not played."""


def listed(names: Sequence[str]) -> str:
    """Names with commas and an "and"."""
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)
