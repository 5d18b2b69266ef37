"""Likelihood of taps under a generative model at given latent variables, by running it once for every class.

The model's own function is run by NumPyro for one tap of one class, with bins in place of samples (see `observed`), and
vectorised over classes and taps. Nothing is known of the model but the contract.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import chain
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...threads import cores, in_order
from ..likelihood.bins import NOT_FINITE
from ..scaling import Scaling
from .observed import Binned
from .runs import (
    Given,
    Program,
    bin_table,
    bin_tables,
    drawn,
    in_states,
    key_from,
    log_probability,
    refuse_wrong,
    stacked,
    under_all,
    under_own,
)

_AT_ONCE = 1 << 22  # samples under classes, or numbers of tables, that one step holds
_DRAWS = 128  # of latent variables that one step makes tables of


@dataclass(frozen=True, eq=False)
class GenericForm:
    """Likelihood of whole taps under a generative model; see `forms` for what a form is.

    Attributes:
        program: The model.
        given: What it is run at in each state, S of them.
        scaling: Units in which it describes samples.
        gain: Of each state, shape (S,).
        offset: Likewise.
        session: Index of the session of each state, S of them; default all are at perception.
    """

    program: Program
    given: tuple[Given, ...]
    scaling: Scaling
    gain: NDArray[np.float64] = field(default_factory=lambda: np.ones(1))
    offset: NDArray[np.float64] = field(default_factory=lambda: np.zeros(1))
    session: tuple[int, ...] = ()

    @classmethod
    def in_sessions(cls, program: Program, given: Given, scaling: Scaling) -> "GenericForm":
        """Form over the hypotheses of all training sessions, one after another."""
        S = program.sessions
        return cls(program, (given,) * S, scaling, np.ones(S), np.zeros(S), tuple(range(S)))

    @property
    def shape(self) -> tuple[int, int]:
        """(L, H)."""
        L, M, _, _ = self.program.batch.shape
        return L, M * len(self.gain)

    @cached_property
    def known(self) -> tuple[Given, ...]:
        """What it is run at, on the device."""
        with jax.enable_x64(True):
            each = {id(one): jax.tree.map(partial(jnp.asarray, dtype=jnp.float64), one) for one in self.given}
        return tuple(each[id(one)] for one in self.given)

    @cached_property
    def _stacked(self) -> Given:
        """What it is run at, with the states along the first axes."""
        return stacked(self.given)

    @property
    def sessions(self) -> NDArray[np.intp]:
        """Index of the session of each state, shape (S,)."""
        return np.array(self.session or [self.program.sessions] * len(self.gain))

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
        given, session = (
            sum(values, ()) for values in zip(*((part.given, part.session) for part in parts), strict=True)
        )
        return replace(parts[0], given=given, gain=gain, offset=offset, session=session)

    def log_probability(self, tap: jax.Array, edges: jax.Array, where: Any, hypothesis: Any) -> jax.Array:
        """Log probability of the bins of one tap (J, K) under one hypothesis, in JAX."""
        state, what = jnp.divmod(hypothesis, self.program.batch.shape[1])
        seen = _first(self._scaled(Binned.of(tap[None], edges), state))
        given = self.given[0]
        if len(self.given) > 1:
            given = jax.tree.map(lambda *values: jnp.stack(values)[state], *self.given)
        return log_probability(self.program, given, seen, where, what)

    def log_prob(self, taps: Any, edges: Any) -> jax.Array:
        """Log probability of the bins of taps (n, J, K) under every hypothesis, shape (n, L, H), in JAX."""
        L, M, _, _ = self.program.batch.shape
        seen, S = _on_device(taps, edges), len(self.given)
        if S == 1:
            return under_all(self.program, self.known[0], self._scaled(seen, 0)).reshape(-1, L, M)
        parts = in_states(self.program, self._stacked, self.gain, self.offset, self.scaling, seen)
        return parts.reshape(S, -1, L, M).transpose(1, 2, 0, 3).reshape(-1, L, S * M)

    def prepare(self, impossible: NDArray[np.bool_]) -> "PreparedGeneric":
        """Precomputed form; hypotheses in the mask `impossible`, shape (L, H), have likelihood 0."""
        return PreparedGeneric(self, impossible)

    def table(self, edges: NDArray[np.float64]) -> NDArray[np.float64]:
        """Log probability of every bin of exchangeable samples at rest, shape (L, M, K, B).

        With training sessions, shape (L, S M, K, B).
        """
        with jax.enable_x64(True):
            session = tuple(self.sessions.tolist())
            return self._by_class(np.asarray(bin_table(self.program, self.known[0], self._every_bin(edges), session)))

    def tables(self, given: Sequence[Given], edges: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
        """As `table` at other values, D of them, shape (d, L, M, K, B) of some at a time."""
        L, M, _, K = self.program.batch.shape
        session = tuple(self.sessions.tolist())
        step = int(np.clip(_AT_ONCE // (L * M * len(session) * K * (edges.shape[-1] - 1)), 1, min(len(given), _DRAWS)))
        with jax.enable_x64(True):
            bins = self._every_bin(edges)
        for rows in _blocks(np.arange(len(given)), step):
            padded = np.resize(rows, step).tolist()  # a last block of another size would be compiled anew
            with jax.enable_x64(True):
                made = np.asarray(bin_tables(self.program, stacked([given[d] for d in padded]), bins, session))
            yield np.stack([self._by_class(one) for one in made[: len(rows)]])

    def _every_bin(self, edges: NDArray[np.float64]) -> Binned:
        """Every bin (1, B, K) in the units of the model."""
        K = self.program.batch.shape[3]
        edges = np.broadcast_to(edges, (K, edges.shape[-1]))
        centres = 0.5 * (edges[:, :-1] + edges[:, 1:])
        return _before(_on_device(centres.T[None], edges), 1.0, 0.0, *self.scaling)

    def _by_class(self, table: NDArray[np.float64]) -> NDArray[np.float64]:
        """What `bin_table` returns, (S L M, B, K), in the shape of a table (L, S M, K, B)."""
        L, M, _, K = self.program.batch.shape
        by_class = table.reshape(-1, L, M, table.shape[1], K).transpose(1, 0, 2, 4, 3)
        return by_class.reshape(L, -1, *by_class.shape[3:])

    def own(
        self, taps: NDArray[np.floating], edges: NDArray[np.float64], where: NDArray[np.intp], what: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """Log probability of the bins of taps (N, J, K) under their own hypotheses, shape (N,)."""
        _, M, J, K = self.program.batch.shape
        state, what = np.divmod(what, M)
        sessions, out, step = self.sessions[state], np.empty(len(taps)), max(1, _AT_ONCE // (J * K))
        with jax.enable_x64(True):
            for same in _alike(zip(map(id, self.known), self.gain, self.offset, strict=True), state):
                for rows in _blocks(same, step):
                    s = state[rows[0]]
                    seen = self._scaled(_on_device(taps[rows], edges), s)
                    session = tuple(sessions[rows].tolist())
                    out[rows] = under_own(self.program, self.known[s], seen, where[rows], what[rows], session)
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
        taps, sessions = np.empty((len(where), J, len(self.scaling.unit))), self.sessions[state]
        with jax.enable_x64(True):
            for rows in _alike(map(id, self.known), state):
                filled = np.resize(rows, _power_of_two(len(rows), len(where)))  # few sizes, as each is compiled
                classes = jnp.asarray(where[filled]), jnp.asarray(what[filled])
                session = tuple(sessions[filled].tolist())
                made = drawn(self.program, self.known[state[rows[0]]], J, *classes, key_from(generator), session)
                taps[rows] = made[: len(rows)]
        taps = taps * self.scaling.unit + self.scaling.centre
        return taps * self.gain[state, None, None] + self.offset[state, None, None]

    def _scaled(self, seen: Binned, s: Any) -> Binned:
        """Samples and bins before gain and offset, in the units of the model."""
        return _before(seen, self.gain[s], self.offset[s], *self.scaling)


jax.tree_util.register_dataclass(
    GenericForm, data_fields=["given", "scaling", "gain", "offset"], meta_fields=["program", "session"]
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


def _alike(keys: Iterable[Any], state: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Indices of taps in states (N,) with equal keys, in the order of the first state of each."""
    number: dict[Any, int] = {}
    of_tap = np.array([number.setdefault(key, len(number)) for key in keys])[state]
    return [np.flatnonzero(of_tap == one) for one in np.unique(of_tap)]


def _power_of_two(number: int, most: int) -> int:
    return min(1 << (number - 1).bit_length(), most)


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
