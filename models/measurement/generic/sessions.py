"""Latent variables of a session that no training tap belongs to."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from math import prod
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
from numpy.typing import NDArray
from numpyro.handlers import seed, trace
from numpyro.primitives import Messenger

from ...seeds import Purpose, generator
from ..fits.posterior import Convergence, Posterior
from ..likelihood.shapes import Parameters
from .quantiles import at_quantiles
from .runs import Program, key_from, key_of, number_from
from .structure import OBSERVED

_TAILS = 2.0  # of a single variable: 128 points reach to 5 standard deviations of a normal prior
_OUTERMOST = 1e-4  # of points, whose quantiles should still be numbers below 1
_AT_ONCE = 128  # new sessions that one step draws


class _Known(Messenger):
    """Handler that gives latent variables their values, and those of the last session what the prior draws.

    Their prior is drawn at given quantiles, by name, where it can be.

    Attributes:
        even: Names of those that were drawn so.
    """

    def __init__(self, story: Any, latents: Parameters, axes: dict[str, int], quantiles: Parameters) -> None:
        self._latents, self._axes, self._quantiles = latents, axes, quantiles
        self.even: list[str] = []
        super().__init__(story)

    def process_message(self, msg: dict[str, Any]) -> None:
        if msg["type"] != "sample" or msg["name"] not in self._latents:
            return
        name = msg["name"]
        values = jnp.asarray(self._latents[name])
        if name in self._axes:
            axis = self._axes[name]
            drawn = at_quantiles(msg["fn"], self._quantiles[name]) if name in self._quantiles else None
            self.even += [name] if drawn is not None else []
            if drawn is None:
                drawn = msg["fn"](rng_key=msg["kwargs"]["rng_key"], sample_shape=())
            values = jnp.concatenate([values, jax.lax.slice_in_dim(drawn, -1, None, axis=axis)], axis=axis)
        msg["value"] = values


class InNewSessions(NamedTuple):
    """Posterior whose draws have one session more than the training taps, drawn for each.

    Attributes:
        inner: That of the training sessions.
        program: The model.
    """

    inner: Posterior
    program: Program

    def point(self) -> Parameters:
        """Latent variables of the training sessions."""
        return self.inner.point()

    def convergence(self) -> Convergence:
        """Convergence of the fit."""
        return self.inner.convergence()

    @property
    def sizes(self) -> tuple[int, int] | None:
        """Numbers of chains and of draws of each, if it has chains."""
        return getattr(self.inner, "sizes", None)

    def at(self, chain: int, draw: int, generator: np.random.Generator) -> Parameters:
        """One draw of a chain, with a new session."""
        inner: Any = self.inner
        return with_new_session(self.program, inner.at(chain, draw, generator), generator)

    def draw(self, generator: np.random.Generator) -> Parameters:
        """Latent variables from the posterior, with a new session."""
        return with_new_session(self.program, self.inner.draw(generator), generator)

    def together(self, generators: Sequence[np.random.Generator]) -> Iterator[Parameters]:
        """Draws, one for each generator, whose new sessions are spread evenly."""
        each = [self.inner.draw(own) for own in generators]
        points, _ = session_points(self.program, each[0], len(each), generators[0])
        return in_new_sessions(self.program, each, generators, points)

    def with_tails(self, generators: Sequence[np.random.Generator]) -> tuple[Iterator[Parameters], NDArray[np.float64]]:
        """Draws, one for each generator, whose new sessions reach far out, and the logs of their weights."""
        each = [self.inner.draw(own) for own in generators]
        points, log_weight = session_points(self.program, each[0], len(each), generators[0], tails=True)
        return in_new_sessions(self.program, each, generators, points), log_weight


def in_new_sessions(
    program: Program,
    latents: Sequence[Parameters],
    generators: Sequence[np.random.Generator],
    points: Sequence[Parameters],
) -> Iterator[dict[str, NDArray[np.float64]]]:
    """Latent variables with one session more each, at points of `session_points`.

    Args:
        program: The model.
        latents: Its latent variables, by name, D times.
        generators: Random generators, D of them, of what has no quantiles.
        points: D of them.
    """
    numbers, step = [number_from(own) for own in generators], min(len(generators), _AT_ONCE)
    for first in range(0, len(numbers), step):
        some = range(first, min(first + step, len(numbers)))
        padded = np.resize(some, step).tolist()  # a last block of another size would be compiled anew
        known, at = _stacked([latents[d] for d in padded]), _stacked([points[d] for d in padded])
        with jax.enable_x64(True):
            made = _with_new_sessions(program, known, np.array([numbers[d] for d in padded]), at)
        found = {name: np.asarray(values, dtype=np.float64) for name, values in made.items()}
        for row in range(len(some)):
            yield {name: values[row] for name, values in found.items()}


def _stacked(each: Sequence[Parameters]) -> dict[str, NDArray[np.float64]]:
    return {name: np.stack([np.asarray(one[name], dtype=np.float64) for one in each]) for name in each[0]}


@partial(jax.jit, static_argnums=0)
def _with_new_sessions(program: Program, latents: Any, number: jax.Array, quantiles: Any) -> dict[str, jax.Array]:
    """As `_with_new_session`, for each along the first axes and with keys made of numbers."""

    def each(own: Any) -> dict[str, jax.Array]:
        known, number, point = own
        return _with_new_session(program, known, key_of(number), point)

    return jax.lax.map(each, (latents, number, quantiles))


def session_points(
    program: Program, latents: Parameters, draws: int, scrambler: np.random.Generator, tails: bool = False
) -> tuple[list[dict[str, NDArray[np.float64]]], NDArray[np.float64]]:
    """Quantiles at which new sessions are drawn so that they stand together for their prior, and the logs of weights.

    They are the points of a scrambled Sobol sequence, which fill the prior more evenly than independent draws; of
    variables without quantiles (see `quantiles`) there are none. With `tails` they are spread by a beta distribution on
    its side, so that the outermost lie far out: a session that is rare is then near some of them, too, and weights make
    up for the number of these.

    Args:
        program: The model.
        latents: Its latent variables, by name, for their shapes.
        draws: Number of points D.
        scrambler: Random generator that scrambles the sequence.
        tails: See above; otherwise all weights are equal.

    Returns:
        Quantiles by name, D times, and log weights, shape (D,).
    """
    from scipy.special import betainc, betaln, xlogy
    from scipy.stats import qmc

    even = _even(program, tuple((name, np.shape(values)) for name, values in latents.items()))
    ends = np.cumsum([0, *(prod(shape) for _, shape in even)])
    number = int(ends[-1])
    if not 0 < number <= qmc.Sobol.MAXDIM:
        return [{} for _ in range(draws)], np.zeros(draws)
    point = qmc.Sobol(number, rng=scrambler).random_base2((draws - 1).bit_length())[:draws]
    log_weight = np.zeros(draws)
    if tails:
        point = np.clip(point, _OUTERMOST, 1 - _OUTERMOST)
        b = 1 + _TAILS / number
        log_weight = (xlogy(b - 1, point * (1 - point)) - betaln(b, b)).sum(axis=1)
        point = betainc(b, b, point)
    parts = list(zip(even, ends[:-1], ends[1:], strict=True))
    return [{name: row[i:j].reshape(shape) for (name, shape), i, j in parts} for row in point], log_weight


@lru_cache(maxsize=64)
def _even(program: Program, shapes: tuple[tuple[str, tuple[int, ...]], ...]) -> list[tuple[str, tuple[int, ...]]]:
    """Latent variables of a new session that are made of uniform numbers, with the shape of these."""
    axes, half = program.structure.by_session, {}
    for name, shape in shapes:
        if name in axes:
            half[name] = np.full((*shape[: axes[name]], 1, *shape[axes[name] + 1 :]), 0.5)
    names: list[str] = []
    key = key_from(generator(0, Purpose.NEW_SESSION))

    def run(latents: Any) -> Any:
        known = _story_in_new_session(program, latents, key, half)
        values = trace(known).get_trace()[OBSERVED]["value"]
        names.extend(known.even)
        return values

    with jax.enable_x64(True):
        jax.eval_shape(run, {name: np.zeros(shape) for name, shape in shapes})
    return [(name, half[name].shape) for name in names]


def with_new_session(
    program: Program, latents: Parameters, generator: np.random.Generator, quantiles: Parameters | None = None
) -> dict[str, NDArray[np.float64]]:
    """Latent variables with one session more, drawn from its prior given the others.

    Args:
        program: The model.
        latents: Its latent variables, by name.
        generator: Random generator of the draw.
        quantiles: At which those of the new session are drawn instead, by name, with one session each.
    """
    known = {name: np.asarray(values, dtype=np.float64) for name, values in latents.items()}
    with jax.enable_x64(True):
        found = _with_new_session(program, known, key_from(generator), quantiles or {})
    return {name: np.asarray(values, dtype=np.float64) for name, values in found.items()}


@partial(jax.jit, static_argnums=0)
def _with_new_session(program: Program, latents: Any, key: jax.Array, quantiles: Any) -> dict[str, jax.Array]:
    with numpyro.validation_enabled(False):
        sites = trace(_story_in_new_session(program, latents, key, quantiles)).get_trace()
    return {name: sites[name]["value"] for name in latents}


def _story_in_new_session(program: Program, latents: Any, key: Any, quantiles: Any) -> _Known:
    axes = program.structure.by_session
    S = latents[next(iter(axes))].shape[next(iter(axes.values()))]
    zeros, (_, _, J, K) = np.zeros(S + 1, dtype=np.intp), program.batch.shape
    batch = replace(program.batch, where=zeros, what=zeros, session=np.arange(S + 1))
    story = seed(lambda: program.story(batch, jnp.zeros((S + 1, J, K))), key)
    return _Known(story, latents, axes, quantiles)
