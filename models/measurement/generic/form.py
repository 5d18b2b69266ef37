"""Likelihood of taps under a generative model at given latent variables, by running it once for every class.

The model's own function is run by NumPyro for one tap of one class, with bins in place of samples (see `observed`), and
vectorised over classes and taps. Nothing is known of the model but the contract.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import chain
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
from numpy.typing import NDArray
from numpyro.handlers import block, seed, substitute, trace
from numpyro.infer.util import log_density

from ...errors import InputError
from ...threads import cores, in_order
from ..fits.present import peeled
from ..likelihood.bins import NOT_FINITE
from ..scaling import Scaling
from .contract import StoryCall, StoryFunction
from .observed import BINS, Binned, Censored, InBin
from .structure import OBSERVED, Structure

_ROUNDING = 1e-6  # log probabilities of whole taps may be above 0 by this
_AT_ONCE = 1 << 22  # samples under classes that one step holds


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


def _run(program: Program, given: Given, batch: StoryCall, taps: Any, key: Any = 0) -> Any:
    """Handler of the model at given latent variables."""

    def story() -> Any:
        with numpyro.validation_enabled(False):  # of constants alone, each compiled for itself
            return program.story(batch, taps, **given.arguments)

    known: Any = given.latents
    return seed(substitute(story, data=known), key)


def _log_probability(program: Program, given: Given, taps: Binned, where: Any, what: Any) -> jax.Array:
    """Log probability of the bins of one tap (J, K) of class (where, what)."""
    one = Binned(*(part[None] for part in taps))
    story = _run(program, given, program.of(where[None], what[None]), one.samples)
    censored = Censored(story, OBSERVED, one.swapped() if program.structure.swapped else one, given.least)
    if not program.structure.enumerated:
        observed = block(censored, hide_fn=lambda site: site["name"] != OBSERVED)
        return jnp.asarray(log_density(observed, (), {}, {})[0])
    from numpyro.contrib.funsor import config_enumerate, enum
    from numpyro.contrib.funsor import log_density as summed

    kept = {OBSERVED, *program.structure.enumerated}
    local = block(censored, hide_fn=lambda site: site["type"] == "sample" and site["name"] not in kept)
    return jnp.asarray(summed(enum(config_enumerate(local), first_available_dim=-8), (), {}, {})[0])


@partial(jax.jit, static_argnums=0)
def _under_all(program: Program, given: Given, taps: Binned) -> jax.Array:
    """Log probability of taps (n, J, K) under every class, shape (n, L M)."""
    L, M, _, _ = program.batch.shape
    where, what = jnp.divmod(jnp.arange(L * M), M)
    each = jax.vmap(lambda one, l, m: _log_probability(program, given, one, l, m), (None, 0, 0))
    return jax.vmap(lambda one: each(one, where, what))(taps)


@partial(jax.jit, static_argnums=0)
def _under_own(program: Program, given: Given, taps: Binned, where: jax.Array, what: jax.Array) -> jax.Array:
    """Log probability of taps (n, J, K) under their own classes, shape (n,)."""
    return jax.vmap(lambda one, l, m: _log_probability(program, given, one, l, m))(taps, where, what)


@partial(jax.jit, static_argnums=0)
def _bin_table(program: Program, given: Given, bins: Binned) -> jax.Array:
    """Log probability of every bin (1, B, K) of exchangeable samples, shape (L M, B, K)."""
    L, M, J, K = program.batch.shape
    where, what = np.divmod(np.arange(L * M), M)
    story = _run(program, given, program.of(where, what), jnp.zeros((L * M, J, K)))
    site = trace(block(story, hide_fn=lambda site: site["name"] != OBSERVED)).get_trace()[OBSERVED]
    log_prob = InBin(peeled(site["fn"]), bins, given.least).log_prob(bins.samples)
    return jnp.broadcast_to(log_prob, (L * M, *bins.samples.shape[1:]))


@partial(jax.jit, static_argnums=(0, 2))
def drawn(program: Program, given: Given, J: int, where: Any, what: Any, key: Any) -> jax.Array:
    """Samples (N, J, K) of taps of known class."""
    L, M, _, K = program.batch.shape
    batch = replace(program.of(where, what), shape=(L, M, J, K))
    value = trace(_run(program, given, batch, None, key)).get_trace()[OBSERVED]["value"]
    return jnp.swapaxes(value, 1, 2) if program.structure.swapped else value


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


@dataclass(frozen=True, eq=False)
class GenericForm:
    """Likelihood of whole taps under a generative model; see `forms` for what a form is.

    Attributes:
        program: The model.
        given: What it is run at.
        scaling: Units in which it describes samples.
        gain: Of each state, shape (S,).
        offset: Likewise.
    """

    program: Program
    given: Given
    scaling: Scaling
    gain: NDArray[np.float64] = field(default_factory=lambda: np.ones(1))
    offset: NDArray[np.float64] = field(default_factory=lambda: np.zeros(1))

    @property
    def shape(self) -> tuple[int, int]:
        """(L, H)."""
        L, M, _, _ = self.program.batch.shape
        return L, M * len(self.gain)

    @cached_property
    def known(self) -> Given:
        """What it is run at, on the device."""
        with jax.enable_x64(True):
            return jax.tree.map(partial(jnp.asarray, dtype=jnp.float64), self.given)

    exchangeable = False
    """Whether a tap may have any number of samples."""

    @property
    def independent(self) -> bool:
        """Whether samples are independent under a hypothesis."""
        return self.program.structure.independent

    def in_state(self, gain: float, offset: float, edges: NDArray[np.float64]) -> "GenericForm":  # noqa: ARG002 - as TableForm
        """Form of `gain` times a tap plus `offset`."""
        return replace(self, gain=gain * self.gain, offset=gain * self.offset + offset)

    @staticmethod
    def joined(parts: Sequence["GenericForm"]) -> "GenericForm":
        """Form over the hypotheses of the same model in several states, one after another."""
        gain, offset = (
            np.concatenate(values) for values in zip(*((part.gain, part.offset) for part in parts), strict=True)
        )
        return replace(parts[0], gain=gain, offset=offset)

    def log_probability(self, tap: jax.Array, edges: jax.Array, where: Any, hypothesis: Any) -> jax.Array:
        """Log probability of the bins of one tap (J, K) under one hypothesis, in JAX."""
        state, what = jnp.divmod(hypothesis, self.program.batch.shape[1])
        return _log_probability(
            self.program, self.given, _first(self._scaled(Binned.of(tap[None], edges), state)), where, what
        )

    def log_prob(self, taps: Any, edges: Any) -> jax.Array:
        """Log probability of the bins of taps (n, J, K) under every hypothesis, shape (n, L, H), in JAX."""
        L, M, _, _ = self.program.batch.shape
        seen = _on_device(taps, edges)
        parts = [_under_all(self.program, self.known, self._scaled(seen, s)) for s in range(len(self.gain))]
        return jnp.concatenate([part.reshape(-1, L, M) for part in parts], axis=2)

    def prepare(self, impossible: NDArray[np.bool_]) -> "PreparedGeneric":
        """Precomputed form; hypotheses in the mask `impossible`, shape (L, H), have likelihood 0."""
        return PreparedGeneric(self, impossible)

    def table(self, edges: NDArray[np.float64]) -> NDArray[np.float64]:
        """Log probability of every bin of exchangeable samples at rest, shape (L, M, K, B)."""
        L, M, _, K = self.program.batch.shape
        edges = np.broadcast_to(edges, (K, edges.shape[-1]))
        centres = 0.5 * (edges[:, :-1] + edges[:, 1:])
        with jax.enable_x64(True):
            bins = _before(_on_device(centres.T[None], edges), 1.0, 0.0, *self.scaling)
            table = np.asarray(_bin_table(self.program, self.known, bins))
        return np.moveaxis(table.reshape(L, M, -1, K), 2, 3)

    def own(
        self, taps: NDArray[np.floating], edges: NDArray[np.float64], where: NDArray[np.intp], what: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """Log probability of the bins of taps (N, J, K) under their own hypotheses, shape (N,)."""
        _, M, J, K = self.program.batch.shape
        state, what = np.divmod(what, M)
        out, step = np.empty(len(taps)), max(1, _AT_ONCE // (J * K))
        with jax.enable_x64(True):
            for s in np.unique(state):
                for rows in _blocks(np.flatnonzero(state == s), step):
                    seen = self._scaled(_on_device(taps[rows], edges), s)
                    out[rows] = _under_own(self.program, self.known, seen, where[rows], what[rows])
        refuse_wrong(self.program, out, where, what)
        return out

    def sample(
        self,
        where: NDArray[np.intp],
        what: NDArray[np.intp],
        edges: NDArray[np.float64],  # noqa: ARG002 - as TableForm
        J: int,
        generator: np.random.Generator,
    ) -> NDArray[np.float64]:
        """Taps under hypotheses (N,), shape (N, J, K)."""
        state, what = np.divmod(what, self.program.batch.shape[1])
        with jax.enable_x64(True):
            key = key_from(generator)
            taps = np.asarray(drawn(self.program, self.known, J, jnp.asarray(where), jnp.asarray(what), key))
        taps = taps * self.scaling.unit + self.scaling.centre
        return taps * self.gain[state, None, None] + self.offset[state, None, None]

    def _scaled(self, seen: Binned, s: Any) -> Binned:
        """Samples and bins before gain and offset, in the units of the model."""
        return _before(seen, self.gain[s], self.offset[s], *self.scaling)


jax.tree_util.register_dataclass(
    GenericForm, data_fields=["given", "scaling", "gain", "offset"], meta_fields=["program"]
)


@dataclass(frozen=True, eq=False)
class PreparedGeneric:
    """A `GenericForm` with impossible hypotheses."""

    form: GenericForm
    impossible: NDArray[np.bool_]

    def log_likelihood(
        self, taps: NDArray[np.floating], edges: NDArray[np.float64], exponent: float, out: NDArray[np.float64]
    ) -> None:
        """Writes `exponent` times the log probability of the bins of taps (N, J, K) to `out`, shape (N, L, H)."""
        (J, K), (L, H) = taps.shape[1:], self.impossible.shape
        step = int(np.clip(_AT_ONCE // (J * K * L * H), 1, len(taps)))

        def part(rows: NDArray[np.intp]) -> NDArray[np.float64]:
            with jax.enable_x64(True):
                padded = np.resize(rows, step)  # a last block of another size would be compiled anew
                return np.asarray(self.form.log_prob(taps[padded], edges))[: len(rows)]

        first, *others = _blocks(np.arange(len(taps)), step)
        classes = np.arange(L)[:, None], np.arange(H) % self.form.program.batch.shape[1]
        # NumPyro runs models in one thread at a time: the first block is compiled before the others are begun.
        tasks = (partial(part, rows) for rows in others)
        parts = chain([part(first)], in_order(tasks, cores(None) if len(others) > 1 else 1))
        for rows, values in zip([first, *others], parts, strict=True):
            possible = np.where(self.impossible, -np.inf, values)
            refuse_wrong(self.form.program, possible, *classes)
            out[rows] = exponent * possible


def _first(taps: Binned) -> Binned:
    return Binned(*(part[0] for part in taps))


def key_from(generator: np.random.Generator) -> jax.Array:
    """Key of JAX from a random generator."""
    return jax.random.key(int(generator.integers(2**31)))


def _blocks(rows: NDArray[np.intp], step: int) -> list[NDArray[np.intp]]:
    return [rows[start : start + step] for start in range(0, len(rows), step)]


def _on_device(taps: Any, edges: Any) -> Binned:
    """Samples (n, J, K) with their bins, in double precision.

    Raises:
        InputError: A sample is infinite.
    """
    if np.isinf(taps).any():
        raise InputError(NOT_FINITE)
    return _held(jnp.asarray(taps, dtype=jnp.float64), jnp.asarray(edges, dtype=jnp.float64))


_held, _before = jax.jit(Binned.of), jax.jit(Binned.scaled)  # one program each instead of one per operation
