"""All measurement models by name: what each assumes less than the paper, and how it is fitted.

A name is one of `CATALOGUE`, or `session:` and one of them; `session` alone holds the histogram.
"""

from dataclasses import replace
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..digest import tap_digests
from ..errors import InputError
from ..grid import ClassGrid
from ..power import likelihood_exponent
from ..settings import FitSettings
from ..taps import TapSet
from ..threads import one_blas_thread
from .fits.cells import fit_gaussian, fit_profile, fit_profile_ar, fit_profile_mvn
from .fits.checks import check_cells, check_places, check_taxels, check_times
from .fits.convergence import EXACT, Convergence, NotConvergedError
from .fits.curves import fit_smooth
from .fits.kronecker import fit_matrix_normal
from .fits.priors import CurvePrior, Taps
from .histogram import HistogramModel, untouched
from .histogram import fit as fit_histogram
from .likelihood.bins import bin_edges
from .model import TapModel
from .parametric import ParametricModel
from .posterior import HistogramPosterior, Posterior
from .scaling import Scaling, least_deviation, training_taps
from .shared_gain import session_spread, state_grid

SUB_PLACES = 4
"""Places in a class whose taps lie at different ones, over which `smooth` takes the mean."""


class Fitted(NamedTuple):
    """A fit.

    Attributes:
        model: What decides.
        posterior: Of its parameters; `None` where the prior is improper, a histogram without pseudocount.
        convergence: How it was found.
    """

    model: TapModel
    posterior: Posterior | None
    convergence: Convergence


class Row(NamedTuple):
    """A model of the catalogue.

    Attributes:
        relaxes: Which assumption of the paper it does without.
        how: What it says instead.
    """

    relaxes: str
    how: str


def fit_model(name: str, taps: TapSet, grid: ClassGrid, settings: FitSettings, trained_on: str = "") -> Fitted:
    """Fits a model of the catalogue.

    Args:
        name: Of the model.
        taps: Training taps.
        grid: The classes.
        settings: How.
        trained_on: Which taps these are, in words.

    Raises:
        InputError: There is no such model, the taps cannot carry it, or an argument is out of range.
        NotConvergedError: The fit did not converge, and this was not allowed.
    """
    kind, in_states = split_name(name)
    settings = _checked(settings, taps)
    if kind == "histogram":
        fitted = _fit_histogram(taps, grid, settings, trained_on)
    else:
        with one_blas_thread():
            fitted = _fit_story(kind, taps, grid, settings, trained_on)
    if not (fitted.convergence.converged or settings.unconverged):
        raise NotConvergedError(f"{name} did not converge: {fitted.convergence.sentence} --allow-unconverged uses it.")
    if not in_states:
        return fitted
    gain_sd, offset_sd = session_spread(taps, grid, fitted.model.edges)
    states = state_grid(
        gain_sd if settings.gain_sd is None else settings.gain_sd,
        offset_sd if settings.offset_sd is None else settings.offset_sd,
    )
    spread = f"States: {len(states.gain)}, gains {states.gain.min():.3g} to {states.gain.max():.3g}"
    spread += f" and offsets {states.offset.min():.2g} to {states.offset.max():.2g}."
    convergence = fitted.convergence._replace(sentence=f"{fitted.convergence.sentence} {spread}")
    return fitted._replace(model=_in_states(fitted.model, states), convergence=convergence)


def _checked(settings: FitSettings, taps: TapSet) -> FitSettings:
    """The settings, the number of bins taken from edges where these are given."""
    if settings.edges is None:
        return settings
    edges, K = np.asarray(settings.edges, dtype=np.float64), taps.dataset.sizes["taxel"]
    if edges.shape[:-1] not in {(), (K,)} or edges.ndim == 0 or edges.shape[-1] < 2:
        raise InputError(f"Edges of B bins have shape (B + 1,) or ({K}, B + 1), got {edges.shape}.")
    if not (np.isfinite(edges).all() and (np.diff(edges) > 0).all()):
        raise InputError("Edges of bins must be finite and increase.")
    return settings.changed(edges=edges, bins=edges.shape[-1] - 1)


def split_name(name: str) -> tuple[str, bool]:
    """The kind of model in a name, and whether it is wrapped in states.

    Raises:
        InputError: There is no such model.
    """
    kind, in_states = name, name == "session" or name.startswith("session:")
    if in_states:
        kind = name.partition(":")[2] if ":" in name else "histogram"
    if kind not in CATALOGUE or kind == "session":
        raise InputError(
            f"There is no model {name!r}; there are {', '.join(CATALOGUE)}, and session: before any other."
        )
    return kind, in_states


def _in_states(model: TapModel, states: Any) -> TapModel:
    if isinstance(model, HistogramModel | ParametricModel):
        return replace(model, states=states)
    raise TypeError(f"A model of type {type(model).__name__} has no states.")


def _fit_histogram(taps: TapSet, grid: ClassGrid, settings: FitSettings, trained_on: str) -> Fitted:
    model = fit_histogram(
        taps,
        grid,
        bins=settings.bins,
        pseudocount=settings.pseudocount,
        power=settings.power,
        saturation=settings.limit,
        value_range=settings.value_range,
        edges=settings.edges,
        trained_on=trained_on,
    )
    posterior = HistogramPosterior.of(model) if settings.pseudocount > 0 else None
    return Fitted(model, posterior, EXACT)


def _fit_story(kind: str, taps: TapSet, grid: ClassGrid, settings: FitSettings, trained_on: str) -> Fitted:
    where, what = taps.indices(grid)
    inside = (where >= 0) & (what >= 0)
    if not inside.any():
        raise InputError("No training tap belongs to a class of the grid.")
    used = taps if inside.all() else taps.select(inside)
    known = training_taps(used, grid.shape, where[inside], what[inside])
    likelihood_exponent(settings.power, *known.samples.shape[1:])
    if settings.bins < 1:
        raise InputError(f"Probabilities of bins need at least one bin, got bins={settings.bins}.")
    _check(kind, known, used.where)
    edges = bin_edges(used.taps, settings.bins, settings.value_range) if settings.edges is None else settings.edges
    scaling = Scaling.of(known, edges)
    scaled = scaling.scaled(known)
    least = least_deviation(edges, len(scaling.unit)) / scaling.unit
    posterior = _fit(kind, scaled, used.where, least)
    basis = _basis(posterior, used, grid, where[inside]) if kind == "smooth" else np.zeros((0, 0, 0))
    if settings.method == "nuts":
        posterior = _sample(kind, scaled, used.where, least, posterior, settings.seed)
    touched = np.zeros(grid.shape, dtype=bool)
    touched[known.where, known.what] = True
    covered = _between(touched) if kind == "smooth" else touched
    model = ParametricModel(
        story=kind,
        grid=grid,
        edges=edges,
        scaling=scaling,
        basis=basis,
        parameters=posterior.point(),
        covered=covered,
        power=settings.power,
        preprocessing=taps.preprocessing,
        left_out=untouched(grid, covered),
        trained_on=trained_on,
        version=version("solidtouch"),
        training=tap_digests(used.taps),
        saturation=settings.limit,
    )
    return Fitted(model, posterior, posterior.convergence())


def _between(touched: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Classes between trained ones of the same object, shape (L, M)."""
    before = np.maximum.accumulate(touched, axis=0)
    behind = np.maximum.accumulate(touched[::-1], axis=0)[::-1]
    return before & behind


def _basis(posterior: Any, taps: TapSet, grid: ClassGrid, where: NDArray[np.intp]) -> NDArray[np.float64]:
    """Basis functions at one place in each class, or at several where its taps lie at several; shape (Q, L, D)."""
    several = any(len(np.unique(taps.where[where == l])) > 1 for l in np.unique(where))
    if grid.where_edges is None or not several:
        return posterior.basis.at(grid.where_value[None])
    share = (np.arange(SUB_PLACES) + 0.5) / SUB_PLACES
    return posterior.basis.at(grid.where_edges[:-1] + share[:, None] * np.diff(grid.where_edges))


def _check(kind: str, taps: Taps, place: NDArray[np.float64]) -> None:
    """Refuses taps that cannot carry a model."""
    match kind:
        case "gaussian" | "student":
            check_cells(kind, taps)
        case "profile" | "profile-ar" | "matrix-normal":
            check_times(kind, taps)
        case "profile-mvn":
            check_taxels(kind, taps)
        case _:
            check_places(kind, taps, place)


def _fit(kind: str, taps: Taps, place: NDArray[np.float64], least: NDArray[np.float64]) -> Any:
    """The posterior of a story by its fast fit."""
    fits = {
        "gaussian": fit_gaussian,
        "profile": fit_profile,
        "profile-ar": fit_profile_ar,
        "profile-mvn": fit_profile_mvn,
        "matrix-normal": fit_matrix_normal,
    }
    if kind == "student":
        from .fits.student import fit_student  # noqa: PLC0415 - JAX and NumPyro take seconds to import

        return fit_student(taps, least)
    return fits[kind](taps) if kind in fits else fit_smooth(taps, place)


def _sample(
    kind: str, taps: Taps, place: NDArray[np.float64], least: NDArray[np.float64], posterior: Any, seed: int
) -> Posterior:
    """The posterior of a story by NUTS, under the prior that the fast fit estimated."""
    from . import stories  # noqa: PLC0415
    from .fits import nuts as fit_nuts  # noqa: PLC0415

    if kind == "student":
        return fit_nuts.sample_story(stories.student, (taps, least), fit_nuts.student_sites, seed)
    prior = posterior.prior
    if kind == "smooth":
        curves = CurvePrior(posterior.basis.at(place), posterior.width, prior.a, prior.b)
        return fit_nuts.sample_story(stories.smooth, (taps, curves), fit_nuts.curve_sites, seed)
    trained, over_grid = fit_nuts.trained_only(taps)
    pairs = np.tril_indices(taps.samples.shape[2], -1)
    story, arguments, sites = {
        "gaussian": (stories.gaussian, (), fit_nuts.plain_sites),
        "profile": (stories.profile, (), fit_nuts.plain_sites),
        "profile-ar": (stories.profile_ar, (), fit_nuts.plain_sites),
        "profile-mvn": (
            stories.profile_mvn,
            (posterior.typical[pairs], posterior.tightness) if kind == "profile-mvn" else (),
            fit_nuts.slope_sites,
        ),
        "matrix-normal": (stories.matrix_normal, (), fit_nuts.precision_sites),
    }[kind]
    return fit_nuts.sample_story(story, (trained, prior, *arguments), lambda drawn: over_grid(sites(drawn)), seed)


CATALOGUE = {
    "histogram": Row("nothing", "one histogram per class and taxel, as in the paper"),
    "gaussian": Row("bins", "a normal distribution per class and taxel"),
    "student": Row("bins", "Student's t per class and taxel, for heavier tails"),
    "profile": Row("exchangeable samples", "a mean and a variance for each time of a tap"),
    "profile-ar": Row("independence in time", "profile, each sample forecast from the one before"),
    "profile-mvn": Row("independence of taxels", "profile, each sample forecast from other taxels at its time"),
    "matrix-normal": Row("independence in time and of taxels", "one covariance in time times one across taxels"),
    "smooth": Row("independence of neighbouring positions", "profile, its means smooth curves over position"),
    "session": Row("independence of taps", "any other under a gain and offset that all taps of an episode share"),
}
"""All models by name, the paper's first."""
