"""Samples of a tap known to precede contact, and samples in which classes do not differ."""

from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.blocks import ScaledSamples, TaredSamples, tared
from ...models.errors import InputError
from ...models.measurement.fits.priors import Taps
from ...models.measurement.scaling import Moments
from ...models.taps import TapSet

OPTION = "--pre"

type Leading = Literal["stretch", "first sample", "none"]
type Known = Literal["--pre", "press", "contact", ""]

_STILL = 1e-3  # of the largest squared change: 3% of the largest change
_UNREST = 0.3
_SURE = 0.8
_SETTLED = 4.0  # time constants after which 2% of a step is left


class Lead(NamedTuple):
    """The samples at the beginning of taps in which classes do not part, which may or may not be before contact.

    Attributes:
        samples: How many; 0 for none.
        kind: `"stretch"`: classes stay alike in what changes for two samples or more; `"first sample"`: they change at
            once; `"none"`: one sample per tap, or samples that change from the first to the second nearly as much as
            ever.
        class_change: Squared change of the class means since the first sample, freed of noise, over its largest value,
            shape (J,).
        change: Root mean square change of single taps since the first sample, over its largest value, shape (J,).
    """

    samples: int
    kind: Leading
    class_change: NDArray[np.float64]
    change: NDArray[np.float64]


class Before(NamedTuple):
    """The samples that are known to be before contact.

    Attributes:
        samples: How many samples at the beginning of a tap; 0 where none is known to be.
        known: By what: `"--pre"` (the user says so), `"press"` or `"contact"` (recorded before the trigger), or
            nothing.
        lead: Where classes do not part, as a hint.
    """

    samples: int
    known: Known
    lead: Lead


def before_contact(taps: TapSet, cell: NDArray[np.intp], pre: int | None = None) -> Before:
    """The samples that are known to be before contact.

    The user says so, or the record of the taps does: `pre_samples` before a press. Before a contact trigger light
    touch below its level may come, so of those samples only the ones count in which classes do not part, and none
    where they part at once.

    Args:
        taps: The taps with their record.
        cell: Class of each tap, shape (N,).
        pre: What the user says; `None` for nothing.

    Raises:
        InputError: `pre` is negative, or taps have no sample after so many.
    """
    J, lead = taps.tap_shape[0], leading_samples(taps.doubles, cell)
    if pre is not None:
        check_pre(pre, J)
        return Before(pre, OPTION if pre else "", lead)
    record = taps.preprocessing
    if not record.pre_samples:
        return Before(0, "", lead)
    if record.trigger == "press":
        return Before(record.pre_samples, "press", lead)
    return Before(min(record.pre_samples, lead.samples) if lead.kind == "stretch" else 0, "contact", lead)


def check_pre(pre: int, J: int) -> None:
    """Whether the first samples of taps of J samples can be before contact.

    Raises:
        InputError: They are negative in number, or none would be left.
    """
    if not 0 <= pre < J:
        most = f"; at most {J - 1} can be before contact" if J > 1 else ", which cannot be before contact"
        raise InputError(f"{OPTION} {pre}: taps have {J} sample{'s' * (J > 1)}{most}.")


def leading_samples(taps: NDArray[np.floating] | ScaledSamples, cell: NDArray[np.intp]) -> Lead:
    """In how many samples at the beginning of taps classes do not part.

    If taps begin before contact, these are free of contact, since touch is what differs between classes; taps that
    begin pressed, and are held for a while, look the same. So of each class the mean change since the first sample is
    taken, squared, freed of its expected share of noise, and averaged over classes and taxels: there it stays at zero
    however noisy the sensor. The leading samples are those before this exceeds 3% of its largest value (as an
    amplitude), less a fifth, since contact begins before that, and at least the first one. Where samples change by 30%
    of their largest change already from the first to the second, as in taps that begin in contact or whose samples are
    exchangeable, there are none.

    Args:
        taps: Shape (N, J, K); those of a large recording are read in blocks.
        cell: Class of each tap, shape (N,). Classes of one tap are left out unless there are no others; then noise
            counts as change, and the stretch is found too short.
    """
    J = taps.shape[1]
    index = np.unique(cell, return_inverse=True)[1]
    change = Taps(_change(taps), index, np.zeros_like(index), (int(index.max()) + 1, 1))
    squares = sum(change.over_blocks(lambda block, _: (block**2).sum(axis=(0, 2))))
    single = np.sqrt(squares / (taps.shape[0] * taps.shape[2]))
    if J == 1 or not single.any():
        return Lead(0, "none", np.zeros(J), np.zeros(J))
    single = single / single.max()
    between = _between_classes(change)
    between = between / between.max() if between.max() > 0 else single**2
    if single[1] > _UNREST:
        return Lead(0, "none", between, single)
    moved = (between > _STILL) | (single > _UNREST)
    samples = int(np.ceil(_SURE * np.argmax(moved)))
    return Lead(samples, "stretch" if samples > 1 else "first sample", between, single)


def _change(taps: NDArray[np.floating] | ScaledSamples) -> Any:
    """Change since the first sample, shape (N, J, K)."""
    if not isinstance(taps, ScaledSamples):
        return tared(np.asarray(taps, dtype=np.float64), 1)
    return ScaledSamples(TaredSamples(taps.samples, 1, np.float64).variable(taps.samples))


def _between_classes(change: Taps) -> NDArray[np.float64]:
    """Mean square over classes and taxels of their mean change, without the share of noise in it, shape (J,)."""
    moments = Moments.of(change)
    mean, count, repeated = moments.mean[:, 0], moments.taps[:, 0], moments.taps[:, 0] > 1
    if not repeated.any():
        return (mean**2).mean(axis=(0, 2))
    n = count[repeated][:, None, None]
    return (mean[repeated] ** 2 - moments.square[repeated, 0] / (n * (n - 1))).mean(axis=(0, 2))


def filter_memory(taps: TapSet) -> float:
    """Seconds for which a high-pass remembers; 0 where there is none, or it remembers half a session or more.

    Such a filter forgets the slow drift that would tell blocks of classes apart, and keeps what was just touched.
    """
    record = taps.preprocessing
    if not record.highpass_hz or not record.rate_hz:
        return 0.0
    memory = _SETTLED / (2 * np.pi * record.highpass_hz)
    session = len(taps) / len(np.unique(taps.session)) * record.samples / record.rate_hz
    return float(memory) if memory < session / 2 else 0.0
