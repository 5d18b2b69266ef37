"""Priors of fitted models: draws of the parameters, and log densities of drawn ones.

A prior that a fit has estimated from all classes, such as that of the variances, counts as given.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax
import numpy as np
import numpyro
from numpyro.handlers import seed, substitute, trace

from ..generic.runs import key_from
from ..generic.structure import is_improper
from ..likelihood.shapes import Parameters
from .posterior import ByClass

_CLASSES = {"L": "where", "M": "what"}


@dataclass(frozen=True, eq=False)
class StoryPrior:
    """Prior of the latent variables of a generative model.

    Attributes:
        story: The model of a tap or a few.
        others: Names of its sites that are no parameters.
        sites: From parameters to latent variables.
        parameters: From latent variables to parameters.
        new_session: Axis of sessions of the latent variables that have one; the last session trained nothing.
    """

    story: Callable[[], Any]
    others: tuple[str, ...]
    sites: Callable[[Parameters], Mapping[str, Any]]
    parameters: Callable[[dict[str, Any]], Mapping[str, Any]]
    new_session: Mapping[str, int]

    def draw(self, generator: np.random.Generator) -> Parameters:
        """A draw of the parameters."""
        with jax.enable_x64(True), numpyro.validation_enabled(False):
            drawn = self._drawn(key_from(generator))
            sites = {name: np.asarray(values) for name, values in drawn.items()}
        return {name: values for name, values in self.parameters(sites).items() if name not in self._flat}

    def log_density(self, parameters: Parameters) -> ByClass:
        """Log density of the latent variables of a draw."""
        with jax.enable_x64(True), numpyro.validation_enabled(False):
            densities = self._densities({name: np.asarray(v) for name, v in self.sites(parameters).items()})
        return {name: (self._dims[name], np.asarray(values)) for name, values in densities.items()}

    @cached_property
    def _flat(self) -> set[str]:
        """Names of the latent variables of which the prior is flat."""
        with jax.enable_x64(True), numpyro.validation_enabled(False):
            sites: dict[str, Any] = {}
            jax.eval_shape(lambda: sites.update(self._traced(0, {})))
        return {name for name, site in sites.items() if is_improper(site["fn"])}

    @cached_property
    def _drawn(self) -> Callable[[Any], dict[str, Any]]:
        return jax.jit(lambda key: {name: site["value"] for name, site in self._traced(key, {}).items()})

    @cached_property
    def _dims(self) -> dict[str, tuple[str, ...]]:
        return {}  # known once the densities are traced

    @cached_property
    def _densities(self) -> Callable[[Mapping[str, Any]], dict[str, Any]]:
        def of(sites: Mapping[str, Any]) -> dict[str, Any]:
            return {name: self._by_class(name, site) for name, site in self._traced(0, sites).items()}

        return jax.jit(of)

    def _traced(self, key: Any, known: Mapping[str, Any]) -> dict[str, Any]:
        """Sites of the latent variables, at known values or drawn from the prior."""

        def value(site: dict[str, Any]) -> Any:
            name = site["name"]
            if site["type"] != "sample" or name in self.others:
                return None
            if not known and is_improper(site["fn"]):
                return jax.numpy.zeros(site["fn"].shape())
            return known.get(name)

        sites = trace(seed(substitute(self.story, substitute_fn=value), key)).get_trace()
        return {n: site for n, site in sites.items() if site["type"] == "sample" and n not in self.others}

    def _by_class(self, name: str, site: dict[str, Any]) -> Any:
        """Log density of a latent variable, summed over all axes but those of classes."""
        density = site["fn"].log_prob(site["value"])
        if name in self.new_session and self.new_session[name] < density.ndim:
            density = jax.lax.slice_in_dim(density, 0, -1, axis=self.new_session[name])
        frames = site["cond_indep_stack"]
        axes = {density.ndim + frame.dim: _CLASSES[frame.name] for frame in frames if frame.name in _CLASSES}
        self._dims[name] = tuple(axes[axis] for axis in sorted(axes))
        return density.sum(tuple(axis for axis in range(density.ndim) if axis not in axes))
