"""What is read from a belief when the taps of an episode depend on each other: never more than n0 taps' evidence.

Taps of one episode share what nobody knows of it, such as the gain of the sensor that day, so n of them do not tell n
times as much as one. Bayes' rule over taps and moves goes on as if they were independent. What is decided by and shown
after n taps is that belief to the power min(1, n0 / n), normalised. In log beliefs this is the mean evidence of the
taps so far, counted n0 times. It changes no order between classes, so that it delays decisions and changes answers
through moves and the sums of marginals only. `kernel.temper` and `trials.gpu.temper` are the same, compiled.
"""

import numpy as np
from numpy.typing import NDArray


def share(taps: int, saturation: float) -> float:
    """The power of a belief after some taps, 1 up to `saturation` of them."""
    return 1.0 if taps <= saturation else saturation / taps


def temper(log_belief: NDArray[np.float64], power: float) -> NDArray[np.float64]:
    """Beliefs to a power, normalised over the classes or hypotheses; at power 1 the very same array.

    Args:
        log_belief: Shape (..., L, H), with something above log 0 in each.
        power: Above 0.
    """
    if power == 1:
        return log_belief
    raised = power * log_belief
    top = raised.max(axis=(-2, -1), keepdims=True)
    return raised - (top + np.log(np.exp(raised - top).sum(axis=(-2, -1), keepdims=True)))
