"""Posteriors by NUTS, for any generative model on small data, with convergence diagnostics.

Hoffman and Gelman, JMLR 15 (2014) 1593. A fit in closed form is faster and exact or nearly so; this one is there for
stories that have none and, beside fits that approximate, shows what that costs.
"""

from collections.abc import Callable, Container
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
import xarray as xr
from numpy.typing import NDArray
from numpyro.infer import NUTS

from ...progress import Progress, no_progress
from ...seeds import Purpose, derived_seed
from .posterior import SamplePosterior, Sites
from .priors import Taps

CHAINS, STEPS = 4, 750
"""Chains, and steps of each, of which two thirds adapt the sampler and are thrown away."""


def sample_story(
    story: Callable[..., Any],
    convert: Callable[[Sites], Sites],
    seed: int = 0,
    steps: int | None = None,
    progress: Progress = no_progress,
    name: str = "NUTS",
) -> SamplePosterior:
    """Posterior draws of a generative model.

    Args:
        story: Generative model of known taps.
        convert: From the sites of the story, with chain and draw in front, to the parameters of its form.
        seed: Random seed of the chains.
        steps: Steps of each chain; default `STEPS`.
        progress: Called with the name of a stage and its number of steps; returns the function that advances it.
        name: Name of the model.
    """
    return Chains.of(story).posterior((), convert, seed, steps, progress, name)


class Chains(NamedTuple):
    """Chains of a generative model as compiled programs, for all its arguments of the same shapes.

    Attributes:
        begin: From keys of the chains, their steps of adaptation and arguments to the state of all chains.
        forward: From the state of all chains and arguments to the next state.
        finish: From unconstrained draws and arguments to sites.
    """

    begin: Callable[[Any, int, Any], Any]
    forward: Callable[[Any, Any], Any]
    finish: Callable[[Any, Any], Sites]

    @classmethod
    def of(cls, story: Callable[..., Any]) -> "Chains":
        """Chains of a generative model."""
        kernel = NUTS(story)

        def begin(keys: Any, warm_up: int, given: Any) -> Any:
            return kernel.init(keys, warm_up, None, given, {})

        def finish(free: Any, given: Any) -> Any:
            return jax.lax.map(partial(jax.lax.map, kernel.postprocess_fn(given, {})), free)

        # Not compiled at the beginning, as NumPyro would not notice there that no value is possible.
        return cls(begin, jax.jit(lambda state, given: kernel.sample(state, given, {})), jax.jit(finish))

    def posterior(
        self,
        given: tuple[Any, ...],
        convert: Callable[[Sites], Sites],
        seed: int = 0,
        steps: int | None = None,
        progress: Progress = no_progress,
        name: str = "NUTS",
    ) -> SamplePosterior:
        """Posterior draws at arguments of the generative model; for the others see `sample_story`."""
        import arviz as az

        steps = STEPS if steps is None else steps
        warm_up, advance = 2 * steps // 3, progress(f"{name}, steps of chains", steps)
        with jax.enable_x64(True):
            keys = jax.random.split(jax.random.key(derived_seed(seed, Purpose.CHAINS)), CHAINS)
            state = self.begin(keys, warm_up, given)
            kept = []
            for number in range(steps):  # step by step, as no signal is handled while a compiled program runs
                state = self.forward(state, given)
                seen = jax.tree.map(np.asarray, (state.z, state.diverging))
                if number >= warm_up:
                    kept.append(seen)
                advance(1)
            free, diverged = jax.tree.map(lambda *each: np.stack(each, axis=1), *kept)
            sites = {name: np.asarray(values) for name, values in self.finish(free, given).items()}
        flat = az.from_dict({"posterior": {name: values for name, values in sites.items() if values.size}})
        posterior: Any = flat["posterior"].dataset
        stats = {"r_hat": _worst(az.rhat(posterior), np.nanmax), "ess": _worst(az.ess(posterior), np.nanmin)}
        return SamplePosterior(convert(sites), {**stats, "divergences": float(diverged.sum())})


def _worst(diagnostic: xr.Dataset, pick: Callable[[NDArray[np.float64]], float]) -> float:
    return float(pick(np.array([pick(values.values) for values in diagnostic.data_vars.values()])))


def trained_only(taps: Taps, shared: Container[str] = ()) -> tuple[Taps, Callable[[Sites], Sites]]:
    """Taps relabelled to the trained classes only, and a function that maps parameters back to the grid.

    A flat level of a class without a tap would run away. Such classes get the parameters of the first one.

    Args:
        taps: Training taps.
        shared: Names of the parameters that all classes share.
    """
    L, M = taps.shape
    present, index = np.unique(taps.where * M + taps.what, return_inverse=True)
    source = np.zeros(L * M, dtype=np.intp)
    source[present] = np.arange(len(present))

    def over_grid(parameters: Sites) -> Sites:
        return {
            name: values
            if name in shared or values.ndim < 4
            else values[:, :, source, 0].reshape(*values.shape[:2], L, M, *values.shape[4:])
            for name, values in parameters.items()
        }

    return taps._replace(where=index, what=np.zeros_like(index), shape=(len(present), 1)), over_grid
