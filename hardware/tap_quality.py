"""Whether the samples of a tap can be a tap: what no count of frames and no checksum tells.

An SLCAN frame has no checksum behind the adapter, so a flipped bit of a hex digit arrives as another value; and a board
that calibrates by itself while it is pressed reads wrongly from then on. Both leave traces that a finger cannot.
"""

import numpy as np
from numpy.typing import NDArray

_REST_SAMPLES = 3


def implausible(samples: NDArray[np.float64], lead: int, limit: float) -> str | None:
    """What is wrong with a tap, one phrase, or None.

    Args:
        samples: One tap of a sensor whose values rise under load, shape (J, K), with what was before the press first.
        lead: Samples from before the press, when nothing is touched.
        limit: How far a value may stray without a reason, in units of the samples; infinity checks nothing.
    """
    if not np.isfinite(limit):
        return None
    spike = _spikes(samples)
    if spike.max(initial=0.0) > limit:
        j, k = np.unravel_index(np.argmax(spike), spike.shape)
        return f"taxel {k} jumped by {spike[j, k]:g} for one reading"
    if lead >= _REST_SAMPLES:
        shift = np.abs(samples[-_REST_SAMPLES:].mean(axis=0) - samples[:lead].mean(axis=0))
        if shift.max() > limit:
            k = int(np.argmax(shift))
            return f"taxel {k} came to rest {shift[k]:.1f} from where it was before the press"
    return None


def _spikes(samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """By how much each sample but the first and last lies beyond both its neighbours, shape (J - 2, K)."""
    before, after = samples[1:-1] - samples[:-2], samples[1:-1] - samples[2:]
    return np.where(np.sign(before) == np.sign(after), np.minimum(np.abs(before), np.abs(after)), 0.0)
