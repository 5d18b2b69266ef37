"""Whether the samples of a tap can be a tap: what no count of frames and no checksum tells.

An SLCAN frame has no checksum behind the adapter, so a flipped bit of a hex digit arrives as another value; and a board
that calibrates by itself while it is pressed reads wrongly from then on. Both leave traces that a finger cannot.
"""

import numpy as np
from numpy.typing import NDArray

_REST_SAMPLES = 3
_JUMP_NOISE_LIMITS = 2.0
_REST_NOISE_LIMITS = 3.0


def implausible(samples: NDArray[np.float64], lead: int, noise_limit: float) -> str | None:
    """What is wrong with a tap, one phrase, or None.

    Args:
        samples: One tap of a sensor whose values rise under load, shape (J, K), with what was before the press first.
        lead: Samples from before the press, when nothing is touched.
        noise_limit: Largest standard deviation of an untouched taxel, in units of the samples; infinity if nothing is
            known of it, and then nothing is checked.
    """
    if not np.isfinite(noise_limit):
        return None
    jump = _jumps(samples)
    if jump.max(initial=0.0) > _JUMP_NOISE_LIMITS * noise_limit:
        j, k = np.unravel_index(np.argmax(jump), jump.shape)
        return f"taxel {k} jumped by {jump[j, k]:g} for one reading"
    if lead >= _REST_SAMPLES:
        shift = np.abs(samples[-_REST_SAMPLES:].mean(axis=0) - samples[:lead].mean(axis=0))
        if shift.max() > _REST_NOISE_LIMITS * noise_limit:
            k = int(np.argmax(shift))
            return f"taxel {k} came to rest {shift[k]:.1f} from where it was before the press"
    return None


def _jumps(samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far each sample lies beyond its neighbours and the lines through them, but the first and last; (J - 2, K).

    The lines let the turning point of a fast press pass.
    """
    if len(samples) < 3:
        return np.zeros((0, samples.shape[1]))
    padded = np.concatenate([samples[:1], samples, samples[-1:]])
    before, after = padded[1:-3], padded[3:-1]
    expected = np.stack([before, after, 2 * before - padded[:-4], 2 * after - padded[4:]])
    inner = samples[1:-1]
    return np.maximum(np.maximum(inner - expected.max(axis=0), expected.min(axis=0) - inner), 0.0)
