"""Posteriors by NUTS: any story as it stands, for data small enough, with the diagnostics that chains allow.

Hoffman and Gelman, JMLR 15 (2014) 1593. A fit in closed form is faster and exact or nearly so; this one is there for
`student` and the factorised fits, to see what their approximations cost.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
import xarray as xr
from numpy.typing import NDArray
from numpyro.infer import MCMC, NUTS

from ...seeds import Purpose, derived_seed
from ..likelihood.shapes import Parameters
from .convergence import Convergence
from .priors import Taps

type Sites = dict[str, NDArray[np.float64]]

CHAINS, WARM_UP, DRAWS = 4, 500, 250
R_HAT, ESS = 1.05, 100.0
"""A chain fit with a larger R-hat, or a smaller effective sample size, of any parameter did not converge."""
_SHARED = ("rho", "time_covariance")  # by all classes


class SamplePosterior(NamedTuple):
    """Draws of all parameters.

    Attributes:
        samples: By name, shapes (chain, draw, ...).
        stats: `r_hat` and `ess`, the worst of all parameters, and `divergences`, how many.
    """

    samples: Sites
    stats: dict[str, float]

    def point(self) -> Parameters:
        """Means."""
        return {name: values.mean(axis=(0, 1)) for name, values in self.samples.items()}

    def convergence(self) -> Convergence:
        """R-hat, effective sample size and divergences."""
        stats = self.stats
        fine = stats["r_hat"] <= R_HAT and stats["ess"] >= ESS and stats["divergences"] == 0
        sentence = (
            f"NUTS; worst R-hat {stats['r_hat']:.3f} (at most {R_HAT:g}), least effective sample size "
            f"{stats['ess']:.0f} (at least {ESS:g}), {stats['divergences']:.0f} divergences (none)."
        )
        return Convergence(fine, sentence, {name: np.array(value) for name, value in stats.items()})

    def draw(self, generator: np.random.Generator) -> Parameters:
        """One of the draws."""
        chains, draws = next(iter(self.samples.values())).shape[:2]
        chain, draw = generator.integers(chains), generator.integers(draws)
        return {name: values[chain, draw] for name, values in self.samples.items()}


def sample_story(
    story: Callable[..., None],
    arguments: tuple[Any, ...],
    convert: Callable[[Sites], Sites],
    seed: int = 0,
    *,
    chains: int = CHAINS,
    warm_up: int = WARM_UP,
    draws: int = DRAWS,
) -> SamplePosterior:
    """Draws from the posterior of a story.

    Args:
        story: Of `stories`.
        arguments: Taps and priors.
        convert: From the sites of the story, with chain and draw in front, to the parameters of its form.
        seed: Of the chains.
        chains: How many.
        warm_up: Draws of each that are thrown away.
        draws: Draws of each that are kept.
    """
    import arviz as az  # noqa: PLC0415

    with jax.enable_x64(True):
        sampler = MCMC(
            NUTS(story),
            num_warmup=warm_up,
            num_samples=draws,
            num_chains=chains,
            chain_method="vectorized",
            progress_bar=False,
        )
        sampler.run(jax.random.key(derived_seed(seed, Purpose.CHAINS)), *arguments)
        sites = {name: np.asarray(values) for name, values in sampler.get_samples(group_by_chain=True).items()}
        diverging = int(np.asarray(sampler.get_extra_fields()["diverging"]).sum())
    flat = az.from_dict({"posterior": {name: values for name, values in sites.items() if values.size}})
    posterior: Any = flat["posterior"].dataset
    stats = {"r_hat": _worst(az.rhat(posterior), np.nanmax), "ess": _worst(az.ess(posterior), np.nanmin)}
    return SamplePosterior(convert(sites), {**stats, "divergences": float(diverging)})


def _worst(diagnostic: xr.Dataset, pick: Callable[[NDArray[np.float64]], float]) -> float:
    return float(pick(np.array([pick(values.values) for values in diagnostic.data_vars.values()])))


def trained_only(taps: Taps) -> tuple[Taps, Callable[[Sites], Sites]]:
    """Taps with the classes that have any as the only ones, and what spreads their parameters over the grid again.

    A flat level of a class without a tap would run away. Such classes get the parameters of the first one.
    """
    L, M = taps.shape
    present, index = np.unique(taps.where * M + taps.what, return_inverse=True)
    source = np.zeros(L * M, dtype=np.intp)
    source[present] = np.arange(len(present))

    def over_grid(parameters: Sites) -> Sites:
        return {
            name: values
            if name in _SHARED
            else values[:, :, source, 0].reshape(*values.shape[:2], L, M, *values.shape[4:])
            for name, values in parameters.items()
        }

    return Taps(taps.samples, index, np.zeros_like(index), (len(present), 1)), over_grid


def plain_sites(sites: Sites) -> Sites:
    """For stories whose sites are the parameters."""
    return sites


def slope_sites(sites: Sites) -> Sites:
    """For `profile_mvn`: pairs of taxels as strictly lower triangular matrices."""
    K = sites["level"].shape[-1]
    slope = np.zeros((*sites["slope"].shape[:-1], K, K))
    slope[..., *np.tril_indices(K, -1)] = sites["slope"]
    return {**sites, "slope": slope}


def precision_sites(sites: Sites) -> Sites:
    """For `matrix_normal`: covariances from precisions, the one in time scaled to trace J."""
    time = np.linalg.inv(sites["time"])
    unit = np.trace(time, axis1=-2, axis2=-1) / time.shape[-1]
    taxel = np.linalg.inv(sites["taxel"])
    return {
        "level": sites["level"],
        "time_covariance": time / unit[..., None, None],
        "taxel_covariance": taxel * unit.reshape(*unit.shape, *([1] * (taxel.ndim - unit.ndim))),
    }


def curve_sites(sites: Sites) -> Sites:
    """For `smooth`: the basis as the last axis of the weights."""
    return {**sites, "weight": np.moveaxis(sites["weight"], 2, -1)}


def student_sites(sites: Sites) -> Sites:
    """For `student`: what its form needs."""
    return {name: sites[name] for name in ("freedom", "level", "scale")}
