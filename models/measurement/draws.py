"""Draws from the posterior of a fitted model and pointwise log probabilities of the training taps, for ArviZ.

The parameters of one draw after the other become a form, so that memory holds the draws in single precision and little
else. Every draw has random numbers of its own, so it does not matter which of them are made at the same time.
"""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..io.model_file import Draws
from ..seeds import Purpose, generator
from ..taps import TapSet
from ..threads import cores, in_order, one_blas_thread
from .generic.story import GenericModel
from .likelihood.shapes import Parameters
from .likelihood.true_class import Own, OwnTaps
from .model import Fitted, TapModel
from .story import ParametricModel

CHAINS = 4


def posterior_draws(
    fitted: Fitted,
    taps: TapSet,
    chains: int,
    draws: int,
    seed: int,
    progress: Callable[[int], None] | None = None,
) -> Draws:
    """Draws of the parameters, and the log probability of each training tap under its own class at power 1.

    In a model with states a tap has the mean of its probabilities over the states before it.

    Args:
        fitted: The model and its posterior.
        taps: Training taps; those outside its classes are left out.
        chains: How many chains to sort the draws into; all draws are independent.
        draws: Number of draws per chain.
        seed: Random seed of the draws.
        progress: Called with the number of draws since the last call.

    Raises:
        InputError: The model has no posterior, or less than one draw is asked for.
    """
    model = fitted.model
    if fitted.posterior is None:
        raise InputError(
            f"A {model.name} model without a pseudocount has no posterior to draw from: its prior is improper."
        )
    if min(chains, draws) < 1:
        raise InputError(f"draws and chains must be at least 1, got {draws} and {chains}.")
    used = model.usable(taps)
    kept: dict[str, NDArray[np.float32]] = {}
    log_likelihood = np.empty((chains, draws, len(used)), dtype=np.float32)
    for number, (parameters, values) in enumerate(drawn(fitted, used, chains * draws, seed)):
        place = divmod(number, draws)
        for name in model.dims:
            if name not in kept:
                kept[name] = np.empty((chains, draws, *parameters[name].shape), dtype=np.float32)
            kept[name][place] = parameters[name]
        log_likelihood[place] = values
        if progress is not None:
            progress(1)
    return Draws(kept, log_likelihood)


def drawn(fitted: Fitted, taps: TapSet, draws: int, seed: int) -> Iterator[tuple[Parameters, NDArray[np.float64]]]:
    """Draws of the parameters, each with the log probability of every tap under its own class, shape (N,).

    Args:
        fitted: The model and its posterior, which must be there.
        taps: Taps of trained classes.
        draws: How many.
        seed: Random seed of the draws.
    """
    model, posterior = fitted.model, fitted.posterior
    if posterior is None:
        raise ValueError(f"{model.name} has no posterior to draw from.")
    own = OwnTaps(taps.taps, taps.indices(model.grid), model.edges, model.states)

    def draw(number: int) -> tuple[Parameters, NDArray[np.float64]]:
        parameters = posterior.draw(generator(seed, Purpose.PARAMETERS, number))
        return parameters, own.log_probability(model.form_of(parameters))

    with one_blas_thread():
        yield from in_order((partial(draw, number) for number in range(draws)), _threads(model))


def _threads(model: TapModel) -> int:
    if isinstance(model, GenericModel):  # NumPyro runs models in one thread at a time
        return 1
    return 1 if isinstance(model, ParametricModel) and model.story.own_threads else cores(None)


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
