"""Log probability of new taps under their own classes, integrated over the posterior or at a point estimate.

Levels and variances of cells are integrated exactly, which makes forecasts Student's t; what cells share is integrated
by averaging over draws. Averaging over draws of everything would not do: a tap has hundreds of samples, and the mean of
so many factors is carried by draws too rare to be seen.
"""

import numpy as np
from numpy.typing import NDArray

from .likelihood.true_class import Own, OwnTaps
from .model import Fitted


def plug_in(fitted: Fitted, taps: NDArray[np.floating], own: Own) -> NDArray[np.float64]:
    """Log probability of the bins of taps (N, J, K) at the point estimate, shape (N,)."""
    model = fitted.model
    return OwnTaps(taps, own, model.edges, model.states).log_probability(model.plain_form)


def integrated(
    fitted: Fitted, taps: NDArray[np.floating], own: Own, generator: np.random.Generator
) -> NDArray[np.float64]:
    """Predictive log probability of the bins of taps (N, J, K), given the training taps, shape (N,).

    Args:
        fitted: A fit with a posterior.
        taps: Taps that did not train it.
        own: Their classes.
        generator: Random generator of the draws.
    """
    model, posterior = fitted.model, fitted.posterior
    if posterior is None:
        raise ValueError(f"{model.name} has no posterior to integrate over.")
    parts = []
    for gain, offset, log_prior in zip(*model.states, strict=True):
        parts.append(log_prior + model.integrated(posterior, taps, own, generator, gain, offset))
    return np.logaddexp.reduce(parts, axis=0)
