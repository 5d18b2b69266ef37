"""A generative model run by NumPyro at given latent variables: log probabilities of bins, and draws."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
from numpy.typing import NDArray
from numpyro.handlers import block, seed, substitute, trace
from numpyro.infer.util import log_density

from ...errors import InputError
from ..fits.present import peeled
from ..scaling import Scaling
from .contract import StoryCall, StoryFunction
from .observed import BINS, Binned, Censored, InBin
from .structure import OBSERVED, Structure

_ROUNDING = 1e-6  # log probabilities of whole taps may be above 0 by this


@dataclass(frozen=True, eq=False)
class Program:
    """A generative model with what does not depend on its latent variables; one object, one compiled program.

    Attributes:
        story: The model.
        structure: Its sites.
        batch: Its arguments, with no tap.
        sessions: Number of training sessions, which is the index of the session at perception.
    """

    story: StoryFunction
    structure: Structure
    batch: StoryCall
    sessions: int = 0

    def of(self, where: Any, what: Any, session: Any = None) -> StoryCall:
        """Arguments for taps of these classes, by default at perception."""
        session = np.full(np.shape(where), self.sessions) if session is None else session
        return replace(self.batch, where=where, what=what, session=session)

    def at_perception(self, session: Sequence[int]) -> bool:
        """Whether taps of these sessions are all in that at perception."""
        return set(session) == {self.sessions}

    def in_sessions(self, where: Any, what: Any, session: Sequence[int]) -> StoryCall:
        """Arguments for taps of these sessions, and of a further one at perception unless all are.

        Without it, what belongs to sessions would have fewer of them than its latent variables.
        """
        if self.at_perception(session):
            return self.of(where, what)
        return self.of(_and_last(where), _and_last(what), np.append(session, self.sessions))


class Given(NamedTuple):
    """What a generative model is run at.

    Attributes:
        latents: Its latent variables, by name.
        arguments: Keyword arguments of its own.
        least: Standard deviation below which none counts, broadcast over (K,).
    """

    latents: dict[str, Any]
    arguments: dict[str, Any] = {}  # noqa: RUF012 - never written
    least: Any = 0.0


def stacked(given: Sequence[Given]) -> Given:
    """Values of equal shapes along first axes, in double precision."""
    return jax.tree.map(lambda *each: np.stack(each, dtype=np.float64), *given)


def _run(program: Program, given: Given, batch: StoryCall, taps: Any, key: Any = 0) -> Any:
    """Handler of the model at given latent variables."""

    def story() -> Any:
        with numpyro.validation_enabled(False):  # of constants alone, each compiled for itself
            return program.story(batch, taps, **given.arguments)

    known: Any = given.latents
    return seed(substitute(story, data=known), key)


def log_probability(
    program: Program, given: Given, taps: Binned, where: Any, what: Any, session: Any = None
) -> jax.Array:
    """Log probability of the bins of one tap (J, K) of class (where, what), in a training session if one is named."""
    copies = 1 if session is None else program.sessions + 1  # one in each session, of which one counts
    counted = None if session is None else jnp.arange(copies) == session
    one = Binned(*(jnp.broadcast_to(part, (copies, *part.shape)) for part in taps))
    batch = program.of(*(jnp.broadcast_to(index, copies) for index in (where, what)))
    if session is not None:
        batch = replace(batch, session=np.arange(copies))
    return density_of_taps(program.structure, _censored(program, given, batch, one, counted))


def density_of_taps(structure: Structure, story: Any) -> jax.Array:
    """Log density of taps under a handler of the model at given latent variables, discrete ones summed out."""
    if not structure.enumerated:
        return jnp.asarray(log_density(_observed(story), (), {}, {})[0])
    from numpyro.contrib.funsor import config_enumerate, enum
    from numpyro.contrib.funsor import log_density as summed

    kept = {OBSERVED, *structure.enumerated}
    local = block(story, hide_fn=lambda site: site["type"] == "sample" and site["name"] not in kept)
    return jnp.asarray(summed(enum(config_enumerate(local), first_available_dim=-8), (), {}, {})[0])


def _censored(program: Program, given: Given, batch: StoryCall, taps: Binned, counted: Any = None) -> Censored:
    story = _run(program, given, batch, taps.samples)
    return Censored(story, OBSERVED, taps.swapped() if program.structure.swapped else taps, given.least, counted)


def _observed(story: Any) -> Any:
    return block(story, hide_fn=lambda site: site.get("name") != OBSERVED)  # scans have none


def _and_last(values: Any) -> jax.Array:
    return jnp.concatenate([values, values[-1:]])


@partial(jax.jit, static_argnums=0)
def under_all(program: Program, given: Given, taps: Binned) -> jax.Array:
    """Log probability of taps (n, J, K) under every class, shape (n, L M)."""
    L, M, _, _ = program.batch.shape
    where, what = jnp.divmod(jnp.arange(L * M), M)
    each = jax.vmap(lambda one, l, m: log_probability(program, given, one, l, m), (None, 0, 0))
    return jax.vmap(lambda one: each(one, where, what))(taps)


@partial(jax.jit, static_argnums=0)
def in_states(
    program: Program, given: Given, gain: jax.Array, offset: jax.Array, scaling: Scaling, taps: Binned
) -> jax.Array:
    """As `under_all` in each of S states, which are along the first axes of what is given, shape (S, n, L M)."""

    def each(state: Any) -> jax.Array:
        known, gain, offset = state
        return under_all(program, known, taps.scaled(gain, offset, *scaling))

    return jax.lax.map(each, (given, gain, offset))


@partial(jax.jit, static_argnums=(0, 5))
def under_own(
    program: Program, given: Given, taps: Binned, where: jax.Array, what: jax.Array, session: tuple[int, ...]
) -> jax.Array:
    """Log probability of taps (n, J, K) under their own classes in their sessions, shape (n,)."""
    one_by_one = program.at_perception(session)
    if one_by_one or program.structure.enumerated:
        known = (where, what) if one_by_one else (where, what, jnp.asarray(session))
        return jax.vmap(lambda *own: log_probability(program, given, *own))(taps, *known)
    seen = Binned(*map(_and_last, taps))
    censored = _censored(program, given, program.in_sessions(where, what, session), seen)
    site = trace(_observed(censored)).get_trace()[OBSERVED]
    log_prob = site["fn"].log_prob(site["value"]) * (1.0 if site["scale"] is None else site["scale"])
    return log_prob.reshape(len(seen.samples), -1).sum(axis=1)[:-1]


@partial(jax.jit, static_argnums=(0, 3))
def bin_table(program: Program, given: Given, bins: Binned, session: tuple[int, ...]) -> jax.Array:
    """Log probability of every bin (1, B, K) of exchangeable samples, shape (S L M, B, K)."""
    L, M, J, K = program.batch.shape
    sessions, where, what = (axis.ravel() for axis in np.meshgrid(session, np.arange(L), np.arange(M), indexing="ij"))
    batch = program.in_sessions(where, what, sessions.tolist())
    story = _run(program, given, batch, jnp.zeros((len(batch.where), J, K)))
    log_prob = InBin(peeled(trace(_observed(story)).get_trace()[OBSERVED]["fn"]), bins, given.least).log_prob(0.0)
    return jnp.broadcast_to(log_prob, (len(batch.where), *bins.samples.shape[1:]))[: len(where)]


@partial(jax.jit, static_argnums=(0, 3))
def bin_tables(program: Program, given: Given, bins: Binned, session: tuple[int, ...]) -> jax.Array:
    """As `bin_table` at each of D values along the first axis of what is given, shape (D, S L M, B, K)."""
    return jax.lax.map(lambda one: bin_table(program, one, bins, session), given)


@partial(jax.jit, static_argnums=(0, 2, 6))
def drawn(
    program: Program, given: Given, J: int, where: Any, what: Any, key: Any, session: tuple[int, ...]
) -> jax.Array:
    """Samples (N, J, K) of taps of known class in their sessions."""
    L, M, _, K = program.batch.shape
    batch = program.in_sessions(where, what, session)
    value = trace(_run(program, given, replace(batch, shape=(L, M, J, K)), None, key)).get_trace()[OBSERVED]["value"]
    return (jnp.swapaxes(value, 1, 2) if program.structure.swapped else value)[: len(where)]


def refuse_wrong(program: Program, log_prob: NDArray[np.float64], where: Any, what: Any) -> None:
    """Refuses log probabilities that are no numbers or, of bins, above 0.

    Args:
        program: The model.
        log_prob: Of bins or taps.
        where: Their positions, broadcast over them.
        what: Their objects, likewise.

    Raises:
        InputError: There is such a number.
    """
    wrong = np.isnan(log_prob)
    if program.structure.measure == BINS:
        wrong |= log_prob > _ROUNDING
    if wrong.any():
        first = wrong.argmax()
        l, m = (int(np.broadcast_to(index, wrong.shape).flat[first]) for index in (where, what))
        told = "not a number" if np.isnan(log_prob.flat[first]) else "above 1"
        raise InputError(
            f"{program.story.name} gives position {l} and object {m} a probability of a bin that is {told}; check the "
            f"parameters of its {program.structure.family}, and that its cdf rises from 0 to 1."
        )


def key_from(generator: np.random.Generator) -> jax.Array:
    """Key of JAX from a random generator."""
    return key_of(number_from(generator))


def number_from(generator: np.random.Generator) -> int:
    """Number of which `key_from` makes the key."""
    return int(generator.integers(2**31))


def key_of(number: Any) -> jax.Array:
    """Key of JAX from a number, in compiled functions, too."""
    return jax.random.key(number)
