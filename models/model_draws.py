"""Draws from the posterior of a fitted model, and what they say of the training taps: the input of ArviZ.

The parameters of one draw after the other become a form, so that memory holds the draws in single precision and little
else. Every draw has random numbers of its own, so it does not matter which of them are made at the same time.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from .bins import find_bins
from .catalogue import Fitted
from .errors import InputError
from .forms import Form, TableForm, bin_gaps
from .histogram import HistogramModel
from .innovations import own_log_masses
from .model import TapModel
from .model_file import DIMS, Draws
from .parametric import FORMS, ParametricModel
from .shapes import Parameters
from .taps import TapSet
from .threads import cores, in_order

CHAINS = 4


def posterior_draws(
    fitted: Fitted,
    taps: TapSet,
    chains: int,
    draws: int,
    seed: int,
    progress: Callable[[int], None] | None = None,
) -> Draws:
    """Draws of the parameters and the log probability of every training tap under its own class at power 1.

    In a model with states a tap has the mean of its probabilities over the states before it.

    Args:
        fitted: The model and its posterior.
        taps: Training taps; those outside its classes are left out.
        chains: How many chains to sort the draws into; all draws are independent.
        draws: Of each chain.
        seed: Of the draws.
        progress: Told how many draws more are done.

    Raises:
        InputError: The model has no posterior, or less than one draw is asked for.
    """
    model, posterior = fitted.model, fitted.posterior
    if posterior is None:
        raise InputError(
            f"A {model.name} model without a pseudocount has no posterior to draw from: its prior is improper."
        )
    if min(chains, draws) < 1:
        raise InputError(f"At least one draw and one chain are needed, got {draws} and {chains}.")
    own = _Own(model, model.usable(taps))

    def draw(number: int) -> tuple[Parameters, NDArray[np.float64]]:
        parameters = posterior.draw(np.random.default_rng([seed, number]))
        return parameters, own.log_probability(_form(model, parameters))

    kept: dict[str, NDArray[np.float32]] = {}
    log_likelihood = np.empty((chains, draws, own.taps), dtype=np.float32)
    tasks = (partial(draw, number) for number in range(chains * draws))
    for number, (parameters, values) in enumerate(in_order(tasks, _threads(model))):
        place = divmod(number, draws)
        for name in DIMS[model.kind]:
            if name not in kept:
                kept[name] = np.empty((chains, draws, *parameters[name].shape), dtype=np.float32)
            kept[name][place] = parameters[name]
        log_likelihood[place] = values
        if progress is not None:
            progress(1)
    return Draws(kept, log_likelihood)


def _threads(model: TapModel) -> int:
    return 1 if model.kind == "student" else cores(None)  # JAX has threads of its own


def _form(model: TapModel, parameters: Parameters) -> Form:
    """What drawn parameters mean for bins, in the state of gain 1 and offset 0."""
    if isinstance(model, ParametricModel):
        return FORMS[model.story](parameters, model.frame)
    if isinstance(model, HistogramModel):
        return TableForm(parameters["log_prob"])
    raise TypeError(f"A model of type {type(model).__name__} has no draws.")


class _Own:
    """Training taps ready for many forms.

    Args:
        model: Theirs.
        taps: Of trained classes.
    """

    def __init__(self, model: TapModel, taps: TapSet) -> None:
        self._states, self._edges = model.states, model.edges
        self._where, self._what = taps.indices(model.grid)
        self._gaps = bin_gaps(taps.taps, model.edges)
        self._bins = find_bins(taps.taps, model.edges)
        self.taps = len(taps)

    def log_probability(self, form: Form) -> NDArray[np.float64]:
        """Log probability of the bins of every tap under its class, shape (N,)."""
        parts = [
            log_prior + self._plain(self._in_state(form, gain, offset))
            for gain, offset, log_prior in zip(*(values.tolist() for values in self._states), strict=True)
        ]
        return parts[0] if len(parts) == 1 else np.logaddexp.reduce(parts, axis=0)

    def _in_state(self, form: Form, gain: float, offset: float) -> Form:
        if gain == 1 and offset == 0:
            return form
        return form.in_state(gain, offset, self._edges) if isinstance(form, TableForm) else form.in_state(gain, offset)

    def _plain(self, form: Form) -> NDArray[np.float64]:
        if isinstance(form, TableForm):
            own = self._where[:, np.newaxis, np.newaxis], self._what[:, np.newaxis, np.newaxis]
            return form.log_prob[*own, np.arange(self._bins.shape[2]), self._bins].sum(axis=(1, 2))
        ready = form.prepare(np.zeros(form.shape, dtype=bool))
        out = np.empty(self.taps)
        own_log_masses(*self._gaps, self._where * form.shape[1] + self._what, *ready[:-1], out)
        return out
