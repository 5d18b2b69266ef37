"""`student`: `gaussian` with heavier tails, fitted by stochastic variational inference."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..threads import one_numpyro
from .fits.posterior import Convergence, Sites, check_cells
from .fits.priors import Taps
from .likelihood.bins import TableForm
from .likelihood.forecasts import log_student_probability
from .likelihood.shapes import Measure, Parameters, standardised
from .model import Row
from .scaling import Moments
from .story import Story

_STEPS, _RATE, _RUNS = 600, 0.03, 5  # steps of a run, its first rate, and runs at most
_WINDOW = 50  # steps over which losses are averaged
_STILL = 0.5  # nats per tap between two windows
_SITES = ("freedom", "level", "scale")


def story(where: Any, what: Any, taps: Any = None, *, L: int, M: int, J: int, K: int, least: Any = 0.0) -> None:
    """Generative model: `gaussian` with Student's t samples; degrees of freedom per taxel, shared by all classes.

    Locations are normal and scales log-normal around what is typical of the taxel; the classes share the width of both.
    No scale counts for less than `least`, as a taxel at rest would have an unbounded density.
    """
    from .fits.story_parts import dist, jnp, numpyro

    with numpyro.plate("K", K, dim=-1):
        freedom: Any = numpyro.sample("freedom", dist.Gamma(2.0, 0.1))
        spread: Any = numpyro.sample("spread", dist.HalfCauchy(5.0))
        typical: Any = numpyro.sample("typical", dist.Normal(0.0, 2.0))
        variety: Any = numpyro.sample("variety", dist.HalfNormal(1.0))
        with numpyro.plate("L", L, dim=-4), numpyro.plate("M", M, dim=-3):
            level: Any = numpyro.sample("level", dist.Normal(0.0, spread))
            scale: Any = numpyro.sample("scale", dist.LogNormal(typical, variety))
    own = where, what
    with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("taxel", K, dim=-1):
        numpyro.sample("taps", dist.StudentT(freedom, level[own], jnp.maximum(scale[own], least)), obs=taps)


class StudentPosterior(NamedTuple):
    """Factorised normal posterior of the unconstrained parameters.

    Attributes:
        expected: Medians by name.
        sampled: From a key of JAX to a draw of all latent variables.
        rounds: Steps taken.
        change: Change of the mean loss between the last two windows of steps, in nats per tap.
        loss: Negative lower bound of the evidence after each step.
    """

    expected: dict[str, NDArray[np.float64]]
    sampled: Callable[[Any], dict[str, Any]]
    rounds: int
    change: float
    loss: NDArray[np.float64]

    def point(self) -> dict[str, NDArray[np.float64]]:
        """Medians."""
        return self.expected

    def convergence(self) -> Convergence:
        """Convergence of the loss."""
        sentence = (
            f"Variational inference, {self.rounds} steps; the mean loss of the last {_WINDOW} differs by "
            f"{self.change:.2g} nats per tap from that of the {_WINDOW} before (at most {_STILL:g})."
        )
        fine = bool(np.isfinite(self.loss[-1]) and self.change <= _STILL)
        return Convergence(fine, sentence, {"loss": self.loss, "change": np.array(self.change)})

    def draw(self, generator: np.random.Generator) -> dict[str, NDArray[np.float64]]:
        """Parameters from the posterior, and what is typical of their taxel."""
        import jax

        key = jax.random.key(int(generator.integers(2**31)))
        with one_numpyro():
            return {name: np.asarray(values, dtype=np.float64) for name, values in self.sampled(key).items()}


@one_numpyro()
def fit(taps: Taps) -> StudentPosterior:
    """Variational posterior of `story`, from few weighted samples in place of all."""
    import jax
    import jax.numpy as jnp
    import numpyro
    from numpyro.infer import SVI
    from numpyro.infer.autoguide import AutoNormal
    from numpyro.infer.initialization import init_to_value
    from numpyro.optim import Adam

    from .fits.condensed import condensed
    from .fits.story_parts import EvidenceBound

    moments = Moments.of(taps)
    start = jax.tree.map(jnp.asarray, _start(moments))
    used, weight = condensed(taps, moments)
    del moments  # of large recordings they are large, too
    # Taps are arguments of the programs, so these are the same for all taps of the same sizes and found on disk.
    told, (where, what, samples) = used.apart(_weighted)
    data = jnp.asarray(where), jnp.asarray(what), jnp.asarray(samples, dtype=jnp.float32)
    given = data, {"least": jnp.asarray(taps.least), "weight": jnp.asarray(weight, dtype=jnp.float32)}
    guide = AutoNormal(told, init_loc_fn=init_to_value(values=start))
    # In every run the rate falls to a fiftieth.
    svi = SVI(told, guide, Adam(lambda step: _RATE * 0.02 ** ((step % _STEPS) / _STEPS)), EvidenceBound())
    key, losses, change = jax.random.key(0), [], np.inf
    # Compiled as one program instead of one per operation. The guide keeps tracers, of which it reads only the shapes.
    state: Any = jax.jit(lambda data, least: svi.init(key, *data, **least))(*given)
    # One program for every run: `svi.run` compiles at each call.
    forward = jax.jit(
        lambda state, data, least: jax.lax.scan(lambda s, _: svi.update(s, *data, **least), state, length=_STEPS)
    )
    while change > _STILL and len(losses) < _RUNS:
        with numpyro.validation_enabled(False):  # which takes as long as the rest
            state, loss = forward(state, *given)
        losses.append(np.asarray(loss, dtype=np.float64) / len(taps.where))
        change = float(abs(losses[-1][-_WINDOW:].mean() - losses[-1][-2 * _WINDOW : -_WINDOW].mean()))
    params = svi.get_params(state)
    median: Any = guide.median(params)
    expected = {name: np.asarray(median[name], dtype=np.float64) for name in _SITES}
    sampled = jax.jit(lambda key: guide.sample_posterior(key, params))
    return StudentPosterior(expected, sampled, _STEPS * len(losses), change, np.concatenate(losses))


def _weighted(*told: Any, weight: Any, **more: Any) -> None:
    """`story` of samples that count as often as they weigh, shape (N, J, K)."""
    from .fits.present import Weighted

    with Weighted("taps", weight):
        story(*told, **more)


def _start(moments: Moments) -> dict[str, NDArray[np.float64]]:
    """Initial values: moments of each class and taxel."""
    count, level, square = moments.pooled()
    scale = np.where(count > 0, np.sqrt(square / np.maximum(count, 1)) + 0.05, 1.0)
    return {"level": level, "scale": 0.7 * scale, "freedom": np.full(level.shape[-1], 4.0)}


def parameters_of(sites: Sites) -> Sites:
    """All latent variables."""
    return sites


def arguments(taps: Taps, _: Any) -> dict[str, Any]:
    """Arguments of `story` besides taps."""
    return {"least": taps.least}


def form(parameters: Parameters, frame: Measure) -> TableForm:
    """Likelihood of bins under `story`."""
    lower, upper = standardised(parameters["level"], parameters["scale"], frame)
    return TableForm(log_student_probability(lower, upper, parameters["freedom"][:, None]))


MODEL = Story(
    name="student",
    row=Row("bins", "Student's t per class and taxel, for heavier tails"),
    story=story,
    dims={
        "level": ("where", "what", "once", "taxel"),
        "scale": ("where", "what", "once", "taxel"),
        "freedom": ("taxel",),
    },
    positive=("scale", "freedom"),
    exchangeable=True,
    check=check_cells,
    closed=fit,
    form=form,
    arguments=arguments,
    parameters=parameters_of,
    own_threads=True,
    independent=True,
)
