"""Tests of dependence between taxels that allow each taxel to drift slowly by itself.

The tests of `dependence.taxels` permute whole taps of a class and session, so their null is that taps come in no
particular order. Taxels that are independent but each drift along the session break it, and are found. Here drift is
removed first: of three neighbouring taps of a class and session at times t1 < t2 < t3, in every sample and taxel, only

    w1 x1 + w2 x2 + w3 x3,    w proportional to (t3 - t2, t1 - t3, t2 - t1), of unit length,

counts, which is zero for any line through the session and nearly so for any slow course. Triples do not overlap, so
these contrasts are exchangeable under independent noise and under random walks, and are permuted as taps are; classes
that were tapped in turns share their drift, so all classes of a session are permuted alike. What taxels share slowly is
removed as well, and a third of the taps is left: docs/explanation/audit-studies.md has levels and the price in power.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from xarray import Variable

from ....models.taps import TapSet
from ...experiment.data_warnings import recorded_order
from .permutation import Floats
from .strata import evenly
from .taxels import LEAST_TAPS, TESTS, taxel_dependence

WIDTH = 3
"""Taps of a contrast."""
_PAIRS = ("z", "p", "q", "rejected")
_FAMILIES = ("family_z", "rejected_fraction", "pairs")


class Contrasts(NamedTuple):
    """What is left of taps without slow courses.

    Attributes:
        values: Shape (n, J, K).
        stratum: Label of each, shape (n,).
        session: Of each, shape (n,).
    """

    values: Floats
    stratum: NDArray[np.intp]
    session: NDArray[np.intp]


def recorded_time(taps: TapSet) -> NDArray[np.intp]:
    """The number of each tap in its session in recorded order, as far as the file tells, shape (N,)."""
    time = np.zeros(len(taps), dtype=np.intp)
    for session in np.unique(taps.session):
        own = np.flatnonzero(taps.session == session)
        time[own[recorded_order(taps.trial[own])]] = np.arange(len(own))
    return time


def triple_weights(time: ArrayLike) -> Floats:
    """Weights of unit length that leave nothing of a line, shape (n, 3), by increasing times of the same shape."""
    t1, t2, t3 = np.asarray(time, dtype=np.float64).T
    weight = np.stack([t3 - t2, t1 - t3, t2 - t1], axis=1)
    return weight / np.linalg.norm(weight, axis=1, keepdims=True)


def triples(stratum: ArrayLike, time: ArrayLike) -> NDArray[np.intp]:
    """Which taps stand next to each other in their stratum, three by three without overlap, shape (n, 3).

    Args:
        stratum: Label of each tap, shape (N,).
        time: When each was recorded, different within a stratum, shape (N,).
    """
    stratum, time = np.asarray(stratum), np.asarray(time)
    found = []
    for label in np.unique(stratum):
        own = np.flatnonzero(stratum == label)
        own = own[np.argsort(time[own])]
        found.append(own[: len(own) // WIDTH * WIDTH].reshape(-1, WIDTH))
    return np.concatenate(found) if found else np.zeros((0, WIDTH), dtype=np.intp)


def contrasts(
    taps: ArrayLike | Variable, stratum: ArrayLike, time: ArrayLike, session: ArrayLike, most: int | None = None
) -> Contrasts:
    """Taps without slow courses, by `triples`.

    Args:
        taps: Shape (N, J, K); of `TapSet.samples` those are read that count.
        stratum: Class and session of each tap as one number, shape (N,).
        time: When each was recorded, different within a stratum, shape (N,).
        session: Of each tap, shape (N,).
        most: At most so many of a stratum, spread evenly over it; `None` for all.
    """
    samples: Any = taps if isinstance(taps, Variable) else np.asarray(taps)
    stratum = np.asarray(stratum)
    three = triples(stratum, time)
    if most is not None:
        three = three[evenly(stratum[three[:, 0]], most)]
    weight = triple_weights(np.asarray(time)[three])
    chosen = np.asarray(samples[three.ravel()]).reshape(*three.shape, *samples.shape[1:])
    values = np.einsum("nw,nwjk->njk", weight, chosen.astype(np.float64))
    return Contrasts(values, stratum[three[:, 0]], np.asarray(session)[three[:, 0]])


def against_drift(
    whole: xr.Dataset,
    local: Contrasts | None,
    *,
    permutations: int = 999,
    seed: int = 0,
    progress: Callable[[int], None] | None = None,
) -> xr.Dataset:
    """The tests of taxels with a null under which each taxel may drift.

    Args:
        whole: Of whole taps, from `taxel_dependence`.
        local: From `contrasts`; `None` where strata have no order in time.
        permutations: As in `taxel_dependence`.
        seed: Likewise.
        progress: Called after every stratum.

    Returns:
        `whole` with, of each test, ``drift_p``, the p-value of all pairs by contrasts, ``contrasts`` their number, and
        ``drift_reason``, empty or why there is none. Where there is one, ``p``, ``q``, ``z`` and ``rejected`` of pairs,
        ``family_z``, ``pairs`` and ``rejected_fraction`` are those of contrasts; ``family_p`` and effects stay those
        of whole taps.
    """
    result = whole.copy(deep=True).assign(
        drift_p=("test", np.full(len(TESTS), np.nan)),
        contrasts=("test", np.zeros(len(TESTS), dtype=np.int64)),
        drift_reason=whole["reason"].copy(deep=True),
    )
    if local is None:
        untested = result["drift_reason"].values == ""
        result["drift_reason"].values[untested] = "sessions have one tap of a class each"
        return result
    found = taxel_dependence(
        local.values,
        local.stratum,
        permutations=permutations,
        alpha=whole.attrs["alpha"],
        seed=seed,
        progress=progress,
        together=local.session,
    )
    for t in range(len(TESTS)):
        if found["reason"].values[t] and not result["drift_reason"].values[t]:
            least = WIDTH * LEAST_TAPS[t]
            result["drift_reason"].values[t] = f"it takes {least} taps of a class and session, in recorded order"
        if found["reason"].values[t] or result["reason"].values[t]:
            continue
        result["drift_p"].values[t] = found["family_p"].values[t]
        result["contrasts"].values[t] = found["taps"].values[t]
        for name in (*_PAIRS, *_FAMILIES):
            result[name].values[t] = found[name].values[t]
    return result
