"""Taxels that are dead or saturated, and tap sets without them."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..blocks import over_blocks
from ..errors import InputError
from ..taps import TapSet

_STAYING, _INWARDS = 3, 4  # taps that stay at a limit, and values compared there


class UsableTaxels(NamedTuple):
    """Taxels of a tap set, counted from 0, by what can be done with them.

    Attributes:
        used: Neither dead nor saturated, or not to be left out.
        dead: Left out, as they have one value throughout or none at all.
        saturated: Left out, as `saturated_taxels` defines it.
    """

    used: tuple[int, ...]
    dead: tuple[int, ...]
    saturated: tuple[int, ...]

    def sentence(self, names: Sequence[str] = ()) -> str:
        """What is left out, empty if nothing; with the taxels' names if there are any, else by number."""
        parts = [
            f"{', '.join(str(names[k]) if len(names) else str(k) for k in taxels)} ({why})"
            for taxels, why in ((self.dead, "dead: one value throughout"), (self.saturated, "saturated"))
            if taxels
        ]
        left_out = len(self.dead) + len(self.saturated)
        return f"{left_out} of {left_out + len(self.used)} taxels left out: {'; '.join(parts)}." if parts else ""


def usable_taxels(taps: TapSet, *, dead: bool = True, saturated: bool = True) -> UsableTaxels:
    """Which taxels are worth keeping.

    Limits that were moved tap by tap, by a tare or a high-pass, are not found: a saturated taxel of such taps is kept.

    Args:
        taps: The taps.
        dead: Whether to leave out dead taxels.
        saturated: Whether to leave out saturated ones.

    Raises:
        InputError: None would be left.
    """
    extremes = taps.extremes
    of_one_value = set(dead_taxels(extremes)) if dead else set()
    at_limit = set(saturated_taxels(taps.samples, extremes)) - of_one_value if saturated else set()
    K = extremes.shape[2]
    used = tuple(k for k in range(K) if k not in of_one_value | at_limit)
    if not used:
        raise InputError(f"no taxel would be left: of {K}, {len(of_one_value)} are dead and {len(at_limit)} saturated.")
    return UsableTaxels(used, tuple(sorted(of_one_value)), tuple(sorted(at_limit)))


def with_taxels(taps: TapSet, used: Sequence[int]) -> TapSet:
    """The taps with these taxels alone, in increasing order, and a record that says which of the sensor's they are.

    Taps of a contact trigger are refused, as any taxel may have started them: a rig that does not look at some of them
    would cut others. Cut their streams again, with `Preprocessing.taxels`.

    Args:
        taps: The taps.
        used: Indices of taxels in the taps; a selection from taps with chosen taxels is one of those.

    Raises:
        InputError: There is no such taxel, or none is chosen, or the taps were cut at contact.
    """
    K, record = taps.tap_shape[1], taps.preprocessing
    chosen = sorted(set(used))
    if not chosen or chosen[0] < 0 or chosen[-1] >= K:
        raise InputError(f"taxels must be at least one of 0 to {K - 1}, got {list(used)!r:.80}.")
    if len(chosen) == K:
        return taps
    if record.trigger == "contact":
        raise InputError("taxels of taps that were cut at contact cannot be left out; cut the streams without them.")
    of_sensor = chosen if record.taxels is None else [record.taxels[k] for k in chosen]
    dataset = taps.dataset.isel(taxel=chosen)
    dataset = dataset.assign_attrs(preprocessing=replace(record, taxels=tuple(of_sensor)).to_json())
    return TapSet(dataset, None if taps.scanned is None else taps.scanned[:, :, chosen])


def taxel_ranges(extremes: NDArray[np.floating]) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Lowest and highest value of each taxel, shape (K,), from those of each tap, see `TapSet`."""
    return np.fmin.reduce(extremes[:, 0]), np.fmax.reduce(extremes[:, 1])


def dead_taxels(extremes: NDArray[np.floating]) -> tuple[int, ...]:
    """The taxels that have one value in all taps or none at all; argument as for `taxel_ranges`."""
    low, high = taxel_ranges(extremes)
    return tuple(np.flatnonzero((low == high) | np.isnan(low)).tolist())


def constant_taxels(extremes: NDArray[np.floating]) -> tuple[int, ...]:
    """The taxels that have one value in all taps; argument as for `taxel_ranges`."""
    low, high = taxel_ranges(extremes)
    return tuple(np.flatnonzero(low == high).tolist())


def saturated_taxels(samples: Any, extremes: NDArray[np.floating]) -> tuple[int, ...]:
    """The taxels whose values are cut off at an extreme.

    A taxel is taken for saturated at its lowest or highest value `e` when all of this holds:

    - `e` is not its idle level: it is at least half the taxel's range away from the median of the first samples
      of all taps, which most of the time are free of contact or only at its beginning;
    - three taps or more stay at exactly `e` for a tenth of their samples (at least three, all where a tap has fewer)
      without a break;
    - its range is at least a tenth of the widest taxel's, so that the noise of an untouched taxel is not meant;
    - values pile up there: `e` is more frequent than the three next values towards the idle level together, so
      that a coarse quantisation is not taken for a limit.

    Limits that were moved tap by tap, by a tare or a high-pass, are not found.

    Args:
        samples: Shape (N, J, K), in memory or on disk.
        extremes: Lowest and highest sample of each tap and taxel, shape (N, 2, K).
    """
    ends, J = np.stack(taxel_ranges(extremes)), samples.shape[1]
    span, first = ends[1] - ends[0], np.asarray(samples[:, 0])
    idle = np.nanmedian(np.where(np.isnan(first).all(axis=0), 0.0, first), axis=0)
    possible = (span > 0) & (span >= np.fmax.reduce(span) / 10) & (abs(ends - idle) >= span / 2)
    reaches = extremes == ends
    sides = np.argwhere(possible & (reaches.sum(axis=0) >= _STAYING)).tolist()  # with noise there are none
    stay = min(J, max(3, -(-J // 10)))

    def looked_at(block: NDArray[np.floating], which: slice) -> list[tuple[int, Counter[float]]]:
        found = []
        for end, k in sides:
            reaching = block[reaches[which, end, k], :, k]
            staying = np.count_nonzero(_longest_run(reaching == ends[end, k]) >= stay)
            found.append((staying, _counts_inwards(block[:, :, k], end)))
        return found

    if not sides:
        return ()
    saturated = set()
    for (end, k), parts in zip(sides, zip(*over_blocks(samples, looked_at), strict=True), strict=True):
        total: Counter[float] = sum((counts for _, counts in parts), Counter())
        at_end, *next_counts = (total[value] for value in sorted(total, reverse=end == 1)[:_INWARDS])
        if sum(staying for staying, _ in parts) >= _STAYING and at_end > sum(next_counts):
            saturated.add(k)
    return tuple(sorted(saturated))


def _counts_inwards(samples: NDArray[np.floating], end: int) -> Counter[float]:
    """How often the lowest values occur, or for end 1 the highest ones."""
    values, counts = np.unique(samples[~np.isnan(samples)], return_counts=True)
    kept = slice(-_INWARDS, None) if end else slice(_INWARDS)
    return Counter(dict(zip(values[kept].tolist(), counts[kept].tolist(), strict=True)))


def _longest_run(at_extreme: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Length of the longest uninterrupted run of true values in each row."""
    longest = np.zeros(len(at_extreme), dtype=np.intp)
    length = np.zeros(len(at_extreme), dtype=np.intp)
    for column in at_extreme.T:
        length = np.where(column, length + 1, 0)
        longest = np.maximum(longest, length)
    return longest
