"""Recorded episodes: the one data format of the page, its file, reports and notebooks.

A header says what is perceived with what; a record of each tap holds what `perceive --json` prints, the sentence of
the terminal, the whole belief and the samples; a record of each end holds the decision. docs/reference/episodes.md
describes the file.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...inference.novelty import FLAGGED
from ...models.errors import InputError, check_path
from ...models.grid import ClassGrid
from ...models.io.mistakes import decode_json
from ...models.preprocessing import Preprocessing
from ...models.storage import complete_file, reason
from .ending import Ending, end_record, said
from .view import Seen, record, sentence

FORMAT, VERSION = "solidtouch episodes", 1
_DIGITS = 7  # significant ones of a sample, those of single precision
_DECIMALS = 9  # of a belief, as in `view.record`
_EXACT = 22  # the highest power of ten that is exact in double precision

type _Positive = Annotated[int, msgspec.Meta(ge=1)]


class EpisodeHeader(msgspec.Struct, frozen=True, kw_only=True):
    """What holds for all taps.

    Attributes:
        heading: Rig and engine.
        what_name: Names of the objects, M of them.
        what_value: Their sizes, or `None`.
        what_unit: Unit of the sizes.
        where_value: Positions, L of them.
        where_label: The same with unit, in words.
        where_unit: Unit of the positions; empty where they number places in a plane.
        where_edges: Edges of the position classes, L + 1 of them, or `None`.
        where_place: Places in a plane, L of them, or `None`.
        theta: Threshold on the belief in an object, or `None` for a rule without one.
        rule: Name of the stopping rule where it is not the threshold.
        fixation: Index of the fixation point, or `None`.
        deadline: Most taps of an episode, or `None`.
        samples: Samples of a tap, J.
        taxels: Taxels, K.
        rate_hz: Sampling rate, or `None`.
        pre_samples: Samples before the contact.
        taxel_mm: Places of the taxels in a plane, K pairs in mm, or `None`.
        flagged: P-value below which a tap is unusual.
        seed: Random seed of the episodes, or `None`.
        reading_unit: Unit of the samples; empty if it is not known, and in older files.
    """

    heading: str
    what_name: list[str]
    what_value: list[float] | None
    what_unit: str
    where_value: list[float]
    where_label: list[str]
    where_unit: str
    where_edges: list[float] | None
    where_place: list[list[float]] | None
    theta: float | None
    rule: str
    fixation: int | None
    deadline: int | None
    samples: _Positive
    taxels: _Positive
    rate_hz: float | None
    pre_samples: int
    taxel_mm: list[tuple[float, float]] | None
    flagged: float
    seed: int | None
    reading_unit: str = ""


class TapRecord(msgspec.Struct, frozen=True, kw_only=True):
    """One tap: the fields of `perceive --json`, and what is needed to draw it.

    Attributes:
        sentence: The line of the terminal.
        belief: Belief in every class, L rows of M.
        readings: Samples of the tap, J rows of K.
    """

    episode: _Positive
    tap: _Positive
    what: str
    what_belief: float
    where: float
    where_index: int
    where_belief: float
    log_evidence: float | None
    p: float | None
    unusual: bool
    arrived: int
    move: int | None
    what_marginal: list[float]
    where_marginal: list[float]
    sentence: str
    belief: list[list[float]]
    readings: list[list[float]]


class EndRecord(msgspec.Struct, frozen=True, kw_only=True):
    """The end of an episode, as `perceive --json` prints it, and a sentence."""

    episode: int
    decision: str | None
    where: float
    reason: str
    taps: int
    true_what: str | None
    true_where: float | None
    right: bool | None
    sentence: str


class Episodes(msgspec.Struct, frozen=True, kw_only=True):
    """Recorded episodes, as their file holds them."""

    format: Literal["solidtouch episodes"] = FORMAT
    version: Literal[1] = VERSION
    header: EpisodeHeader
    taps: list[TapRecord]
    ends: list[EndRecord]


def header_of(
    heading: str,
    grid: ClassGrid,
    preprocessing: Preprocessing,
    taxels: int,
    *,
    theta: float = 1.0,
    rule: str = "",
    fixation: int | None = None,
    deadline: int | None = None,
    taxel_mm: ArrayLike | None = None,
    seed: int | None = None,
    reading_unit: str = "",
) -> EpisodeHeader:
    """Header of episodes; the arguments are named as in `EpisodeHeader`, and a threshold of 1 is none."""
    return EpisodeHeader(
        heading=heading,
        what_name=list(grid.what_name),
        what_value=_list(grid.what_value),
        what_unit=grid.what_unit,
        where_value=grid.where_value.tolist(),
        where_label=[grid.where_label(l) for l in range(grid.L)],
        where_unit=grid.axis_unit,
        where_edges=_list(grid.where_edges),
        where_place=_list(grid.where_place),
        theta=theta if theta < 1 else None,
        rule=rule,
        fixation=fixation,
        deadline=deadline,
        samples=preprocessing.samples,
        taxels=taxels,
        rate_hz=preprocessing.rate_hz,
        pre_samples=preprocessing.pre_samples,
        taxel_mm=None if taxel_mm is None else _in_a_plane(taxel_mm, taxels),
        flagged=FLAGGED,
        seed=seed,
        reading_unit=reading_unit,
    )


def tap_record(episode: int, seen: Seen) -> TapRecord:
    """Record of a tap; `episode` counts from 1."""
    return TapRecord(
        episode=episode,
        **record(seen),
        sentence=sentence(seen),
        belief=np.round(np.exp(seen.step.log_belief), _DECIMALS).tolist(),
        readings=significant(seen.step.tap, _DIGITS).tolist(),
    )


def ending_record(episode: int, ending: Ending) -> EndRecord:
    """Record of the end of an episode."""
    return EndRecord(**end_record(episode, ending), sentence=said(episode, ending))


def recorded(header: EpisodeHeader, taps: Sequence[Sequence[Seen]], endings: Sequence[Ending]) -> Episodes:
    """Episodes from their steps and endings."""
    numbered = [(number, seen) for number, own in enumerate(taps, 1) for seen in own]
    return Episodes(
        header=header,
        taps=[tap_record(*one) for one in numbered],
        ends=[ending_record(*one) for one in enumerate(endings, 1)],
    )


def encoded(part: msgspec.Struct) -> bytes:
    """JSON of a header or record, in one line."""
    return msgspec.json.encode(part)


def encoded_file(header: bytes, taps: Iterable[bytes], ends: Iterable[bytes]) -> bytes:
    """JSON of the whole, with one line for each record, from the JSON of its parts."""
    parts = {"header": header, "taps": _lines(taps), "ends": _lines(ends)}
    body = b",\n".join(f'"{name}": '.encode() + part for name, part in parts.items())
    return f'{{"format": "{FORMAT}", "version": {VERSION},\n'.encode() + body + b"\n}\n"


def encoded_episodes(episodes: Episodes) -> bytes:
    """JSON of recorded episodes."""
    return encoded_file(encoded(episodes.header), map(encoded, episodes.taps), map(encoded, episodes.ends))


def check_episode_file(path: Path) -> None:
    """Checks the name of a file of episodes.

    Raises:
        InputError: It does not end in `.json`.
    """
    if path.suffix.lower() != ".json":
        raise InputError(f"{path}: the name of a file of episodes must end in .json.")


def save_episodes(content: bytes, path: str | Path, force: bool = False) -> None:
    """Writes the JSON of recorded episodes, atomically.

    Raises:
        InputError: The file exists and `force` is not set, its name does not end in `.json`, or it cannot be written.
    """
    check_episode_file(Path(path))
    with complete_file(path, force) as temporary:
        temporary.write_bytes(content)


def load_episodes(path: str | Path) -> Episodes:
    """Recorded episodes from their file.

    Raises:
        InputError: The file is missing or unreadable, not of this format, or sizes in it do not match.
    """
    path = check_path(path)
    try:
        episodes = decode_json(path.read_bytes(), Episodes)
    except OSError as error:
        raise InputError(f"{path}: cannot read: {reason(error)}.") from error
    except InputError as error:
        raise InputError(f"{path}: not a file of episodes from perceive --save-episode: {error}") from error
    try:
        _check(episodes)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return episodes


def _check(episodes: Episodes) -> None:
    """Checks that sizes and numbers fit together."""
    header = episodes.header
    L, M, J, K = len(header.where_value), len(header.what_name), header.samples, header.taxels
    if not episodes.taps:
        raise InputError("holds no tap.")
    for name, size, wanted in (
        ("header.where_value", L, max(L, 1)),
        ("header.what_name", M, max(M, 1)),
        ("header.where_label", len(header.where_label), L),
        ("header.where_edges", L + 1 if header.where_edges is None else len(header.where_edges), L + 1),
        ("header.where_place", L if header.where_place is None else len(header.where_place), L),
        ("header.what_value", M if header.what_value is None else len(header.what_value), M),
        ("header.taxel_mm", K if header.taxel_mm is None else len(header.taxel_mm), K),
    ):
        if size != wanted:
            raise InputError(f"{name} must have {wanted} entries, got {size}.")
    if header.fixation is not None and not 0 <= header.fixation < L:
        raise InputError(f"header.fixation must be a position index from 0 to {L - 1}, got {header.fixation}.")
    last = (0, 0)
    for tap in episodes.taps:
        name, number = f"tap {tap.tap} of episode {tap.episode}", (tap.episode, tap.tap)
        if number not in {(last[0], last[1] + 1), (last[0] + 1, 1)}:
            raise InputError(f"{name} follows tap {last[1]} of episode {last[0]}.")
        last = number
        for key, rows, shape in (("belief", tap.belief, (L, M)), ("readings", tap.readings, (J, K))):
            if len(rows) != shape[0] or any(len(row) != shape[1] for row in rows):
                raise InputError(f"{name}: {key} must be {shape[0]} rows of {shape[1]} numbers.")
        if (len(tap.where_marginal), len(tap.what_marginal)) != (L, M) or not 0 <= tap.where_index < L:
            raise InputError(f"{name}: marginals and where_index do not fit {L} positions and {M} objects.")
    if [end.episode for end in episodes.ends] != list(range(1, len(episodes.ends) + 1)):
        raise InputError("ends must be numbered 1, 2, 3, ...")
    if not last[0] - 1 <= len(episodes.ends) <= last[0]:
        raise InputError(f"there are {last[0]} episodes, but {len(episodes.ends)} ends.")


def significant(values: ArrayLike, digits: int) -> NDArray[np.float64]:
    """Values rounded to so many significant digits, in the shortest form.

    >>> significant([0.1234567891, -98765.4321, 0.0], 4).tolist()
    [0.1235, -98770.0, 0.0]
    """
    values = np.asarray(values, dtype=np.float64)
    with np.errstate(divide="ignore"):
        places = digits - 1 - np.floor(np.log10(np.abs(values)))
    exact = np.abs(places) <= _EXACT
    factor = 10.0 ** np.where(exact, np.abs(places), 0)  # multiplied or divided by, as powers below 1 are inexact
    rounded = np.where(places >= 0, np.rint(values * factor) / factor, np.rint(values / factor) * factor)
    return np.where(exact, rounded, values)


def _in_a_plane(places: ArrayLike, taxels: int) -> list[tuple[float, float]] | None:
    """Two coordinates of each taxel, without the one of three in which they differ least; `None` if there are others.

    The longer of the two comes first, as a fingertip lies along its own axis.
    """
    places = np.asarray(places, dtype=np.float64)
    if places.ndim != 2 or len(places) != taxels or places.shape[1] not in (2, 3) or not np.isfinite(places).all():
        return None
    kept = sorted(np.argsort(-np.ptp(places, axis=0), kind="stable")[:2])
    return [(x, y) for x, y in significant(places[:, kept], _DIGITS).tolist()]


def _lines(parts: Iterable[bytes]) -> bytes:
    return b"[\n" + b",\n".join(parts) + b"\n]"


def _list(values: NDArray[np.float64] | None) -> Any:
    return None if values is None else values.tolist()
