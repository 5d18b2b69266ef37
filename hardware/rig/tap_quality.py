"""Plausibility of the samples of a tap, beyond frame counts and checksums.

SLCAN frames have no checksum after the adapter, so a flipped bit of a hex digit arrives as another value; and a board
that recalibrates under load gives wrong readings from then on. Both leave traces that contact cannot cause.
"""

import numpy as np
from numpy.typing import NDArray

_REST_SAMPLES = 3
_JUMP_NOISE_LIMITS = 2.0
_REST_NOISE_LIMITS = 3.0


def implausible(samples: NDArray[np.float64], lead: int, noise_limit: float) -> str | None:
    """Why a tap is implausible, as a phrase, or None.

    Args:
        samples: One tap of a sensor whose values rise under load, shape (J, K), starting before the press.
        lead: Number of samples before the press, without contact.
        noise_limit: Largest standard deviation of an untouched taxel, in units of the samples; infinity if unknown,
            and then nothing is checked.
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
            return f"taxel {k} returned to {shift[k]:.1f} away from its value before the press"
    return None


def _jumps(samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance of each inner sample from its neighbours and the lines through them, shape (J - 2, K).

    The lines admit the turning point of a fast press.
    """
    if len(samples) < 3:
        return np.zeros((0, samples.shape[1]))
    padded = np.concatenate([samples[:1], samples, samples[-1:]])
    before, after = padded[1:-3], padded[3:-1]
    expected = np.stack([before, after, 2 * before - padded[:-4], 2 * after - padded[4:]])
    inner = samples[1:-1]
    return np.maximum(np.maximum(inner - expected.max(axis=0), expected.min(axis=0) - inner), 0.0)
