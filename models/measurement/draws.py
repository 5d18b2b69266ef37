"""Draws from the posterior of a fitted model and pointwise log probabilities of the training taps, for ArviZ.

The parameters of one draw after the other become a form, so that memory holds the draws in single precision and little
else. Every draw has random numbers of its own, so it does not matter which of them are made at the same time.
"""

from collections.abc import Callable, Iterator
from functools import partial
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..seeds import Purpose, generator
from ..taps import TapSet
from ..threads import cores, in_order, one_blas_thread
from .generic.story import GenericModel
from .likelihood.bins import TableForm, find_bins
from .likelihood.forms import GaussianForm
from .likelihood.shapes import Parameters
from .likelihood.true_class import Own, OwnTaps
from .model import Fitted, TapModel, in_states
from .states import States
from .story import ParametricModel

CHAINS = 4


class Draws(NamedTuple):
    """Posterior draws stored with a model, for ArviZ.

    Attributes:
        parameters: Draws by name, shapes (chain, draw, ...).
        log_likelihood: Log-likelihood of each training tap under its class at power 1, shape (chain, draw, N).
    """

    parameters: dict[str, NDArray[np.float32]]
    log_likelihood: NDArray[np.float32]


class Chosen(NamedTuple):
    """Draws of a posterior in their order.

    Attributes:
        shape: Numbers of chains and of draws of each.
        at: From the number of a draw to parameters.
    """

    shape: tuple[int, int]
    at: Callable[[int], Parameters]

    @classmethod
    def of(cls, posterior: Any, chains: int, draws: int, seed: int) -> "Chosen":
        """Independent draws, sorted into chains, or those of Markov chains, evenly thinned to as many at most.

        Args:
            posterior: The posterior.
            chains: How many chains to sort independent draws into.
            draws: How many in all.
            seed: Random seed of the draws.
        """
        sizes = getattr(posterior, "sizes", None)
        if sizes is None:
            at = lambda number: posterior.draw(generator(seed, Purpose.PARAMETERS, number))  # noqa: E731
            return cls((chains, draws // chains), at)
        kept = np.linspace(0, sizes[1] - 1, max(1, min(sizes[1], draws // sizes[0]))).astype(np.intp)

        def chained(number: int) -> Parameters:
            chain, draw = divmod(number, len(kept))
            return posterior.at(chain, kept[draw], generator(seed, Purpose.PARAMETERS, number))

        return cls((sizes[0], len(kept)), chained)


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
        chains: How many chains to sort independent draws into; Markov chains stay as they are.
        draws: Number of draws per chain, of Markov chains at most.
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
    used, chosen = model.usable(taps), Chosen.of(fitted.posterior, chains, chains * draws, seed)
    kept: dict[str, NDArray[np.float32]] = {}
    log_likelihood = np.empty((*chosen.shape, len(used)), dtype=np.float32)
    for number, (parameters, values) in enumerate(drawn(fitted, used, prod(chosen.shape), seed, chosen.at)):
        place = divmod(number, chosen.shape[1])
        for name in model.dims:
            if name not in kept:
                kept[name] = np.empty((*chosen.shape, *parameters[name].shape), dtype=np.float32)
            kept[name][place] = parameters[name]
        log_likelihood[place] = values
        if progress is not None:
            progress(1)
    return Draws(kept, log_likelihood)


def drawn(
    fitted: Fitted, taps: TapSet, draws: int, seed: int, at: Callable[[int], Parameters] | None = None
) -> Iterator[tuple[Parameters, NDArray[np.float64]]]:
    """Draws of the parameters, each with the log probability of every tap under its own class, shape (N,).

    Args:
        fitted: The model and its posterior, which must be there.
        taps: Taps of trained classes.
        draws: How many.
        seed: Random seed of the draws.
        at: From the number of a draw to parameters; default any draw from the posterior.
    """
    model, posterior = fitted.model, fitted.posterior
    if posterior is None:
        raise ValueError(f"{model.name} has no posterior to draw from.")
    own = OwnTaps(taps.taps, model.training_hypotheses(taps), model.edges, model.states)

    def draw(number: int) -> tuple[Parameters, NDArray[np.float64]]:
        parameters = posterior.draw(generator(seed, Purpose.PARAMETERS, number)) if at is None else at(number)
        return parameters, own.log_probability(model.training_form(parameters))

    with one_blas_thread():
        yield from in_order((partial(draw, number) for number in range(draws)), threads_of(model))


def threads_of(model: TapModel) -> int:
    """How many draws of its parameters may be made at the same time; NumPyro runs models in one thread at a time."""
    return 1 if by_numpyro(model) else cores(None)


def by_numpyro(model: TapModel) -> bool:
    """Whether NumPyro makes the draws of its parameters, unless they are chains that are made already."""
    return isinstance(model, GenericModel) or (isinstance(model, ParametricModel) and model.story.own_threads)


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
    for gain, offset, log_prior in zip(*model.states.apart(), strict=True):
        parts.append(log_prior + model.integrated(posterior, taps, own, generator, gain, offset))
    return np.logaddexp.reduce(parts, axis=0)


def replicated_bins(
    parameters: Parameters, model: TapModel, taps: TapSet, generator: np.random.Generator
) -> NDArray[np.integer]:
    """Bins of taps drawn at known parameters, of the classes of given training taps, shape (N, J, K).

    All taps of a session are in one state, or in that session where the model has latent variables of sessions, and,
    where the model knows places within a class, at the places given.
    """
    plain, states = model.training_form(parameters), model.states.apart()
    drawn, state = np.unique(_states_of_sessions(states.log_prior, taps.session, generator), return_inverse=True)
    form = in_states(plain, States(*(each[drawn] for each in states)), model.edges)
    where, own = model.training_hypotheses(taps)
    hypothesis = state * plain.shape[1] + own
    J = taps.taps.shape[1]
    if isinstance(form, TableForm):
        return form.sample_bins(where, hypothesis, J, generator)
    if not isinstance(form, GaussianForm) or len(form.log_weight) == 1 or model.grid.where_edges is None:
        made = form.sample(where, hypothesis, model.edges, J, generator)
    else:
        edges, Q = model.grid.where_edges, len(form.log_weight)
        share = (taps.where - edges[where]) / np.diff(edges)[where]
        made, q = np.empty(taps.taps.shape), np.clip((share * Q).astype(int), 0, Q - 1)
        for i in np.unique(q):
            this = q == i
            at = form._replace(mean=form.mean[i : i + 1], scale=form.scale[i : i + 1], log_weight=np.zeros(1))
            made[this] = at.sample(where[this], hypothesis[this], model.edges, J, generator)
    return find_bins(made, model.edges)


def _states_of_sessions(
    log_prior: NDArray[np.float64], session: NDArray[np.int64], generator: np.random.Generator
) -> NDArray[np.intp]:
    """One state for all taps of a session, shape (N,)."""
    numbers, index = np.unique(session, return_inverse=True)
    return generator.choice(len(log_prior), size=len(numbers), p=np.exp(log_prior))[index]
