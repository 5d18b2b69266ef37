"""Posteriors of any generative model: variational, by chains, or at and around the most probable values.

Hoffman and Gelman, JMLR 15 (2014) 1593 (NUTS); Kucukelbir et al., JMLR 18 (2017) 14 (automatic variational inference).
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
import numpyro
from numpy.typing import NDArray
from numpyro.handlers import block, seed, trace
from numpyro.infer import SVI, Predictive, Trace_ELBO, TraceEnum_ELBO
from numpyro.infer.autoguide import AutoDelta, AutoLaplaceApproximation, AutoNormal
from numpyro.infer.initialization import init_to_median
from numpyro.infer.util import constrain_fn, unconstrain_fn
from numpyro.optim import Adam

from ...errors import InputError
from ...progress import Progress, no_progress
from ...seeds import Purpose, derived_seed, generator
from ..fits.nuts import sample_story
from ..fits.posterior import Convergence
from ..fits.present import Present
from ..likelihood.shapes import Parameters
from .contract import StoryCall, StoryFunction
from .observed import Supported
from .posteriors import ChainPosterior, GuidePosterior
from .programs import OfOne, compiled_once
from .runs import key_from
from .structure import OBSERVED, Structure, told_in

STARTS, TRIED, STEPS, RUNS = 3, 200, 800, 5
"""Of a variational fit: random starts, steps of each, then steps of a run from the best one, and runs at most."""
_RATE, _WINDOW = 0.03, 100
_AT_ONCE = 50  # steps of one call of the compiled program; TRIED and STEPS are multiples of it
_STILL, _IN_ALL, _PER_SAMPLE = 0.1, 3.0, 1e-3  # change between windows in nats per tap, in all, and per sample
_CENTRED = 200  # draws of a guide whose mean is taken
_TRIES = 10  # draws from the prior at which a density is looked at
_FAR = 10.0  # times by which a prior must miss the level or spread of the taps to be called far
_OUTSIDE = "keep bounds of distributions outside of the samples by their priors"
_AUTOMATIC = AutoNormal | AutoDelta | AutoLaplaceApproximation
_silent = no_progress("", 0)
_MOST_CURVED = 5000  # dimensions of a Laplace approximation


class Fit(NamedTuple):
    """What a fit works on.

    Attributes:
        story: The model.
        structure: Its sites.
        batch: The training taps' classes.
        samples: Their samples in the units of the model, shape (N, J, K).
        seed: Random seed.
        steps: Steps of the fit at most; default as `posterior` says.
        progress: Called with the name of a stage and its number of steps; returns the function that advances it.
        present: Mask of the samples that are there, shape (N, J, K); `None` if all are. Others do not count.
    """

    story: StoryFunction
    structure: Structure
    batch: StoryCall
    samples: NDArray[np.float64]
    seed: int
    steps: int | None = None
    progress: Progress = no_progress
    present: NDArray[np.bool_] | None = None

    def run(self, samples: Any, where: Any = None, what: Any = None) -> Any:
        """The model on the training taps; their classes may be given, to be no constants of a program."""
        story: Any = self.story
        if self.present is not None:
            story = Present(story, OBSERVED, self.present.swapaxes(1, 2) if self.structure.swapped else self.present)
        return Supported(story, OBSERVED)(self._of(where, what), samples)

    def guide(self, samples: Any, where: Any = None, what: Any = None) -> Any:
        """The function's own guide, likewise."""
        return self.story.guide_of(self._of(where, what), samples)

    def _of(self, where: Any, what: Any) -> StoryCall:
        return self.batch if where is None else replace(self.batch, where=where, what=what)

    @property
    def data(self) -> tuple[Any, Any, Any]:
        """Samples, position and object indices of the taps, on the device."""
        samples, *classes = self.samples, self.batch.where, self.batch.what
        return jax.numpy.asarray(samples), *map(jax.numpy.asarray, classes)

    @property
    def summed(self) -> Callable[[Any], Any]:
        """The same, marked so that discrete latent variables are summed out."""
        if not self.structure.enumerated:
            return self.run
        from numpyro.contrib.funsor import config_enumerate

        return config_enumerate(self.run)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the continuous latent variables."""
        return tuple(self.structure.dims)


def posterior(fit: Fit, method: str) -> GuidePosterior | ChainPosterior:
    """Posterior of the latent variables.

    Args:
        fit: What to fit.
        method: `svi`, `nuts`, `map` or `laplace`. Chains take `nuts.STEPS` steps by default; the others at most `RUNS`
            runs of `STEPS` steps, or as many whole runs as hold the steps given.

    Raises:
        InputError: The model fails, its density is nowhere finite, or there are too many latent variables for
            `laplace`.
    """
    with running(fit):
        if method == "nuts":
            return _chains(fit)
        if method == "laplace":
            _check_size(fit)
        return Variational.of(fit, method).posterior(fit)


@contextmanager
def running(fit: Fit) -> Iterator[None]:
    """Runs a user's function in double precision; what it raises becomes a sentence."""
    with jax.enable_x64(True), numpyro.validation_enabled(False):
        try:
            yield
        except InputError:
            raise
        except (Exception, SystemExit) as error:  # whatever a user's function raises
            raise InputError(f"{fit.story.name} cannot be fitted{told_in(fit.story, error)}") from error


def _check_size(fit: Fit) -> None:
    latents: Any = jax.eval_shape(lambda: latents_from_prior(fit))
    size = sum(values.size for values in latents.values())
    if size > _MOST_CURVED:
        raise InputError(
            f"--fit laplace inverts a matrix of all latent variables; {fit.story.name} has {size}, at most "
            f"{_MOST_CURVED} are possible. Use svi."
        )


def latents_from_prior(fit: Fit) -> dict[str, Any]:
    """Latent variables from the prior."""
    sites = trace(seed(fit.run, 0)).get_trace(fit.samples)
    return {name: sites[name]["value"] for name in fit.names}


class Variational(NamedTuple):
    """A variational fit as compiled programs, for all taps of the same classes and numbers that lack the same samples.

    Attributes:
        method: `svi`, `map` or `laplace`.
        guide: Its guide.
        svi: What is fitted.
        begin: From a key and data to a state.
        forward: From a state and data to the state some steps later, and their losses.
        drawn: From a key, parameters of the guide and data to latent variables.
    """

    method: str
    guide: Any
    svi: SVI
    begin: Callable[[Any, Any], Any]
    forward: Callable[[Any, Any], tuple[Any, Any]]
    drawn: Callable[[Any, Any, Any], dict[str, Any]]

    @classmethod
    def of(cls, fit: Fit, method: str) -> "Variational":
        """Programs for taps like those of a fit."""
        # Values made from latent variables, too: a guide would run the model for them without its taps.
        hidden = block(
            fit.run, hide_fn=lambda s: s["type"] == "deterministic" or s.get("name") in fit.structure.enumerated
        )
        kinds: dict[str, Any] = {"svi": AutoNormal, "map": AutoDelta, "laplace": AutoLaplaceApproximation}
        if method == "svi" and fit.story.guide is not None:
            guide: Any = fit.guide
        else:
            guide = kinds[method](hidden, init_loc_fn=init_to_median)
        loss = TraceEnum_ELBO(max_plate_nesting=8) if fit.structure.enumerated else Trace_ELBO()
        # In every run the rate falls to a fiftieth.
        svi = SVI(fit.summed, guide, Adam(lambda step: _RATE * 0.02 ** ((step % STEPS) / STEPS)), loss)
        own = fit.data

        def begin(key: Any, data: Any) -> Any:
            # Guides keep tracers, of which they read only the shapes; that of `laplace` computes with its samples.
            with OfOne():
                return svi.init(key, *(own if method == "laplace" else data))

        def forward(state: Any, data: Any) -> tuple[Any, Any]:
            with OfOne():
                return jax.lax.scan(lambda s, _: svi.update(s, *data), state, length=_AT_ONCE)

        def drawn(key: Any, params: Any, data: Any) -> Any:
            if isinstance(guide, _AUTOMATIC):
                return guide.sample_posterior(key, params)
            found: Any = Predictive(guide, params=params, num_samples=1)(key, *data)
            return {name: found[name][0] for name in fit.names}

        # Compiled as one program instead of one per operation, and once for every run: `svi.run` compiles at each call.
        return cls(method, guide, svi, compiled_once(begin), compiled_once(forward), compiled_once(drawn))

    @property
    def starts(self) -> int:
        """Number of random starts."""
        return STARTS if self.method == "svi" else 1

    def best_start(
        self, fit: Fit, advance: Callable[[int], None] = _silent
    ) -> tuple[Any, NDArray[np.float64], list[float]]:
        """State and losses of the best of some short runs from random starts, and the mean losses at all ends.

        Raises:
            InputError: The log density is not finite at any start.
        """
        keys = [jax.random.key(derived_seed(fit.seed, Purpose.CHAINS, number)) for number in range(self.starts)]
        begun = [self.run(TRIED, self.begin(key, fit.data), fit, advance) for key in keys]
        ends = [float(losses[-_WINDOW:].mean()) for _, losses in begun]
        if not np.isfinite(ends).any():
            raise InputError(
                f"The log density of {fit.story.name} is not finite at any start; check scales, and {_OUTSIDE}."
            )
        return *begun[int(np.nanargmin(ends))], ends

    def run(
        self, steps: int, state: Any, fit: Fit, advance: Callable[[int], None] = _silent
    ) -> tuple[Any, NDArray[np.float64]]:
        """State after some more steps, and their losses in nats per tap; `advance` is called with numbers of steps."""
        data, losses = fit.data, []
        for _ in range(steps // _AT_ONCE):
            state, more = self.forward(state, data)
            # Waits for the result, so a signal is handled here.
            losses.append(np.asarray(more, dtype=np.float64) / len(fit.samples))
            advance(_AT_ONCE)
        return state, np.concatenate(losses)

    def posterior(self, fit: Fit) -> GuidePosterior:
        """Posterior given the taps of a fit."""
        most = RUNS if fit.steps is None else -(-fit.steps // STEPS)
        advance = fit.progress(f"{fit.story.name}, steps", self.starts * TRIED + most * STEPS)
        state, losses, ends = self.best_start(fit, advance)
        still, runs, change = largest_change(fit), 0, np.inf
        while change > still and runs < most:
            state, more = self.run(STEPS, state, fit, advance)
            losses, runs = np.append(losses, more), runs + 1
            change = last_change(losses)
        advance((most - runs) * STEPS)
        return self.posterior_at(state, fit, _told(self.method, change, still, losses, ends))

    def posterior_at(self, state: Any, fit: Fit, told: Convergence) -> GuidePosterior:
        """Posterior in a state."""
        params, data = self.svi.get_params(state), fit.data

        def sampled(key: Any) -> dict[str, Any]:
            return self.drawn(key, params, data)

        if isinstance(self.guide, _AUTOMATIC):
            automatic: Any = self.guide
            centre = automatic.median(params)
            if self.method == "laplace" and _singular(automatic, params):
                told = told._replace(
                    converged=False,
                    sentence="The curvature at the most probable values is singular, so nothing can be drawn; try svi.",
                )
        else:
            many = [sampled(key_from(generator(fit.seed, Purpose.CENTRE, number))) for number in range(_CENTRED)]
            centre = _centre(fit, {name: np.stack([one[name] for one in many]) for name in fit.names})
        centre = {name: np.asarray(centre[name], dtype=np.float64) for name in fit.names}
        return GuidePosterior(centre, sampled, told)


def _singular(guide: AutoLaplaceApproximation, params: Any) -> bool:
    """Whether a normal approximation has no covariance; NumPyro puts zeros in its place then."""
    return not np.diagonal(jax.jit(lambda: guide.get_transform(params).scale_tril)()).all()


def largest_change(fit: Fit) -> float:
    """Change of the mean loss between two windows that counts as none, in nats per tap."""
    N, J, K = fit.samples.shape
    return max(_STILL, _IN_ALL / N, _PER_SAMPLE * J * K)


def last_change(losses: NDArray[np.float64]) -> float:
    """Change of the mean loss between the last two windows, in nats per tap."""
    return float(abs(losses[-_WINDOW:].mean() - losses[-2 * _WINDOW : -_WINDOW].mean()))


def _told(method: str, change: float, still: float, losses: NDArray[np.float64], starts: list[float]) -> Convergence:
    names = {"svi": "Variational inference", "map": "Most probable values", "laplace": "Laplace approximation"}
    best = f" from the best of {len(starts)} starts" if len(starts) > 1 else ""
    sentence = (
        f"{names[method]}, {len(losses)} steps{best}; the mean loss of the last "
        f"{_WINDOW} differs by {change:.2g} nats per tap from that of the {_WINDOW} before (at most {still:.2g})."
    )
    if not (finite := bool(np.isfinite(losses[-1]))):
        sentence += f" The last loss is not finite; {_OUTSIDE}."
    fine = finite and change <= still
    return Convergence(fine, sentence, {"loss": losses, "change": np.array(change)})


def _chains(fit: Fit) -> ChainPosterior:
    chains = sample_story(
        partial(fit.summed, jax.numpy.asarray(fit.samples)),
        lambda sites: {name: sites[name] for name in fit.names},
        fit.seed,
        fit.steps,
        fit.progress,
        fit.story.name,
    )
    flat = {name: values.reshape(-1, *values.shape[2:]) for name, values in chains.samples.items()}
    return ChainPosterior(_centre(fit, flat), chains)


def _centre(fit: Fit, draws: dict[str, NDArray[np.float64]]) -> Parameters:
    """Mean of draws (n, ...) in unconstrained space, constrained."""
    model = seed(fit.summed, 0)

    def loose(values: dict[str, Any]) -> Any:
        return unconstrain_fn(model, (fit.samples,), {}, values)

    mean = jax.tree.map(lambda values: values.mean(axis=0), jax.lax.map(loose, draws))
    found = constrain_fn(model, (fit.samples,), {}, mean)
    return {name: np.asarray(found[name], dtype=np.float64) for name in fit.names}


def check_prior(fit: Fit) -> str:
    """Looks at the prior predictive distribution and at the log density of the training taps at draws from the prior.

    Returns:
        A sentence where the prior is far from the taps, else nothing.

    Raises:
        InputError: The density of a tap is no number, or the distribution excludes a tap, whatever is drawn; or the
            model fails.
    """

    @compiled_once  # one program instead of one per operation
    def looked_at(number: Any, data: Any) -> tuple[Any, ...]:
        with seed(rng_seed=number):
            site = trace(fit.run).get_trace(*data)[OBSERVED]
            made = site["fn"].sample(numpyro.prng_key())
        return site["fn"].log_prob(site["value"]), made.mean(), made.std()

    outside, predicted = np.ones(len(fit.samples), dtype=bool), []
    with running(fit):
        data = fit.data
        for number in range(_TRIES):
            density, *moments = looked_at(jax.numpy.asarray(number), data)
            if (bad := _taps_where(np.isnan(np.asarray(density)))).any():
                raise InputError(
                    f"The log density of {fit.story.name} is not a number {_place(fit, bad)}; {_hint(fit)}."
                )
            outside &= _taps_where(np.isneginf(density))
            predicted.append(moments)
    if outside.any():
        raise InputError(f"{fit.story.name} excludes samples that occur, {_place(fit, outside)}; {_hint(fit)}.")
    return _far(fit, *np.array(predicted, dtype=np.float64).T)


def _far(fit: Fit, mean: NDArray[np.float64], sd: NDArray[np.float64]) -> str:
    """A sentence where samples drawn from the prior have quite another level or spread than the taps."""
    samples = fit.samples if fit.present is None else fit.samples[fit.present]
    level, spread = samples.mean(), samples.std()
    sd = np.where(np.isnan(sd), np.inf, sd)  # of samples too far apart for a number
    if not (sd.min() / _FAR <= spread <= _FAR * sd.max()):
        name, found, expected = "standard deviation", spread, sd
    elif np.nanmin(np.abs(level - mean)) > _FAR * max(sd.max(), spread):
        name, found, expected = "mean", level, mean
    else:
        return ""
    unit = "" if fit.story.raw else " in standardised units"
    least, most, actual = (f"{value:.2g}".replace("-", "−") for value in (expected.min(), expected.max(), found))
    return (
        f"The prior of {fit.story.name} is far from the taps: samples drawn from it have a {name} of {least} to {most} "
        f"in {len(expected)} draws, the taps one of {actual}{unit}."
    )


def _hint(fit: Fit) -> str:
    signs = "" if fit.story.raw else ", which are standardised and of both signs"
    return f"check its scales, and that its support holds the samples{signs}"


def _taps_where(wrong: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return wrong.reshape(len(wrong), -1).any(axis=1)


def _place(fit: Fit, bad: NDArray[np.bool_]) -> str:
    first = int(bad.argmax())
    return f"for a tap of position {fit.batch.where[first]} and object {fit.batch.what[first]}"
