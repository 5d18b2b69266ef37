"""Data and models of the reference posteriors: stories of this software, their priors, and moments in closed form.

All models but `session` are given the same few taps and their own default prior, so nothing is estimated beforehand.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from numpyro import handlers
from numpyro.infer.reparam import LocScaleReparam, TransformReparam
from scipy.special import logsumexp, ndtr, polygamma, psi  # pyright: ignore[reportAttributeAccessIssue]
from solidtouch.models.measurement import (
    gaussian,
    histogram,
    matrix_normal,
    profile,
    profile_ar,
    profile_mvn,
    smooth,
    student,
)
from solidtouch.models.measurement.fits.cells import WEAK_CELLS, Cells
from solidtouch.models.measurement.fits.posterior import Posterior
from solidtouch.models.measurement.fits.priors import Taps
from solidtouch.models.measurement.likelihood.bins import find_bins
from solidtouch.models.measurement.shared_gain import state_grid
from solidtouch.models.seeds import Purpose, generator

L, M, J, K, REPEATS = 3, 2, 2, 2, 8
"""Sizes: where classes, what classes, samples, taxels, and taps of each class."""
EDGES = np.array([-3.0, -0.5, 0.5, 3.0])
"""Of the bins of `histogram`."""
SEED = 24

type Moments = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Means and variances of an array of numbers."""


class Target(NamedTuple):
    """One reference posterior.

    Attributes:
        name: Of the model.
        story: Its story with the data, in NumPyro; none where all unknowns are discrete.
        data: What a program needs besides the taps, by name.
        scales: On what scale each parameter is compared, by name; see `analysis.posteriors.quantities`.
        moments: Mean and variance of each parameter on that scale, where they have a closed form.
        exact: Posterior from which independent draws are made, where there is one.
        sampled: The story in other variables, in which chains move more easily; default the story itself.
    """

    name: str
    story: Callable[[], None] | None
    data: dict[str, Any]
    scales: Mapping[str, str]
    moments: dict[str, Moments] | None = None
    exact: Posterior | None = None
    sampled: Callable[[], Any] | None = None


def taps() -> Taps:
    """The taps that all models but `session` are given: curves over position, correlated noise, two outliers."""
    rng = generator(SEED, Purpose.STUDY, 0)
    where, what = (index.ravel() for index in np.indices((L, M, REPEATS))[:2])
    noise = rng.normal(size=(len(where), J, K))
    noise[:, 1] += 0.6 * noise[:, 0]
    noise[:, :, 1] += 0.5 * noise[:, :, 0]
    levels = np.array([0.8, -0.4])[what] * np.sin(where + 0.5)
    samples = 0.6 * noise + levels[:, None, None] + 0.3 * np.arange(J)[:, None]
    samples[[5, 40]] *= 3
    return Taps(samples.round(3), where, what, (L, M), where.astype(float))


def targets() -> list[Target]:
    """All reference posteriors, in the order of the models."""
    known = taps()
    cells = {"prior": WEAK_CELLS._asdict()}
    slopes = profile_ar.fit(known, WEAK_CELLS)
    basis = smooth.Basis.of(known.place).at(np.arange(float(L)))
    curves = smooth.weak_prior(basis.shape[1])
    kronecker = matrix_normal.weak_prior(J, K)._replace(strength=0.01)
    return [
        _histogram(known),
        _cells("gaussian", known, gaussian.story, gaussian.fit(known, WEAK_CELLS).cells, cells),
        _student(known),
        _cells("profile", known, profile.story, profile.fit(known, WEAK_CELLS).cells, cells),
        Target("profile-ar", known.under(profile_ar.story), cells, {"rho": "", **_CELLS}, _mixture(slopes), slopes),
        Target("profile-mvn", known.under(profile_mvn.story), cells | {"tightness": 4.0}, {"slope": "", **_CELLS}),
        Target(
            "matrix-normal",
            known.under(matrix_normal.story),
            {"prior": kronecker._asdict()},
            {"time": "precision", "taxel": "precision", "level": ""},
        ),
        Target(
            "smooth",
            known.under(smooth.story, basis=basis),
            {"basis": basis, "width": curves.width[:, 0], "prior": {"a": curves.a, "b": curves.b}},
            {"weight": "", "variance": "log"},
        ),
        _session(),
    ]


_CELLS = {"level": "", "variance": "log"}
_STUDENT = {
    "freedom": "log", "spread": "log", "typical": "", "variety": "log", "level": "", "scale": "log",
}  # fmt: skip


def _cells(name: str, known: Taps, story: Callable[..., None], cells: Cells, data: dict[str, Any]) -> Target:
    """A model whose cells are conjugate."""
    return Target(name, known.under(story), data, _CELLS, _of_cells(cells), cells)  # pyright: ignore[reportArgumentType]


def _of_cells(cells: Cells) -> dict[str, Moments]:
    """Moments of levels and log variances under normal-inverse-gamma distributions."""
    return {
        "level": (cells.level, cells.b / (cells.strength * (cells.a - 1))),
        "variance": (np.log(cells.b) - psi(cells.a), polygamma(1, cells.a)),
    }


def _mixture(posterior: profile_ar.ArPosterior) -> dict[str, Moments]:
    """Moments under a posterior on a grid of slopes, by the laws of total expectation and variance."""
    each = [_of_cells(posterior.cells(rho)) for rho in posterior.rho.T]
    weight = posterior.weight.T  # of each slope and taxel
    found = {}
    for name in _CELLS:
        mean, variance = (np.stack([moments[name][i] for moments in each]) for i in range(2))
        share = weight[:, None, None, None]
        whole = (share * mean).sum(axis=0)
        found[name] = whole, (share * (variance + (mean - whole) ** 2)).sum(axis=0)
    mean = (weight * posterior.rho.T).sum(axis=0)
    return {"rho": (mean, (weight * (posterior.rho.T - mean) ** 2).sum(axis=0)), **found}


def _student(known: Taps) -> Target:
    """Scales are sampled apart from what is typical of them, as that may vary by next to nothing."""
    story = known.under(student.story)
    logs = handlers.reparam(story, config={"scale": TransformReparam()})
    apart = handlers.reparam(logs, config={"scale_base": LocScaleReparam(0.0)})
    return Target("student", story, {}, _STUDENT, sampled=apart)


class _Dirichlets(NamedTuple):
    """Posterior of histograms, under the name that they have in the story."""

    posterior: histogram.HistogramPosterior

    def draw(self, generator: np.random.Generator) -> dict[str, NDArray[np.float64]]:
        """A draw."""
        return {"p": np.exp(self.posterior.draw(generator)["log_prob"])}


def _histogram(known: Taps) -> Target:
    bins, B = find_bins(known.samples, EDGES), len(EDGES) - 1
    counts = np.zeros((L, M, K, B), dtype=np.int64)
    np.add.at(counts, (known.where[:, None, None], known.what[:, None, None], np.arange(K), bins), 1)
    posterior = histogram.HistogramPosterior(counts, 1.0)
    alpha = posterior.concentration
    whole = alpha.sum(axis=-1, keepdims=True)
    moments = {"p": (psi(alpha) - psi(whole), polygamma(1, alpha) - polygamma(1, whole))}
    story, data = known.under(histogram.story, edges=EDGES), {"edges": EDGES, "pseudocount": 1.0}
    exact: Any = _Dirichlets(posterior)
    return Target("histogram", story, data, {"p": "log"}, moments, exact)


# The session model -------------------------------------------------------------------------------------------------

SESSION_TAPS = 3
"""Taps of the unknown class and session."""


class SessionBelief(NamedTuple):
    """Belief in place, object and state of the session.

    Attributes:
        probability: Shape (L, M, S).
    """

    probability: NDArray[np.float64]

    def draw(self, generator: np.random.Generator) -> dict[str, NDArray[np.float64]]:
        """A place, object and state, counted from 1."""
        drawn = generator.choice(self.probability.size, p=self.probability.ravel())
        index = np.unravel_index(drawn, self.probability.shape)
        return {name: np.float64(i + 1) for name, i in zip(("where", "what", "state"), index, strict=True)}  # pyright: ignore[reportReturnType]


def session_data() -> dict[str, Any]:
    """Levels and deviations of `profile`, the grid of states, bins, and taps of one class in an unknown session."""
    rng = generator(SEED, Purpose.STUDY, 1)
    level = np.round(rng.normal(0.0, 0.5, size=(L, M, J, K)), 2)
    deviation = np.round(rng.uniform(0.5, 0.9, size=(L, M, J, K)), 2)
    states = state_grid(0.2, 0.3)
    gain, offset = states.gain[9], states.offset[9]
    drawn = level[1, 0] + deviation[1, 0] * rng.normal(size=(SESSION_TAPS, J, K))
    return {
        "taps": (offset + gain * drawn).round(2),
        "level": level,
        "deviation": deviation,
        "gain": states.gain,
        "offset": states.offset,
        "log_prior": states.log_prior,
        "edges": np.linspace(-3.0, 3.0, 41),
    }


def session_probability(data: Mapping[str, Any]) -> NDArray[np.float64]:
    """Posterior of place, object and state, shape (L, M, S): the sum of log probabilities of bins, in 64 bits."""
    bins = find_bins(data["taps"], data["edges"])
    lower, upper = np.r_[-np.inf, data["edges"][1:-1]][bins], np.r_[data["edges"][1:-1], np.inf][bins]
    log_belief = np.empty((L, M, len(data["gain"])))
    for s, (gain, offset) in enumerate(zip(data["gain"], data["offset"], strict=True)):
        for l, m in np.ndindex(L, M):
            z = [((edge - offset) / gain - data["level"][l, m]) / data["deviation"][l, m] for edge in (lower, upper)]
            log_belief[l, m, s] = data["log_prior"][s] + np.log(ndtr(z[1]) - ndtr(z[0])).sum()
    return np.exp(log_belief - logsumexp(log_belief))


def _session() -> Target:
    data = session_data()
    belief: Any = SessionBelief(session_probability(data))
    names = ("where", "what", "state")
    marginals = [belief.probability.sum(axis=tuple({0, 1, 2} - {axis})) for axis in range(3)]
    moments = {name: (p, p * (1 - p)) for name, p in zip(names, marginals, strict=True)}
    return Target("session", None, data, dict.fromkeys(names, "classes"), moments, belief)
