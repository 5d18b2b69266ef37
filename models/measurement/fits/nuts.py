"""Posteriors by NUTS, for any generative model on small data, with convergence diagnostics.

Hoffman and Gelman, JMLR 15 (2014) 1593. A fit in closed form is faster and exact or nearly so; this one is there for
stories that have none and, beside fits that approximate, shows what that costs.
"""

from collections.abc import Callable, Container
from typing import Any

import jax
import numpy as np
import xarray as xr
from numpy.typing import NDArray
from numpyro.infer import MCMC, NUTS

from ...seeds import Purpose, derived_seed
from .posterior import SamplePosterior, Sites
from .priors import Taps

CHAINS, WARM_UP, DRAWS = 4, 500, 250


def sample_story(
    story: Callable[[], None],
    convert: Callable[[Sites], Sites],
    seed: int = 0,
    *,
    chains: int = CHAINS,
    warm_up: int = WARM_UP,
    draws: int = DRAWS,
) -> SamplePosterior:
    """Posterior draws of a generative model.

    Args:
        story: Generative model of known taps.
        convert: From the sites of the story, with chain and draw in front, to the parameters of its form.
        seed: Random seed of the chains.
        chains: How many.
        warm_up: Draws of each that are thrown away.
        draws: Draws of each that are kept.
    """
    import arviz as az

    with jax.enable_x64(True):
        sampler = MCMC(
            NUTS(story),
            num_warmup=warm_up,
            num_samples=draws,
            num_chains=chains,
            chain_method="vectorized",
            progress_bar=False,
        )
        sampler.run(jax.random.key(derived_seed(seed, Purpose.CHAINS)))
        sites = {name: np.asarray(values) for name, values in sampler.get_samples(group_by_chain=True).items()}
        diverging = int(np.asarray(sampler.get_extra_fields()["diverging"]).sum())
    flat = az.from_dict({"posterior": {name: values for name, values in sites.items() if values.size}})
    posterior: Any = flat["posterior"].dataset
    stats = {"r_hat": _worst(az.rhat(posterior), np.nanmax), "ess": _worst(az.ess(posterior), np.nanmin)}
    return SamplePosterior(convert(sites), {**stats, "divergences": float(diverging)})


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
