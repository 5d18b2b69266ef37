"""Posterior of `student` by stochastic variational inference in NumPyro."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from numpyro.infer import SVI, Trace_ELBO
from numpyro.infer.autoguide import AutoNormal
from numpyro.infer.initialization import init_to_value
from numpyro.optim import Adam

from ..scaling import Moments
from ..stories import student
from .convergence import Convergence
from .priors import Taps

_STEPS, _RATE, _RUNS = 600, 0.03, 5  # steps of a run, its first rate, and runs at most
_WINDOW = 50  # steps over which losses are averaged
_STILL = 0.5  # nats per tap between two windows
_SITES = ("freedom", "level", "scale")


class StudentPosterior(NamedTuple):
    """A normal posterior of the unconstrained parameters, all independent.

    Attributes:
        expected: Medians by name.
        guide: NumPyro's guide.
        state: Its parameters.
        rounds: Steps taken.
        change: Change of the mean loss between the last two windows of steps, in nats per tap.
        loss: Negative lower bound of the evidence after each step.
    """

    expected: dict[str, NDArray[np.float64]]
    guide: AutoNormal
    state: dict[str, jax.Array]
    rounds: int
    change: float
    loss: NDArray[np.float64]

    def point(self) -> dict[str, NDArray[np.float64]]:
        """Medians."""
        return self.expected

    def convergence(self) -> Convergence:
        """Whether the loss stands still."""
        sentence = (
            f"Variational inference, {self.rounds} steps; the mean loss of the last {_WINDOW} differs by "
            f"{self.change:.2g} nats per tap from that of the {_WINDOW} before (at most {_STILL:g})."
        )
        fine = bool(np.isfinite(self.loss[-1]) and self.change <= _STILL)
        return Convergence(fine, sentence, {"loss": self.loss, "change": np.array(self.change)})

    def draw(self, generator: np.random.Generator) -> dict[str, NDArray[np.float64]]:
        """Parameters from the posterior."""
        key = jax.random.key(int(generator.integers(2**31)))
        drawn: Any = self.guide.sample_posterior(key, self.state)
        return {name: np.asarray(drawn[name], dtype=np.float64) for name in _SITES}


def fit_student(taps: Taps, least: NDArray[np.float64] | float = 0.0) -> StudentPosterior:
    """Variational posterior of `stories.student`.

    Args:
        taps: Scaled training taps.
        least: Scale below which none counts, shape (K,) or a number.
    """
    guide = AutoNormal(student, init_loc_fn=init_to_value(values=_start(taps)))
    # In every run the rate falls to a fiftieth.
    svi = SVI(student, guide, Adam(lambda step: _RATE * 0.02 ** ((step % _STEPS) / _STEPS)), Trace_ELBO())
    data: Any = taps._replace(samples=jnp.asarray(taps.samples, dtype=jnp.float32))
    state, losses, change = None, [], np.inf
    while change > _STILL and len(losses) < _RUNS:
        result = svi.run(jax.random.key(0), _STEPS, data, least, progress_bar=False, init_state=state)
        state = result.state
        losses.append(np.asarray(result.losses, dtype=np.float64) / len(taps.where))
        change = float(abs(losses[-1][-_WINDOW:].mean() - losses[-1][-2 * _WINDOW : -_WINDOW].mean()))
    params = svi.get_params(state)
    median: Any = guide.median(params)
    expected = {name: np.asarray(median[name], dtype=np.float64) for name in _SITES}
    return StudentPosterior(expected, guide, params, _STEPS * len(losses), change, np.concatenate(losses))


def _start(taps: Taps) -> dict[str, jax.Array]:
    """Where the search begins: moments of each class and taxel."""
    moments, J = Moments.of(taps), taps.samples.shape[1]
    level = moments.mean.mean(axis=2, keepdims=True)
    square = (moments.square + moments.taps[..., None, None] * (moments.mean - level) ** 2).sum(axis=2, keepdims=True)
    used = np.maximum(J * moments.taps, 1)[..., None, None]
    scale = np.where(moments.taps[..., None, None] > 0, np.sqrt(square / used) + 0.05, 1.0)
    start = {"level": level, "scale": 0.7 * scale, "freedom": np.full(level.shape[-1], 4.0)}
    return {name: jnp.asarray(values) for name, values in start.items()}
