"""`smooth`: `profile` with mean curves over position as Gaussian processes in a sine basis.

The kernel is squared exponential; on an interval it is well approximated by sines whose weights are independent with
variances from its spectral density (Solin and Sarkka, Statistics and Computing 30 (2020) 419). Weights and variances
have a factorised posterior found by coordinate ascent; the length scale is the one of a grid with the largest lower
bound of the evidence, and the amplitude of each taxel maximises that bound.
"""

from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from ..grid import ClassGrid
from ..taps import TapSet
from ..threads import cores, in_order
from .fits.cells import CELL, estimated_prior
from .fits.normal_equations import expect
from .fits.posterior import Convergence, Sites, ascent, check_places
from .fits.priors import CellPrior, Taps
from .likelihood.forecasts import Unseen, log_t_probability
from .likelihood.forms import GaussianForm
from .likelihood.shapes import NO_TAXEL, Measure, Parameters, chain_form
from .model import Row
from .scaling import class_sums, sum_by
from .story import Story

LENGTHS = tuple(np.geomspace(0.11, 1.6, 8))
"""Candidate length scales, in units of half the range of positions."""
_MOST = 24  # basis functions; enough for the shortest length scale
_BORDER = 1.5  # half width of the interval of the sines, in the same unit
_ROUNDS, _STILL = 300, 1e-3  # rounds at most, and the relative change at which they end
_SETTLING = 5  # rounds that estimate the prior
_FEW_ROUNDS = 12  # enough to choose a length scale by
_TIMES = 10  # of a tap, enough to choose a length scale by
_SUB_PLACES = 4  # in a class whose taps lie at different places, over which the likelihood is averaged


class CurvePrior(NamedTuple):
    """Gaussian process over position in a basis of D functions.

    Attributes:
        width: Prior standard deviation of the weights, broadcast over (D, K).
        a: Shape of the inverse gamma distribution of the variances, broadcast over (K,).
        b: Its rate, broadcast over (K,).
    """

    width: Any
    a: Any
    b: Any


def story(
    where: Any,
    what: Any,
    taps: Any = None,
    *,
    L: int,
    M: int,
    J: int,
    K: int,
    where_value: Any = None,
    basis: Any = None,
    place: Any = None,
    prior: CurvePrior | None = None,
) -> None:
    """Generative model: `profile` with mean curves that are smooth in the position of the tap.

    The curve is a Gaussian process with squared exponential kernel on a basis of sines, so the classes of an object
    share their taps, and positions between them have a mean too.

    The basis functions are `basis`, shape (P, D), of which a tap has row `place`, by default that of its position;
    without them they are sines at the positions `where_value`. Without a `prior` it is a weak one.
    """
    from .fits.story_parts import dist, jnp, numpyro, plates

    basis = Basis.of(where_value).at(where_value) if basis is None else basis
    D = basis.shape[1]
    prior = prior or weak_prior(D)
    with plates(("D", D, -4), ("M", M, -3), ("J", J, -2), ("K", K, -1)):
        weight: Any = numpyro.sample("weight", dist.Normal(0.0, jnp.asarray(prior.width)[:, None, None]))
    with plates(("L", L, -4), ("M", M, -3), ("J", J, -2), ("K", K, -1)):
        variance: Any = numpyro.sample("variance", dist.InverseGamma(prior.a, prior.b))
    functions = jnp.asarray(basis)[where if place is None else place]
    curve = jnp.einsum("nd,dnjk->njk", functions, weight[:, what])
    with plates(("tap", len(where), -3), ("time", J, -2), ("taxel", K, -1)):
        deviation = jnp.sqrt(variance[where, what])
        numpyro.sample("taps", dist.Normal(curve, deviation), obs=taps)


class Basis(NamedTuple):
    """Sine basis over position.

    Attributes:
        centre: Middle of the positions.
        half: Half of their range.
        size: How many, D.
    """

    centre: float
    half: float
    size: int

    @classmethod
    def of(cls, place: NDArray[np.float64]) -> Self:
        """Basis for the positions of training taps."""
        distinct = np.unique(place)
        half = 0.5 * float(distinct[-1] - distinct[0])
        return cls(float(distinct[0]) + half, half, min(_MOST, 2 * len(distinct) + 4))

    def at(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        """Basis functions at positions (...), shape (..., D)."""
        x = (np.asarray(place)[..., None] - self.centre) / self.half
        return np.sin(self.frequency * (x + _BORDER)) / np.sqrt(_BORDER)

    @property
    def frequency(self) -> NDArray[np.float64]:
        """Angular frequencies, shape (D,)."""
        return np.arange(1.0, self.size + 1.0) * (np.pi / (2 * _BORDER))

    def density(self, length: float) -> NDArray[np.float64]:
        """Variances of the weights for amplitude 1, shape (D,)."""
        return np.sqrt(2 * np.pi) * length * np.exp(-0.5 * (length * self.frequency) ** 2) + 1e-12


def weak_prior(D: int) -> CurvePrior:
    """Weak prior of curves as smooth as half the range of positions, within ten standard deviations of the mean."""
    return CurvePrior(10.0 * np.sqrt(Basis(0.0, 1.0, D).density(0.5))[:, None], 2.0, 2.0)


class CurvePosterior(NamedTuple):
    """Factorised posterior of weights and variances.

    Attributes:
        basis: The functions.
        weight: Expected weights, shape (M, J, K, D).
        root: Cholesky factors of their covariances, shape (M, J, K, D, D).
        a: Shape of the variances, shape (L, M, 1, 1).
        b: Their rate, shape (L, M, J, K).
        prior: Prior of the variances.
        width: Prior standard deviation of the weights, shape (D, K).
        length: Length scale in units of the positions.
        rounds: How many rounds it took.
        change: Largest relative change of an expected variance in the last one.
    """

    basis: Basis
    weight: NDArray[np.float64]
    root: NDArray[np.float64]
    a: NDArray[np.float64]
    b: NDArray[np.float64]
    prior: CellPrior
    width: NDArray[np.float64]
    length: float
    rounds: int
    change: float

    def point(self) -> dict[str, NDArray[np.float64]]:
        """Expected weights and variances."""
        return {"weight": self.weight, "variance": self.b / np.maximum(self.a - 1, 0.5 * self.a)}

    def convergence(self) -> Convergence:
        """Convergence of the coordinate ascent."""
        return ascent(self.rounds, self.change, _STILL)

    def draw(self, generator: np.random.Generator) -> dict[str, NDArray[np.float64]]:
        """Parameters from the posterior."""
        noise = generator.standard_normal(self.weight.shape)
        weight = self.weight + (self.root @ noise[..., None])[..., 0]
        return {"weight": weight, "variance": self.b / generator.standard_gamma(np.broadcast_to(self.a, self.b.shape))}


class _Sums(NamedTuple):
    """Sufficient statistics; taps (L, M), Gram matrices (M, L, D, D), products (M, L, D, J, K), squares."""

    taps: NDArray[np.float64]
    gram: NDArray[np.float64]
    product: NDArray[np.float64]
    square: NDArray[np.float64]

    def at_times(self, times: slice) -> Self:
        """Statistics at some of the times."""
        return self._replace(product=self.product[..., times, :], square=self.square[..., times, :])


def fit(taps: Taps) -> CurvePosterior:
    """Factorised posterior of `story`, from taps at three or more positions."""
    basis = Basis.of(taps.place)
    sums = _sums(taps, basis.at(taps.place))
    few = sums.at_times(slice(None, None, -(-taps.samples.shape[1] // _TIMES)))
    start = _start(few)
    bounds = [*in_order((lambda n=n: _ascend(few, start, basis, n, _FEW_ROUNDS)[0] for n in LENGTHS), cores(None))]
    return _ascend(sums, _start(sums), basis, LENGTHS[int(np.argmax(bounds))], _ROUNDS)[1]


def _sums(taps: Taps, basis: NDArray[np.float64]) -> _Sums:
    (L, M), (_, J, K), D = taps.shape, taps.samples.shape, basis.shape[1]
    own = taps.what * L + taps.where
    gram = sum_by(own, basis[:, :, None] * basis[:, None, :], M * L)
    product = np.zeros((M * L, D, J * K))
    for which, block in taps.over_blocks(lambda block, which: (which, block)):
        for c in np.unique(own[which]):
            members = own[which] == c
            product[c] += basis[which][members].T @ block[members].reshape(-1, J * K)
    square = class_sums(taps, lambda block, _: block**2)
    count = np.bincount(own, minlength=M * L).astype(np.float64)
    return _Sums(count.reshape(M, L).T, gram.reshape(M, L, D, D), product.reshape(M, L, D, J, K), square)


class _Curves:
    """Posterior of the weights of curves.

    Attributes:
        weight: Expected weights, shape (M, D, J, K).
        second: Their expected squares, shape (M, D, J, K).
        root: Upper triangular factors of their covariances, shape (M, D, D, J, K).
    """

    def __init__(self, sums: _Sums) -> None:
        M, _, D, J, K = sums.product.shape
        self._sums, self._n = sums, J * K
        self._product = np.ascontiguousarray(sums.product).reshape(M, -1, D, J * K)
        self._square = np.ascontiguousarray(sums.square).reshape(-1, M, J * K)
        self.weight, self.second = np.empty((2, M, D, J, K))
        self.root = np.zeros((M, D, D, J, K))

    def update(self, precision: NDArray[np.float64], variance: NDArray[np.float64]) -> NDArray[np.float64]:
        """Expected sums of squared residuals, after an update given noise precisions (L, M, J, K) and (D, K)."""
        rest, n = np.empty_like(precision), self._n
        tight = np.tile(1 / variance, n // variance.shape[1])
        found = (each.reshape(*each.shape[:-2], n) for each in (self.weight, self.second, self.root, rest))
        expect(precision.reshape(self._square.shape), self._sums.gram, self._product, self._square, tight, *found)
        return rest


type _Variances = tuple[CellPrior, NDArray[np.float64], NDArray[np.float64]]
"""Their prior, and shape and rate of their posterior."""


def _start(sums: _Sums) -> _Variances:
    """Variances to begin with: a tenth of the mean squares."""
    taps, used = sums.taps[..., None, None], np.maximum(sums.taps, 1)[..., None, None]
    return _variances(taps, np.where(taps > 0, sums.square / used, 1.0) * 0.1 * taps, None)


def _variances(taps: NDArray[np.float64], square: NDArray[np.float64], prior: CellPrior | None) -> _Variances:
    """Variances from expected squares, by default with the prior that is estimated from them."""
    prior = estimated_prior(taps, square) if prior is None else prior
    return prior, prior.a + 0.5 * taps, prior.b + 0.5 * square


def _ascend(sums: _Sums, start: _Variances, basis: Basis, length: float, most: int) -> tuple[float, CurvePosterior]:
    """Lower bound of the log evidence, and the posterior at one length scale, after at most `most` rounds."""
    taps, density, amplitude = sums.taps[..., None, None], basis.density(length), np.ones(sums.square.shape[-1])
    prior, a, b = start
    rounds, change = 0, np.inf
    curves = _Curves(sums)
    while change > _STILL and rounds < most:
        before = a / b
        square = curves.update(before, amplitude**2 * density[:, None])
        amplitude = np.sqrt((curves.second / density[:, None, None]).mean(axis=(0, 1, 2)))
        # The prior settles soon, and the bound is that of one prior.
        prior, a, b = _variances(taps, square, None if rounds < _SETTLING else prior)
        change, rounds = float(np.abs(a / b / before - 1).max()), rounds + 1
    variance = amplitude**2 * density[:, None]
    bound = _bound(sums, curves, variance, prior, a, b)
    weight = np.ascontiguousarray(np.moveaxis(curves.weight, 1, -1))
    root = np.ascontiguousarray(np.moveaxis(curves.root, (1, 2), (-2, -1)))
    width = np.sqrt(variance)
    return bound, CurvePosterior(basis, weight, root, a, b, prior, width, length * basis.half, rounds, change)


def _bound(
    sums: _Sums,
    curves: _Curves,
    variance: NDArray[np.float64],
    prior: CellPrior,
    a: NDArray[np.float64],
    b: NDArray[np.float64],
) -> float:
    """Lower bound of the log evidence up to a constant."""
    noise = prior.a * np.log(prior.b) - gammaln(prior.a) + gammaln(a) - a * np.log(b)
    noise = np.where(sums.taps[..., None, None] > 0, noise, 0.0)
    log_root = np.log(np.diagonal(curves.root, axis1=1, axis2=2)).sum()
    shrunk = (
        0.5 * (curves.second / variance[:, None]).sum() + 0.5 * np.log(variance).sum() * curves.weight[:, 0, :, 0].size
    )
    return float(noise.sum() + log_root - shrunk)


def arguments(taps: Taps, posterior: CurvePosterior) -> dict[str, Any]:
    """Arguments of `story`: the Gaussian process of the fit, at the positions of the taps."""
    prior = CurvePrior(posterior.width, posterior.prior.a, posterior.prior.b)
    return {"basis": posterior.basis.at(taps.place), "place": np.arange(len(taps.place)), "prior": prior}


def parameters_of(sites: Sites) -> Sites:
    """Parameters from draws, with the basis as the last axis of the weights."""
    return {**sites, "weight": np.moveaxis(sites["weight"], 2, -1)}


def sites_of(parameters: Parameters) -> Parameters:
    """Sites of `story`, with the basis as the first axis of the weights."""
    return {**parameters, "weight": np.moveaxis(parameters["weight"], -1, 0)}


def form(parameters: Parameters, frame: Measure) -> GaussianForm:
    """Likelihood of bins under `story`: a mixture over Q equally probable positions in a class."""
    J = parameters["weight"].shape[1]
    mean = np.einsum("qld,mjkd->qlmjk", frame.basis, parameters["weight"], optimize=True)
    return chain_form(mean, parameters["variance"], np.eye(J)[None], NO_TAXEL, frame)


def integrated(
    posterior: CurvePosterior, frame: Measure, unseen: Unseen, _: np.random.Generator
) -> NDArray[np.float64]:
    """Student's t predictions with the uncertainty of the curve at each position added to the variance."""
    parts = []
    curves = form(posterior.point(), frame)
    noise = posterior.b / posterior.a
    for q, basis in enumerate(frame.basis):
        spread = np.einsum("ld,mjkdx->lmjkx", basis, posterior.root, optimize=True)
        scale = np.sqrt(noise + (spread**2).sum(axis=-1)) * frame.scaling.unit
        at = curves._replace(scale=np.broadcast_to(scale, curves.mean.shape))
        parts.append(curves.log_weight[q] + log_t_probability(at, q, 2 * posterior.a, unseen))
    return np.logaddexp.reduce(parts, axis=0)


def basis_in_classes(
    posterior: CurvePosterior, taps: TapSet, grid: ClassGrid, where: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Basis functions at the positions of taps in each class, one or several; shape (Q, L, D)."""
    several = any(len(np.unique(taps.where[where == l])) > 1 for l in np.unique(where))
    if grid.where_edges is None or not several:
        return posterior.basis.at(grid.where_value[None])
    share = (np.arange(_SUB_PLACES) + 0.5) / _SUB_PLACES
    return posterior.basis.at(grid.where_edges[:-1] + share[:, None] * np.diff(grid.where_edges))


def between(trained: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mask of classes between trained ones of the same object, shape (L, M)."""
    before = np.maximum.accumulate(trained, axis=0)
    behind = np.maximum.accumulate(trained[::-1], axis=0)[::-1]
    return before & behind


MODEL = Story(
    name="smooth",
    row=Row("independence of neighbouring positions", "profile with means as smooth curves over position"),
    story=story,
    dims={"weight": ("what", "sample", "taxel", "basis"), "variance": CELL},
    positive=("variance",),
    check=check_places,
    closed=fit,
    form=form,
    arguments=arguments,
    parameters=parameters_of,
    sites=sites_of,
    integrated=integrated,
    basis=basis_in_classes,
    covered=between,
    kept=CurvePosterior,
)
