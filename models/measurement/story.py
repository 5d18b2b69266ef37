"""Measurement models given by generative models in NumPyro, before and after a fit.

A file of a model holds a `Story`. The story itself is one function of 10 to 25 lines that says how the samples of taps
of known class come about, and nothing else. Plates carry the letters of the axes: `L` where classes, `M` what classes,
`J` samples of a tap, `K` taxels. The samples of the taps are its site `taps`.

Levels are intercepts of forecasts: a sample is `level` plus what the samples before it add to it. Samples are in units
of `Scaling`, in which the typical deviation of a taxel within a class is 1. Hyperparameters are given: the same prior
holds for all classes, and the fit in closed form estimates it from all of them, which is how classes with few taps
share strength.

References: Gelman et al., "Bayesian Data Analysis", 3rd ed., ch. 3 and 5 (conjugate and hierarchical normal models);
Pourahmadi, Biometrika 86 (1999) 677 (covariance as forecasts); Dawid, Biometrika 68 (1981) 265 (matrix normal);
Riutort-Mayol et al., Statistics and Computing 33 (2023) 17 (Gaussian processes on a basis).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..grid import ClassGrid
from ..progress import Progress, no_progress
from ..settings import FitSettings
from ..taps import TapSet
from .fits.closed_form import GROUP, packed, unpacked
from .fits.posterior import Posterior, Prior, SamplePosterior, Sites
from .fits.priors import Taps
from .fitted_parameters import ModelOfParameters, training
from .generic.contract import SIZES, StoryCall, StoryFunction
from .likelihood.any_form import Form
from .likelihood.forecasts import LeftOut, Unseen
from .likelihood.shapes import Measure, Parameters
from .likelihood.true_class import Own
from .missing import refuse_empty, refuse_missing
from .model import BINS, Fitted, Row
from .scaling import Moments, Scaling, least_deviation

if TYPE_CHECKING:
    from .generic.form import GenericForm
    from .generic.runs import Program

_NO_BASIS = np.zeros((0, 0, 0))


def _no_arguments(*_: Any) -> dict[str, Any]:
    return {}


@dataclass(frozen=True, eq=False, kw_only=True)
class Story:
    """A measurement model given by a generative model, with its fits and likelihood.

    Attributes:
        name: Name of the model.
        row: What it assumes less than the paper.
        story: In NumPyro, in the contract of `generic.contract`, with keyword arguments of its own; a story of curves
            over position takes `basis`, functions at each position, shape (L, D).
        dims: Dims of its parameters by name.
        positive: Names of the parameters that are above 0.
        exchangeable: Whether all samples of a taxel have one distribution, so that its form is a `TableForm`.
        check: Refuses taps that cannot carry it, given its name.
        closed: The posterior by its fast fit.
        form: From parameters to probabilities of bins.
        arguments: Those keyword arguments, from the training taps and the posterior of the fast fit.
        parameters: From sites of the story, with chain and draw in front, to parameters; default those of that name.
        sites: From parameters to sites of the story; default those of that name.
        trained_only: Whether chains must leave classes without a tap out, because their levels are flat.
        integrated: Log probability of taps integrated over the posterior of the fast fit, shape (N,); default the mean
            over draws.
        leave_out: Log probability of training taps given all others, shape (N,), exact given the prior; default none.
        basis: From that posterior, the training taps, the grid and their where classes to basis functions at Q places
            in each where class, shape (Q, L, D); for stories of curves over position.
        covered: From the trained classes to those that it can speak about, shape (L, M) both; default the trained ones.
        own_threads: Whether its posterior draws with threads of its own.
        independent: Whether the samples of a tap are independent and its fit leaves out those that are missing.
        kept: Type of the posterior of the fast fit if files keep it, see `fits.closed_form`.
    """

    name: str
    row: Row
    story: Callable[..., None]
    dims: Mapping[str, tuple[str, ...]]
    check: Callable[[str, Taps], None]
    closed: Callable[[Taps], Any]
    form: Callable[[Parameters, Measure], Form]
    positive: tuple[str, ...] = ()
    exchangeable: bool = False
    arguments: Callable[[Taps, Any], dict[str, Any]] = _no_arguments
    parameters: Callable[[Sites], Sites] | None = None
    sites: Callable[[Parameters], Parameters] | None = None
    trained_only: bool = False
    integrated: Callable[[Any, Measure, Unseen, np.random.Generator], NDArray[np.float64]] | None = None
    leave_out: Callable[[Any, Measure, Unseen], NDArray[np.float64]] | None = None
    basis: Callable[[Any, TapSet, ClassGrid, NDArray[np.intp]], NDArray[np.float64]] | None = None
    covered: Callable[[NDArray[np.bool_]], NDArray[np.bool_]] | None = None
    own_threads: bool = False
    independent: bool = False
    kept: type | None = None

    def fit(
        self,
        taps: TapSet,
        grid: ClassGrid,
        settings: FitSettings,
        trained_on: str = "",
        progress: Progress = no_progress,
    ) -> Fitted:
        """Model fitted to training taps.

        Raises:
            InputError: The taps cannot carry it, or an argument is out of range.
        """
        used, known, kept = training(taps, grid, settings, trained_on, in_blocks=True)
        self.check(self.name, known)
        if used.lacking.any():
            if not self.independent:
                refuse_missing(self.name, known.samples)
            elif self.trained_only:
                refuse_empty(self.name, Moments.of(known), "sample" in self.dims["level"])
        scaling = Scaling.of(known, kept["edges"])
        least = least_deviation(kept["edges"], len(scaling.unit)) / scaling.unit
        scaled = scaling.scaled(known)._replace(least=least)
        posterior, basis = self._posterior(scaled, used, grid, settings, progress)
        if self.covered is not None:
            kept["covered"] = self.covered(kept["covered"])
        left_out = grid.untouched(kept["covered"])
        model = ParametricModel(
            story=self, scaling=scaling, basis=basis, parameters=posterior.point(), left_out=left_out, **kept
        )
        return Fitted(model, posterior, posterior.convergence())

    def _posterior(
        self, scaled: Taps, used: TapSet, grid: ClassGrid, settings: FitSettings, progress: Progress
    ) -> tuple[Posterior, NDArray[np.float64]]:
        """Posterior and basis; for chains too, the basis is that of the fast fit."""
        posterior = self.closed(scaled)
        basis = _NO_BASIS if self.basis is None else self.basis(posterior, used, grid, scaled.where)
        if settings.method == "nuts":
            chains = self.sample(scaled, self.arguments(scaled, posterior), settings.seed, settings.steps, progress)
            posterior = chains._replace(given=self.arguments(scaled.first(), posterior))
        return posterior, basis

    def sample(
        self,
        taps: Taps,
        arguments: dict[str, Any],
        seed: int,
        steps: int | None = None,
        progress: Progress = no_progress,
    ) -> SamplePosterior:
        """Posterior by NUTS from scaled training taps, given the other arguments of the generative model."""
        from .fits import nuts

        shared = {name for name, dims in self.dims.items() if "where" not in dims}
        trained, over_grid = nuts.trained_only(taps, shared) if self.trained_only else (taps, lambda sites: sites)
        told = trained.under(self.story, **arguments)
        return nuts.sample_story(
            told, lambda sites: over_grid(self.parameters_of(sites)), seed, steps, progress, self.name
        )

    def prior(self, posterior: Any, shape: tuple[int, int, int, int]) -> Prior:
        """Prior of the parameters for taps of shape (L, M, J, K), given what the fit found that all classes share."""
        from .fits.prior import StoryPrior

        (L, M, J, K), none = shape, np.zeros(1, dtype=np.intp)
        one = Taps(np.zeros((1, J, K)), none, none, (L, M), np.zeros(1))
        given = posterior.given if isinstance(posterior, SamplePosterior) else self.arguments(one, posterior)

        def parameters(sites: Sites) -> Sites:
            found = self.parameters_of({name: values[None, None] for name, values in sites.items()})
            return {name: values[0, 0] for name, values in found.items()}

        told = one.under(self.story, **(given or {}))
        return StoryPrior(told, ("taps",), self.sites or (lambda drawn: drawn), parameters, {})

    def parameters_of(self, sites: Sites) -> Sites:
        """Parameters of all draws, from sites with leading axes chain and draw."""
        return {name: sites[name] for name in self.dims} if self.parameters is None else self.parameters(sites)

    def read(
        self,
        _: Mapping[str, Any],
        data: xr.Dataset,
        parameters: xr.Dataset,
        common: dict[str, Any],
    ) -> "ParametricModel":
        """Model from the groups of a file, see `MeasurementModel.read`."""
        closed_form = common["posterior"]
        common["posterior"] = None if self.kept is None or not closed_form else unpacked(self.kept, closed_form)
        model = ParametricModel(
            story=self,
            scaling=Scaling(data["centre"].values, data["unit"].values),
            basis=data["basis"].values if "basis" in data else _NO_BASIS,
            parameters={name: parameters[name].transpose(*dims).values for name, dims in self.dims.items()},
            covered=data["covered"].values.astype(bool),
            **common,
        )
        _check_parameters(model)
        if model.covered.shape != model.grid.shape or model.edges.shape[:-1] not in ((), (model.K,)):
            raise ValueError(f"covered classes have shape {model.covered.shape}, edges {model.edges.shape}.")
        return model


@dataclass(frozen=True, eq=False, repr=False)
class ParametricModel(ModelOfParameters):
    """A built-in generative model at fitted parameters.

    Attributes:
        story: Its story, and what is known of it.
        basis: Basis functions at Q places in each where class, shape (Q, L, D), or (0, 0, 0).
    """

    story: Story
    basis: NDArray[np.float64]

    @property
    def kind(self) -> str:
        """Name of the generative model."""
        return self.story.name

    @property
    def keeps_posterior(self) -> bool:
        """Whether the posterior is that of the fast fit, and in closed form."""
        return self.story.kept is not None and isinstance(self.posterior, self.story.kept)

    @property
    def frame(self) -> Measure:
        """Constants of the likelihood form besides parameters."""
        return Measure(self.scaling, self.edges, self.basis)

    @property
    def dims(self) -> dict[str, tuple[str, ...]]:
        """Dims of the parameters."""
        return dict(self.story.dims)

    def prior(self, posterior: Any) -> Prior:
        """Prior of its parameters, given what the fit found that all classes share."""
        return self.story.prior(posterior, (*self.grid.shape, *self.tap_shape))

    def groups(self) -> dict[str, xr.Dataset]:
        """Groups of the file, with basis functions and a posterior in closed form if there are any."""
        groups = super().groups()
        if self.keeps_posterior:
            groups[GROUP] = packed(self.posterior)
        if not self.basis.size:
            return groups
        own = {"basis": (("place", "where", "basis_function"), self.basis)}
        return groups | {"constant_data": groups["constant_data"].assign(own)}

    def by_story(self, parameters: Parameters) -> list["GenericForm"]:
        """Forms that run the story, one for each of the places in a class."""
        from .generic.form import GenericForm
        from .generic.runs import Given

        program = _program(self.story, (*self.grid.shape, *self.tap_shape))
        sites = dict(parameters if self.story.sites is None else self.story.sites(parameters))
        least = least_deviation(self.edges, self.K) / self.scaling.unit
        each: list[dict[str, Any]] = [{"basis": functions} for functions in self.basis] or [{}]
        return [GenericForm(program, (Given(sites, arguments, least),), self.scaling) for arguments in each]

    @cached_property
    def plain_form(self) -> Form:
        """Likelihood form of the parameters."""
        return self.form_of(self.parameters)

    def form_of(self, parameters: Parameters) -> Form:
        """Likelihood form of other parameters."""
        return self.story.form(parameters, self.frame)

    def integrated(
        self,
        posterior: Any,
        taps: NDArray[np.floating],
        own: Own,
        generator: np.random.Generator,
        gain: float,
        offset: float,
    ) -> NDArray[np.float64]:
        """Predictive log probability, by the model itself or averaged over draws."""
        if self.story.integrated is None or isinstance(posterior, SamplePosterior):
            return super().integrated(posterior, taps, own, generator, gain, offset)
        unseen = Unseen((taps - offset) / gain, (self.edges - offset) / gain, own)  # as in the state of gain 1
        return self.story.integrated(posterior, self.frame, unseen, generator)

    def leave_out(self, posterior: Any, taps: NDArray[np.floating], own: Own) -> LeftOut | None:
        """Left-out training taps, exact where cells are conjugate."""
        if self.story.leave_out is None or isinstance(posterior, SamplePosterior):
            return None
        return LeftOut(self.story.leave_out(posterior, self.frame, Unseen(taps, self.edges, own)))


@lru_cache
def _program(story: Story, shape: tuple[int, int, int, int]) -> "Program":
    """A story of taps of a shape, compiled once for all models that have it."""
    from .generic.runs import Program
    from .generic.structure import Structure

    structure = Structure(dict(story.dims), False, BINS, story.exchangeable, story.independent, (), {})
    none = np.zeros(0, dtype=np.intp)
    return Program(StoryFunction(story.story, story.name, SIZES), structure, StoryCall(none, none, shape))


def _check_parameters(model: ParametricModel) -> None:
    grid, (J, K), story = model.grid, model.tap_shape, model.story
    _check_array("centre", model.scaling.centre, (K,))
    _check_array("unit", model.scaling.unit, (K,))
    sizes = {"where": grid.L, "what": grid.M, "taxel": K, "from_taxel": K, "other_taxel": K, "sample": J}
    sizes |= {"other_sample": J, "once": 1, "basis": model.basis.shape[2]}
    for name, dims in story.dims.items():
        _check_array(name, model.parameters[name], tuple(sizes[dim] for dim in dims))
    if story.basis is not None:
        _check_array("basis", model.basis, (len(model.basis), grid.L, model.basis.shape[2]))
    positive = {"unit": model.scaling.unit} | {name: model.parameters[name] for name in story.positive}
    for name, values in positive.items():
        if not (values > 0).all():
            raise ValueError(f"{name} is not above 0 everywhere.")
    for name, dims in story.dims.items():
        if dims[-1] == f"other_{dims[-2:][0]}" and not _positive(model.parameters[name]):
            raise ValueError(f"{name} is not a covariance.")


def _positive(matrices: NDArray[np.float64]) -> bool:
    """Whether symmetric matrices (..., D, D) are positive definite."""
    try:
        for which in np.ndindex(matrices.shape[:-2]):
            np.linalg.cholesky(matrices[which])
    except np.linalg.LinAlgError:
        return False
    return True


def _check_array(name: str, values: NDArray[np.float64], shape: tuple[int, ...]) -> None:
    if values.shape != shape or not np.isfinite(values).all():
        raise ValueError(f"{name} is not finite or has shape {values.shape} instead of {shape}.")
