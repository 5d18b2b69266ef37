"""Building blocks of generative models; imported only when one runs, as JAX and NumPyro take seconds to load."""

from typing import Any

import jax.numpy as jnp
import numpyro
import numpyro.distributions as dist

from .priors import CellPrior


def cells(prior: CellPrior) -> tuple[Any, Any]:
    """Level and variance of every cell of the surrounding plates."""
    variance: Any = numpyro.sample("variance", dist.InverseGamma(prior.a, prior.b))
    flat = dist.ImproperUniform(dist.constraints.real, (), ())
    known = dist.Normal(prior.level, jnp.sqrt(variance / (prior.strength or 1.0)))
    return numpyro.sample("level", known if prior.strength else flat), variance


class plates:  # noqa: N801 - used like numpyro.plate
    """Nested NumPyro plates from names, sizes and dims."""

    def __init__(self, *plates: tuple[str, int, int]) -> None:
        self._plates = [numpyro.plate(name, size, dim=dim) for name, size, dim in plates]

    def __enter__(self) -> None:
        for plate in self._plates:
            plate.__enter__()

    def __exit__(self, *error: Any) -> None:
        for plate in reversed(self._plates):
            plate.__exit__(*error)
