"""Suspected causes: extra arrays of a recording that may affect the evidence, such as operator or temperature.

What a suspect explains is what it adds to place or order, tap by tap within sessions: one that is the same throughout a
session cannot be told from the session, and one that follows the order of taps not from drift. **The test** is that of
drifting taxels (see `dependence.drift`): contrasts of three neighbouring taps of a class, session and half leave
nothing of a line; the contrasts of evidence are permuted, alike in all classes, and the statistic is the sum over
classes of the variance that contrasts of the suspect explain. So it holds its level if evidence drifts, whatever the
suspect does.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....models.errors import InputError
from ....models.seeds import Purpose, generator
from ....models.taps import TapSet
from ..dependence.drift import triple_weights, triples
from .classes import EvidenceClass, centred, order_columns, orthonormal

OPTION = "--covariate"
_MOST_LEVELS = 6  # distinct whole numbers up to which they are taken for categories
_PERMUTATIONS = 999
_LEAST = 1e-9  # of a length that is none


class Suspect(NamedTuple):
    """An extra array.

    Attributes:
        name: Of the array.
        columns: What it can explain: a line and a parabola of numbers, or one column for each category, shape (N, q).
    """

    name: str
    columns: NDArray[np.float64]


class Suspected(NamedTuple):
    """What tests say of a suspect.

    Attributes:
        p: Probability of what it explains if it had nothing to do with evidence; NaN where it cannot be tested.
        follows_order: Share of its variance within sessions that goes with the order of taps.
    """

    p: float
    follows_order: float


def named_suspects(taps: TapSet, names: Sequence[str]) -> tuple[Suspect, ...]:
    """The arrays of these names.

    Raises:
        InputError: A name is not that of an array with one value per tap.
    """
    return tuple(_suspect(taps, name) for name in dict.fromkeys(names))


def _suspect(taps: TapSet, name: str) -> Suspect:
    arrays = taps.dataset.data_vars
    if name not in arrays or arrays[name].dims != ("tap",):
        there = ", ".join(sorted(str(one) for one in arrays if arrays[one].dims == ("tap",)))
        has = f"there are: {there}" if there else "there is none"
        raise InputError(f"{OPTION} {name}: the taps have no such array with one value per tap; {has}.")
    values = arrays[name].values
    levels, index = np.unique(values if values.dtype.kind in "fiub" else values.astype(str), return_inverse=True)
    if values.dtype.kind == "f" or (values.dtype.kind in "iu" and len(levels) > _MOST_LEVELS):
        x = (values - values.mean()) / (np.ptp(values) or 1.0)
        return Suspect(name, np.stack([x, x**2], axis=1))
    return Suspect(name, np.eye(len(levels))[index])


def suspicion(
    columns: Sequence[NDArray[np.float64]],
    classes: Sequence[EvidenceClass],
    totals: Sequence[NDArray[np.float64]],
    seed: int,
    permutations: int = _PERMUTATIONS,
) -> Suspected:
    """Whether a suspect explains evidence beyond slow courses.

    Args:
        columns: What it can explain, of each class, shape (n, q).
        classes: With the times of their taps.
        totals: Evidence of the taps of each class, shape (n,).
        seed: Of the permutations.
        permutations: How many.
    """
    keys: dict[int, NDArray[np.float64]] = {}
    statistic, seen, apart, along = np.zeros(1 + permutations), False, 0.0, 0.0
    for one, column, total in zip(classes, columns, totals, strict=True):
        within = centred(column, one.session)
        basis = orthonormal(centred(order_columns(one.session), one.session))
        apart, along = apart + float((within**2).sum()), along + float(((basis.T @ within) ** 2).sum())
        three = triples(one.stratum, one.time)
        if not len(three):
            continue
        weight, stratum = triple_weights(one.time[three]), one.stratum[three[:, 0]]
        label = one.label[three[:, 0]]
        explains = np.einsum("nw,nwq->nq", weight, column[three])
        explains = np.concatenate([explains * (one.half[three[:, 0]] == h)[:, None] for h in (0, 1)], axis=1)
        explains = centred(explains, np.unique(stratum, return_inverse=True)[1])
        values = (weight * total[three]).sum(axis=1)
        if np.abs(explains).max() <= _LEAST or not values.any():
            continue
        seen = True
        permuted = np.empty((1 + permutations, len(three)))
        for number in np.unique(label).tolist():
            own = np.flatnonzero(label == number)
            key = keys.setdefault(number, np.zeros((1 + permutations, 0)))
            if key.shape[1] < len(own):
                more = generator(seed, Purpose.SUSPECTS, number, key.shape[1])
                fresh = more.random((permutations, len(own) - key.shape[1]))
                # The first row is in order, so that it observes.
                first = np.arange(key.shape[1], len(own))[None] - 1e6
                key = keys[number] = np.concatenate([key, np.concatenate([first, fresh])], axis=1)
            permuted[:, own] = values[own][np.argsort(key[:, : len(own)], axis=1)]
        statistic += ((permuted @ orthonormal(explains)) ** 2).sum(axis=1) / (values**2).mean()
    p = float((1 + np.count_nonzero(statistic[1:] >= statistic[0] * (1 - 1e-12))) / (1 + permutations))
    return Suspected(p if seen else np.nan, along / apart if apart > _LEAST else np.nan)
