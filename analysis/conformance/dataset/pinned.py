"""Reader of an exported kit: cases, exact answers, tolerances and allowed choices as the files have them."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from ....inference.reference import Border
from ....models.errors import InputError, check_path
from ..answers import FIT, OPTIONAL, QUANTITIES, Allowed, Answer, given_answer
from ..case import FORMAT, LEVELS, Case, Pinned, Training
from ..catalogue import Kit
from ..information import STRATEGIES
from ..tolerance import Precision
from .checksums import check_sums
from .fingerprints import frozen_sizes, is_own
from .version import KIT_VERSION

INDEX = "index.json"
CHOICES = ("decisions", "move")
_ROUNDING = 1e-9
_VERSION = re.compile(r"(0|[1-9][0-9]*)(\.(0|[1-9][0-9]*)){2}")
_MOST = 2.0**53


class _Format(msgspec.Struct):
    """What says whether the rest can be read."""

    format: int


class _Entry(msgspec.Struct):
    """A case in the index."""

    case: str
    level: str


class _LeftOut(_Entry):
    """A case that the precision of the kit cannot do."""

    about: str
    equations: tuple[int, ...]
    reason: str


class _Index(msgspec.Struct):
    """What is read of the index."""

    kit: str
    precision: Precision
    levels: dict[str, int]
    cases: list[_Entry]
    left_out: list[_LeftOut] = []


class _Tap(msgspec.Struct):
    """A tap of a case."""

    move: int
    samples: list[list[float]]


class _TrainingTaps(msgspec.Struct):
    """Training taps of a case."""

    taps: list[list[list[float]]]
    where: list[int]
    what: list[int]


class _Choices(msgspec.Struct):
    """What passes beside the right choices of an answer."""

    allowed_decisions: list[list[int | None]] | None = None
    allowed_moves: list[int] = []


class _Bounds(msgspec.Struct):
    """A tolerance."""

    absolute: float
    relative: float


class _CaseFile(msgspec.Struct):
    """A case as its file has it."""

    case: str
    L: int
    M: int
    K: int
    J: int
    B: int
    where_value: list[float]
    prior: list[list[float]]
    power: str | float
    border: Border
    thresholds: list[float]
    theta_x: float
    fixation: int
    level: str
    about: str
    equations: tuple[int, ...]
    strict_ties: bool
    taps: list[_Tap]
    tolerances: dict[str, _Bounds]
    expected: list[dict[str, Any]]
    edges: list[Any] | None = None
    counts: list[list[list[list[int]]]] | None = None
    pseudocount: float = 0.01
    probabilities: list[list[list[list[float]]]] | None = None
    mean: list[list[list[float]]] | None = None
    sd: list[list[list[float]]] | None = None
    strategy: str = ""
    pool: list[list[list[float]]] | None = None
    training: _TrainingTaps | None = None


def read_kit(folder: str | Path) -> Kit:
    """The kit in a folder that `conformance export` has written.

    Raises:
        InputError: It is damaged, incomplete or of a newer format.
    """
    folder = check_path(folder)
    if not folder.is_dir():
        raise InputError(f"kit {folder}: not a folder.")
    names = set(check_sums(folder))
    index = _decoded(folder, INDEX, names, _Index)
    if not _VERSION.fullmatch(index.kit):
        raise InputError(
            f"kit {folder}: {INDEX} is not of format {FORMAT}: kit is not a version such as {KIT_VERSION}."
        )
    entries = [*index.cases, *index.left_out]
    if index.left_out and index.precision != "single":
        raise InputError(f"kit {folder}: {INDEX} is not of format {FORMAT}: double precision leaves no case out.")
    held = Counter(entry.level for entry in entries)
    if short := [level for level in held if index.levels.get(level, 0) < held[level]]:
        raise InputError(f"kit {folder}: {INDEX} is not of format {FORMAT}: levels has too few cases of {short[0]!r}.")
    unknown = {level: n for level, n in held.items() if level not in LEVELS}
    cases: dict[str, Case] = {}
    for entry in (entry for entry in entries if entry.level not in unknown):
        case = _absent(folder, entry) if isinstance(entry, _LeftOut) else _case(folder, f"{entry.case}.json", names)
        if case.name in cases or case.level != entry.level:
            said = "it is listed twice" if case.name in cases else f"its file has level {case.level!r}"
            raise InputError(f"kit {folder}: {INDEX} is not of format {FORMAT}: case {case.name}: {said}.")
        cases[case.name] = case
    if index.kit == KIT_VERSION:
        _check_own(folder, index, cases)
    return Kit(index.kit, cases, index.levels, index.precision, unknown)


def _check_own(folder: Path, index: _Index, cases: Mapping[str, Case]) -> None:
    """Checks that what has the name of this version's kit is it, as claims have no other name for it."""
    for name, case in cases.items():
        if not is_own(case, index.precision):
            wrong = f"{INDEX} leaves {name} out, unlike" if case.absent else f"{name}.json is not the case of"
            raise InputError(f"kit {folder}: {wrong} kit {KIT_VERSION}.")
    sizes = frozen_sizes()
    if wrong := [level for level in {**sizes, **index.levels} if sizes.get(level) != index.levels.get(level)]:
        raise InputError(f"kit {folder}: {INDEX} has another number of cases of {wrong[0]!r} than kit {KIT_VERSION}.")


def _decoded[T](folder: Path, name: str, names: set[str], kind: type[T]) -> T:
    """What a file holds, once it is known to be of a format that can be read."""
    if name not in names:
        raise InputError(f"kit {folder}: incomplete: {name} is not in its checksums.")
    content = (folder / name).read_bytes()
    try:
        found = msgspec.json.decode(content, type=_Format).format
        if found > FORMAT:
            raise InputError(
                f"kit {folder}: {name} has format {found}, this version of solidtouch reads {FORMAT}; a newer one "
                "reads it."
            )
        return msgspec.json.decode(content, type=kind)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise InputError(f"kit {folder}: {name} is not of format {FORMAT}: {error}.") from None


def _case(folder: Path, name: str, names: set[str]) -> Case:
    whole = _decoded(folder, name, names, _CaseFile)
    try:
        return _pinned(whole, _plain(whole))
    except KeyError as error:
        raise InputError(f"kit {folder}: {name} is not of format {FORMAT}: no key {error}.") from None
    except (ValueError, TypeError, OverflowError, msgspec.MsgspecError) as error:  # also bad answers
        raise InputError(f"kit {folder}: {name} is not of format {FORMAT}: {error}.") from None


def _absent(folder: Path, entry: _LeftOut) -> Case:
    """A case of which the folder has the name alone."""
    if not entry.reason or not all(text.isprintable() for text in (entry.case, entry.about, entry.reason)):
        raise InputError(f"kit {folder}: {INDEX} is not of format {FORMAT}: left_out is not what it stands for.")
    return Case(
        entry.case,
        entry.about,
        entry.equations,
        prior=np.zeros((0, 0)),
        taps=np.zeros((0, 0, 0)),
        moves=np.zeros(0, dtype=np.intp),
        bins=0,
        level=entry.level,
        pinned=Pinned((), {}, entry.reason),
    )


def _plain(whole: _CaseFile) -> Case:
    """A case without its answers."""
    L, M, K, J, B = whole.L, whole.M, whole.K, whole.J, whole.B
    taps = [tap.samples for tap in whole.taps]
    given = [line["tap"] for line in whole.expected if line["tap"] > 0]
    ended = bool(whole.expected) and "error" in whole.expected[-1]
    return Case(
        whole.case,
        whole.about,
        whole.equations,
        prior=_array("prior", whole.prior, (L, M)),
        taps=_array("taps", taps, (len(taps), J, K)),
        moves=np.array([tap.move for tap in whole.taps], dtype=np.intp),
        bins=B,
        edges=_edges(whole),
        counts=None if whole.counts is None else _counts(whole.counts, (L, M, K, B)),
        probabilities=_given("probabilities", whole.probabilities, (L, M, K, B)),
        training=None if whole.training is None else _training(whole.training, (J, K)),
        mean=_given("mean", whole.mean, (L, M, K)),
        sd=_given("sd", whole.sd, (L, M, K)),
        pool=None if whole.pool is None else _array("pool", whole.pool, (len(whole.pool), J, K)),
        pseudocount=whole.pseudocount,
        power=whole.power,  # pyright: ignore[reportArgumentType] - one of the names or a number
        border=whole.border,
        thresholds=tuple(whole.thresholds),
        theta_x=whole.theta_x,
        fixation=whole.fixation,
        strategy=whole.strategy,
        where_value=tuple(whole.where_value),
        answered=() if ended or len(given) == len(taps) else tuple(given),
        strict_ties=whole.strict_ties,
        level=whole.level,
    )


def _pinned(whole: _CaseFile, case: Case) -> Case:
    """A case with the answers of its file."""
    _check(case)
    answers = tuple(_answer(line, case) for line in whole.expected)
    _check_answers(case, answers)
    for quantity in set().union(*(answer.values for answer in answers)) - set(CHOICES):
        _ = whole.tolerances[quantity]
    bounds = {name: (bound.absolute, bound.relative) for name, bound in whole.tolerances.items()}
    return replace(case, pinned=Pinned(answers, bounds))


def _answer(line: Mapping[str, Any], case: Case) -> Answer:
    """A right answer, and the choices that pass beside it."""
    answer = given_answer(line, case, line["tap"])
    if "decisions" not in answer.values:
        return answer
    right = answer.values["decisions"].tolist()
    passing = msgspec.convert(line, _Choices)
    also = passing.allowed_decisions or [[] for _ in right]
    decisions = [{index, *(-1 if m is None else m for m in more)} for index, more in zip(right, also, strict=True)]
    return replace(answer, allowed=Allowed(decisions, {int(answer.values["move"]), *passing.allowed_moves}))


def _check_answers(case: Case, answers: Sequence[Answer]) -> None:
    """Checks that answers belong to taps in their order, and that none lacks a quantity, which would not be compared.

    Raises:
        ValueError: They do not.
        KeyError: One does.
    """
    taps = [answer.tap for answer in answers]
    if not taps or taps != sorted({*taps}) or not 0 <= taps[0] <= taps[-1] <= len(case.taps):
        raise ValueError("expected is not what it stands for")
    due = {*QUANTITIES} - {*FIT, *OPTIONAL} - ({"information"} if not case.strategy else set())
    for answer in answers:
        for quantity in () if answer.error is not None else due if answer.tap else FIT:
            _ = answer.values[quantity]


def _check(case: Case) -> None:
    """Checks that numbers are what they stand for.

    Raises:
        ValueError: One is not; the message names its key.
    """
    L, M, *_ = case.sizes.values()
    edges, training = case.edges, case.training
    wrong = {
        "about": not case.about.isprintable(),
        "L": min(case.sizes.values()) < 1,
        "edges": edges is None if training is None else edges is not None,
        "counts": sum(given is not None for given in (case.counts, case.probabilities, training, case.mean)) != 1,
        "mean": (case.mean is None) != (case.sd is None),
        "sd": case.sd is not None and not (case.sd > 0).all(),
        "strategy": {bool(case.strategy), case.strategy in STRATEGIES, case.pool is not None} == {True, False},
        "power": not (case.power in ("J", "JK", "none") if isinstance(case.power, str) else case.power > 0),
        "pseudocount": not 0 <= case.pseudocount < np.inf,
        "fixation": not 0 <= case.fixation < L,
        "where_value": len(case.where_value) != L,
        "prior": not ((case.prior >= 0) & (case.prior <= 1)).all() or abs(case.prior.sum() - 1) > _ROUNDING,
    }
    wrong["edges"] |= edges is not None and not (np.diff(edges) > 0).all()
    wrong["counts"] |= case.counts is not None and bool((case.counts < 0).any())
    wrong["probabilities"] = case.probabilities is not None and bool((case.probabilities < 0).any())
    if training is not None:
        N = len(training.taps)
        inside = training.where.shape == training.what.shape == (N,)
        wrong["training"] = not inside or not _within(training.where, L) or not _within(training.what, M)
    for name, is_wrong in wrong.items():
        if is_wrong:
            raise ValueError(f"{name} is not what it stands for")


def _within(indices: NDArray[np.intp], end: int) -> bool:
    return bool(((indices >= 0) & (indices < end)).all())


def _array(name: str, values: Any, shape: tuple[int, ...]) -> NDArray[np.float64]:
    array = np.array(values, dtype=np.float64)
    if array.shape != shape:
        raise ValueError(f"{name} has shape {list(array.shape)} instead of {list(shape)}")
    return array


def _given(name: str, values: Any, shape: tuple[int, ...]) -> NDArray[np.float64] | None:
    return None if values is None else _array(name, values, shape)


def _counts(values: Any, shape: tuple[int, ...]) -> NDArray[np.int64]:
    array = _array("counts", values, shape)
    if not (array < _MOST).all():
        raise ValueError("counts are too large")
    return array.astype(np.int64)


def _edges(whole: _CaseFile) -> NDArray[np.float64] | None:
    if whole.edges is None:
        return None
    array = np.array(whole.edges, dtype=np.float64)
    return _array("edges", array, (whole.K, whole.B + 1) if array.ndim == 2 else (whole.B + 1,))


def _training(training: _TrainingTaps, shape: tuple[int, int]) -> Training:
    taps = _array("training", training.taps, (len(training.taps), *shape))
    return Training(taps, np.array(training.where), np.array(training.what))
