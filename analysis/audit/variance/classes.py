"""Taps of each class, with regressors for position and order in the session."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....models.taps import TapSet
from ...stats.evidence import Evidence
from ..dependence.drift import recorded_time

_LEAST_FREEDOM = 3
_ROUNDING = 1e-9  # of evidence


class EvidenceClass(NamedTuple):
    """The taps of one class.

    Attributes:
        number: Of the class.
        members: Which taps, in recorded order, shape (n,).
        stratum: Session and half of each, shape (n,).
        session: Session of each, from 0, shape (n,).
        half: Shape (n,).
        label: Session and half of each, numbered alike in all classes, shape (n,).
        time: Number of each in its session, as recorded, shape (n,).
        columns: What place or order can explain, shape (n, q).
        suspects: What each named suspect can explain of taps within their strata, shape (n, its q); without columns
            where there are too few taps.
    """

    number: int
    members: NDArray[np.intp]
    stratum: NDArray[np.intp]
    session: NDArray[np.intp]
    half: NDArray[np.intp]
    label: NDArray[np.intp]
    time: NDArray[np.intp]
    columns: NDArray[np.float64]
    suspects: tuple[NDArray[np.float64], ...] = ()

    def without(
        self, values: NDArray[np.float64], groups: NDArray[np.intp], suspects: int = 0
    ) -> tuple[NDArray[np.float64], int]:
        """Values (n, ...) without the means of groups and what the columns explain, and the freedom that is left.

        The first so many suspects explain as well.
        """
        basis = orthonormal(centred(np.concatenate([self.columns, *self.suspects[:suspects]], axis=1), groups))
        flat = centred(values.reshape(len(values), -1), groups)
        residual = (flat - basis @ (basis.T @ flat)).reshape(values.shape)
        return residual, len(values) - int(groups.max()) - 1 - basis.shape[1]


def evidence_classes(
    taps: TapSet, evidence: Evidence, suspects: Sequence[NDArray[np.float64]] = ()
) -> tuple[list[EvidenceClass], str]:
    """The classes with taps enough, and whether place, order or nothing explains taps within their sessions.

    Classes whose evidence is the same for all taps are left out: they have no variance to split.

    Args:
        taps: Those of the evidence.
        evidence: Of these taps.
        suspects: What each named suspect can explain of all taps, shape (taps, its q).
    """
    time = recorded_time(taps)[evidence.tap]
    session, place = taps.session[evidence.tap], taps.where[evidence.tap]
    recorded = np.lexsort((taps.trial[evidence.tap], session))
    several = [len(np.unique(place[evidence.own == c])) for c in np.unique(evidence.own)]
    covariate = "place" if np.median(several) > 2 else "order"
    classes = []
    for c in np.unique(evidence.own):
        members = recorded[evidence.own[recorded] == c]
        half = evidence.half[members]
        numbers, index = np.unique(session[members], return_inverse=True)
        _, stratum = np.unique(index * 2 + half, return_inverse=True)
        columns = _place_columns(place[members], len(numbers)) if covariate == "place" else order_columns(index)
        columns = _by_half(columns, half)
        strata = int(stratum.max()) + 1
        if len(members) - strata - np.linalg.matrix_rank(centred(columns, stratum)) < _LEAST_FREEDOM:
            columns = columns[:, :0]
        named = [_by_half(columns_of[evidence.tap][members], half) for columns_of in suspects]
        if named and len(members) - strata - columns.shape[1] - sum(part.shape[1] for part in named) < _LEAST_FREEDOM:
            named = [part[:, :0] for part in named]
        label = 2 * np.unique(session, return_inverse=True)[1][members] + half
        if len(members) - strata >= _LEAST_FREEDOM and _varies(evidence.values[members].sum(axis=(1, 2)), half):
            classes.append(
                EvidenceClass(int(c), members, stratum, index, half, label, time[members], columns, tuple(named))
            )
    return classes, covariate if any(one.columns.shape[1] for one in classes) else ""


def _by_half(columns: NDArray[np.float64], half: NDArray[np.intp]) -> NDArray[np.float64]:
    """Columns (n, q) of each half by itself, since another model judges it."""
    return np.concatenate([columns * (half == h)[:, None] for h in np.unique(half)], axis=1)


def _varies(total: NDArray[np.float64], half: NDArray[np.intp]) -> bool:
    """Whether evidence (n,) differs between taps of a half by more than rounding."""
    left = centred(total[:, None], half)
    return bool((np.abs(left) > _ROUNDING * np.abs(total).max()).any())


def _place_columns(place: NDArray[np.float64], sessions: int) -> NDArray[np.float64]:
    """Every place by itself where sessions repeat them, else a line and a parabola."""
    places, index = np.unique(place, return_inverse=True)
    if sessions > 1 and len(place) >= 2 * len(places):
        return np.eye(len(places))[index]
    x = (place - place.mean()) / (np.ptp(place) or 1.0)
    return np.stack([x, x**2], axis=1)


def order_columns(session: NDArray[np.intp]) -> NDArray[np.float64]:
    """A line and a parabola over the order of taps in their session, and what fades by half from tap to tap."""
    rank = rank_in_session(session).astype(np.float64)
    x = rank / max(rank.max(), 1.0)
    return np.stack([x, x**2, 0.5**rank], axis=1)


def rank_in_session(session: NDArray[np.intp]) -> NDArray[np.intp]:
    """The number of each tap in its session, from 0."""
    rank = np.zeros(len(session), dtype=np.intp)
    for s in np.unique(session):
        rank[session == s] = np.arange(np.count_nonzero(session == s))
    return rank


def orthonormal(columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """An orthonormal basis of what columns span."""
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    return u[:, s > 1e-9 * max(s.max(initial=0.0), 1e-300)]


def centred(values: NDArray[np.float64], groups: NDArray[np.intp]) -> NDArray[np.float64]:
    """Values (n, V) less the mean of their group."""
    member = np.eye(int(groups.max()) + 1)[groups]
    return values - member @ ((member.T @ values) / member.sum(axis=0)[:, None])
