"""Whether the cases of a folder are those of this version, by fingerprints that are frozen in fingerprints.json.

Computing the cases and their answers again would take seconds.
"""

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from hashlib import sha256
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np

from ..answers import Answer
from ..case import Case
from ..tolerance import Precision

FINGERPRINTS = "fingerprints.json"
_LENGTH = 16  # digits of a checksum


class Frozen(NamedTuple):
    """What is known of a case of this version.

    Attributes:
        level: Which it belongs to.
        double: Its fingerprint with the tolerances of double precision.
        single: Likewise; `None` where 32 bits cannot do it.
    """

    level: str
    double: str
    single: str | None


@cache
def frozen() -> Mapping[str, Frozen]:
    """The fingerprints of this version by case."""
    known = json.loads(files(__package__).joinpath(FINGERPRINTS).read_text(encoding="utf-8"))
    return {name: Frozen(*parts) for name, parts in known.items()}


def frozen_sizes() -> Mapping[str, int]:
    """Number of cases of this version by level."""
    return Counter(case.level for case in frozen().values())


def is_own(case: Case, precision: Precision) -> bool:
    """Whether a case of a folder, with its answers, tolerances and allowed choices, is that of this version."""
    known = frozen().get(case.name)
    if known is None:
        return False
    own = known.double if precision == "double" else known.single
    return known.level == case.level and own == (None if case.absent else fingerprint(case))


def fingerprint(case: Case) -> str:
    """The start of a checksum of a case of a folder, with its answers, tolerances and allowed choices."""
    assert case.pinned is not None  # noqa: S101 - only these have tolerances of their own
    parts = [(field.name, _plain(getattr(case, field.name))) for field in fields(case) if field.name != "pinned"]
    answers = [_answer_parts(answer) for answer in case.pinned.answers]
    bounds = [(name, *(f"{bound:.6g}" for bound in pair)) for name, pair in sorted(case.pinned.tolerances.items())]
    return sha256(repr((parts, answers, bounds)).encode()).hexdigest()[:_LENGTH]


def _answer_parts(answer: Answer) -> Any:
    values = [(name, _plain(np.asarray(value))) for name, value in sorted(answer.values.items())]
    allowed = answer.allowed and (
        [sorted(choices) for choices in answer.allowed.decisions],
        sorted(answer.allowed.moves),
    )
    return answer.tap, answer.error, values, allowed


def _plain(value: Any) -> Any:
    """A value whose text tells it; arrays as shape and checksum of their doubles."""
    if isinstance(value, np.ndarray):
        return value.shape, sha256(value.astype("<f8").tobytes()).digest()
    if isinstance(value, tuple):
        return tuple(_plain(part) for part in value)
    return value
