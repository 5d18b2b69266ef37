"""Posterior and prior of a model's parameters: interfaces, convergence, and a posterior given by Markov chains."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..likelihood.shapes import Parameters
from .priors import Taps


class Convergence(NamedTuple):
    """Convergence of a fit.

    Attributes:
        converged: Whether it may be used; always where the posterior is exact.
        sentence: How it was found, and what shows that it did or did not converge.
        stats: Numbers behind it, by name.
        warning: What else a user should know of the fit.
    """

    converged: bool
    sentence: str
    stats: dict[str, NDArray[np.float64]]
    warning: str = ""


EXACT = Convergence(True, "The posterior is exact.", {})
EXACT_CELLS = Convergence(True, "The posterior is exact, given the prior of the variances that all classes share.", {})
EXACT_COVARIANCES = Convergence(
    True, "The posterior is exact, given the prior of the covariances that all classes share.", {}
)


def ascent(rounds: int, change: float, still: float) -> Convergence:
    """Convergence of coordinate ascent on a factorised posterior.

    Args:
        rounds: How many it took.
        change: Change by the last round.
        still: The change that counts as none.
    """
    sentence = (
        f"Factorised posterior by coordinate ascent, {rounds} rounds; the last changed it by {change:.2g} "
        f"(at most {still:g})."
    )
    return Convergence(change <= still, sentence, {"rounds": np.array(float(rounds)), "change": np.array(change)})


class Posterior(Protocol):
    """Distribution of a model's parameters given the training taps."""

    def point(self) -> Parameters:
        """Point estimate of each parameter, used for decisions."""
        ...

    def draw(self, generator: np.random.Generator) -> Parameters:
        """A draw of the parameters, and of what its density in the generative model depends on besides."""
        ...

    def convergence(self) -> Convergence:
        """Convergence of the fit."""
        ...


def several(posterior: Posterior, generators: Sequence[np.random.Generator]) -> Iterator[Parameters]:
    """Draws of the parameters, one for each generator; spread evenly together where the posterior knows how."""
    together: Any = getattr(posterior, "together", None)
    return together(generators) if together else (posterior.draw(generator) for generator in generators)


type ByClass = dict[str, tuple[tuple[str, ...], NDArray[np.float64]]]
"""Log densities by name, each with its dims: `where` and `what` where classes have one each, else none."""


class Prior(Protocol):
    """Distribution of a model's parameters before the training taps."""

    def draw(self, generator: np.random.Generator) -> Parameters:
        """A draw of the parameters; without those of which the prior is flat."""
        ...

    def log_density(self, parameters: Parameters) -> ByClass:
        """Log density of a draw from the posterior, 0 where the prior is flat."""
        ...


type Sites = dict[str, NDArray[np.float64]]

R_HAT, ESS = 1.05, 100.0
"""Limits of convergence: largest R-hat and smallest effective sample size of any parameter."""


class SamplePosterior(NamedTuple):
    """Posterior given by draws of all parameters.

    Attributes:
        samples: By name, shapes (chain, draw, ...).
        stats: `r_hat` and `ess`, the worst of all parameters, and `divergences`, how many.
        given: Keyword arguments of the generative model for one tap, if it takes any.
    """

    samples: Sites
    stats: dict[str, float]
    given: Mapping[str, Any] | None = None

    def point(self) -> Parameters:
        """Posterior means."""
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

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of chains and of draws of each."""
        chains, draws = next(iter(self.samples.values())).shape[:2]
        return chains, draws

    def at(self, chain: int, draw: int, _: np.random.Generator) -> Parameters:
        """One draw of a chain."""
        return {name: values[chain, draw] for name, values in self.samples.items()}

    def draw(self, generator: np.random.Generator) -> Parameters:
        """One of the draws."""
        chains, draws = self.sizes
        return self.at(int(generator.integers(chains)), int(generator.integers(draws)), generator)


FEWEST_PLACES = 3
MOST_COVARIANCES = 1 << 26  # numbers in the covariances of all classes: 0.5 GiB, of which a fit takes several
MOST_SLOPES = 10**10  # classes times taxels to the fourth power: about ten minutes of a core


def check_cells(name: str, taps: Taps) -> None:
    """Checks the taps of a model without times: samples of a class must vary.

    Raises:
        InputError: There is one sample per tap, and on average less than two taps per class.
    """
    if taps.samples.shape[1] == 1:
        _check_repeats(f"{name} with one sample per tap", taps)


def check_times(name: str, taps: Taps) -> None:
    """Checks the taps of a model with a profile in time.

    Raises:
        InputError: There is one sample per tap, or on average less than two taps per class.
    """
    if taps.samples.shape[1] == 1:
        raise InputError(f"{name} needs more than one sample per tap; use gaussian or matrix-normal for one.")
    _check_repeats(name, taps)


def check_covariances(name: str, taps: Taps) -> None:
    """Checks the taps of a model with a covariance across taxels for each class.

    Raises:
        InputError: There are on average less than two taps per class, or the covariances of taps of one sample would
            take too much memory.
    """
    _check_repeats(name, taps)
    (L, M), (_, J, K) = taps.shape, taps.samples.shape
    if J == 1 and L * M * K**2 > MOST_COVARIANCES:
        most = int((MOST_COVARIANCES / (L * M)) ** 0.5)
        raise InputError(
            f"{name} with one sample per tap holds the covariance of all taxels for each class; for {L * M} classes it "
            f"takes at most {most} taxels, got {K}: use gaussian, or fewer features."
        )


def check_taxels(name: str, taps: Taps) -> None:
    """Checks the taps of a model with correlated taxels.

    Raises:
        InputError: There is one taxel, or more than can be told from the others in minutes, or on average less than two
            taps per class.
    """
    (L, M), K = taps.shape, taps.samples.shape[2]
    if K == 1:
        raise InputError(f"{name} needs more than one taxel.")
    if L * M * K**4 > MOST_SLOPES:
        most = int((MOST_SLOPES / (L * M)) ** 0.25)
        raise InputError(
            f"{name} predicts each taxel from those before it, for each class; for {L * M} classes it takes at most "
            f"{most} taxels, got {K}: use matrix-normal, or fewer taxels."
        )
    _check_repeats(name, taps)


def check_places(name: str, taps: Taps) -> None:
    """Checks the taps of a model of curves over position.

    Raises:
        InputError: There are less than three positions, or on average less than two taps per class.
    """
    places = len(np.unique(taps.place))
    if places < FEWEST_PLACES:
        raise InputError(f"{name} needs at least {FEWEST_PLACES} positions, got {places}.")
    _check_repeats(name, taps)


def _check_repeats(name: str, taps: Taps) -> None:
    _, M = taps.shape
    classes = len(np.unique(taps.where * M + taps.what))
    if len(taps.where) < 2 * classes:
        raise InputError(f"{name} needs at least two taps per class, got {len(taps.where)} taps for {classes} classes.")
