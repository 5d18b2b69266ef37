"""Trials as arrays on a JAX device, such as a GPU, with the same decisions as the compiled loops.

Trials occupy a fixed number of slots. A slot whose trial has decided at every threshold takes the next one at the end
of a round, so nobody waits for the slowest, and nothing comes back to the host before all have ended. Beliefs are log
beliefs in float64.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import logsumexp

from ...models import seeds
from ...models.measurement.fits.device import jax_device
from ..moves.holes import holes
from ..reference import BORDERS
from .records import Rule, TapTable, TrialPlan, Trials

_SLOTS = {"cpu": 1024, "gpu": 1 << 16}
_AT_ONCE = {"cpu": 1 << 14, "gpu": 1 << 20}
_ROUND = 8  # taps between two looks at which trials have ended


def update(log_belief: jax.Array, log_likelihood: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Log posterior (L, S M) and log evidence of one tap; Eq. 3 and 4.

    Zero evidence shows as a log evidence of -inf, and the log posterior then is -inf throughout.
    """
    log_joint = log_belief + log_likelihood
    log_evidence = logsumexp(log_joint)
    return log_joint - jnp.where(jnp.isneginf(log_evidence), 0.0, log_evidence), log_evidence


def shift(
    log_belief: jax.Array, delta: jax.Array, border: int, states: int = 1, trained: jax.Array | None = None
) -> jax.Array:
    """Log belief (L, S M) after a move by `delta` positions; Eq. 9, borders as in `kernel.shift`, S is `states`.

    On a grid with holes belief stays in `trained` classes, shape (L, M); `None` for a full grid, which is faster.
    """
    if trained is not None:
        return _shift_around(log_belief, delta, border, trained)
    L, M = log_belief.shape[0], log_belief.shape[1] // states
    name = BORDERS[border]
    source = jnp.arange(L) - delta
    if name == "circular":
        return log_belief[source % L]
    kept = ((source >= 0) & (source < L))[:, None]
    moved = jnp.where(kept, log_belief[jnp.clip(source, 0, L - 1)], -jnp.inf)
    if name == "prior":
        return _normalised(jnp.where(kept, moved, -jnp.log(L * M)))
    target = jnp.arange(L) + delta
    lost = jnp.where(((target < 0) | (target >= L))[:, None], log_belief, -jnp.inf)
    if name == "clamp":
        end = jnp.where(delta > 0, L - 1, 0)
        piled = jnp.logaddexp(moved, logsumexp(lost, axis=0))
        return _normalised(jnp.where(jnp.arange(L)[:, None] == end, piled, moved))
    vacated = jnp.maximum(jnp.minimum(jnp.abs(delta), L), 1)
    if name == "uniform_what":
        spread = logsumexp(lost, axis=0) - jnp.log(vacated)
    elif states == 1:
        spread = logsumexp(lost) - jnp.log(M * vacated)
    else:
        spread = jnp.repeat(logsumexp(lost.reshape(L, states, M), axis=(0, 2)) - jnp.log(M * vacated), M)
    return _normalised(jnp.where(kept, moved, spread))


def _shift_around(log_belief: jax.Array, delta: jax.Array, border: int, trained: jax.Array) -> jax.Array:
    """`shift` on a grid with holes, as sums over all positions that land on one."""
    L, M = trained.shape
    name, place = BORDERS[border], jnp.arange(L)
    target = (place + delta) % L if name == "circular" else place + delta
    end = jnp.clip(target, 0, L - 1)
    lands = trained & ((target == end)[:, None] & trained[end])
    goes = jnp.broadcast_to(target[:, None], (L, M))
    if name == "clamp":
        distance = jnp.where(trained, jnp.abs(place[:, None] - place)[:, :, None], L)
        goes, lands = distance.argmin(axis=1)[end], trained
    reaches = (goes[:, None] == place[:, None]) & lands[:, None]
    vacated = trained & ~reaches.any(axis=0)
    lost = trained & ~lands
    if name == "circular":
        number, room = jnp.cumsum(lost, axis=0), jnp.cumsum(vacated, axis=0)
        reaches |= lost[:, None] & vacated & (number[:, None] == room)
    before = log_belief.reshape(L, -1, M)
    moved = logsumexp(jnp.where(reaches[:, :, None], before[:, None], -jnp.inf), axis=0)
    out = jnp.where(lost[:, None], before, -jnp.inf)
    if name == "uniform":
        filling = logsumexp(out, axis=(0, 2), keepdims=True) - jnp.log(jnp.maximum(vacated.sum(), 1))
    elif name == "uniform_what":
        filling = logsumexp(out, axis=0, keepdims=True) - jnp.log(jnp.maximum(vacated.sum(axis=0), 1))
    else:
        filling = -jnp.log(trained.sum()) if name == "prior" else -jnp.inf
    filled = jnp.where(vacated[:, None], jnp.logaddexp(moved, filling), moved)
    return _normalised(filled.reshape(L, -1))


def temper(log_belief: jax.Array, share: jax.Array) -> jax.Array:
    """Log belief (L, S M) to the power `share`, normalised; see `saturation`."""
    return jnp.where(share < 1, _normalised(share * log_belief), log_belief)


def _normalised(log_belief: jax.Array) -> jax.Array:
    return log_belief - logsumexp(log_belief)


class _Tables(NamedTuple):
    """Constant arrays of a run."""

    log_likelihood: jax.Array
    log_prior: jax.Array
    order: jax.Array
    first: jax.Array
    size: jax.Array
    nearest: jax.Array
    thresholds: jax.Array
    theta_x: jax.Array
    key: tuple[jax.Array, jax.Array]
    saturation: jax.Array
    trained: jax.Array | None


class _Plan(NamedTuple):
    """Trials to play."""

    where: jax.Array
    what: jax.Array
    fixation: jax.Array
    stream: jax.Array
    session: jax.Array


class _Record(NamedTuple):
    """Decisions at every threshold, in their increasing order; shape (..., H)."""

    taps: jax.Array
    what: jax.Array
    where: jax.Array
    true_where: jax.Array
    stopped: jax.Array
    clamped: jax.Array
    substituted: jax.Array
    belief: jax.Array
    no_class_left: jax.Array


class _Slot(NamedTuple):
    """A trial in progress; with slot axes as in `_AXES`, all of them."""

    trial: jax.Array
    log_belief: jax.Array
    at: jax.Array
    tap: jax.Array
    clamped: jax.Array
    substituted: jax.Array
    decided: jax.Array
    record: _Record


_record: Any = dict.fromkeys(_Record._fields, 0)
_slot: Any = {**dict.fromkeys(_Slot._fields, 0), "log_belief": -1, "record": _Record(**_record)}
_AXES = _Slot(**_slot)
"""Slots are neighbours in memory where beliefs are: sums over classes then read it in order."""


class ArrayPlayer:
    """Plays trials on a JAX device.

    Args:
        table: Test taps.
        rule: How trials move and stop.
        platform: `"gpu"` or `"cpu"`.

    Attributes:
        at_once: How many trials it is best given at a time.

    Raises:
        InputError: JAX finds no such device.
    """

    def __init__(self, table: TapTable, rule: Rule, platform: str) -> None:
        self._device = jax_device(platform)
        self._saturates = bool(table.saturation < rule.deadline)
        self.at_once, self._slots, self._rule = _AT_ONCE[platform], _SLOTS[platform], rule
        trained = holes(table.trained)
        pool, put = table.pool, partial(jax.device_put, device=self._device)
        with jax.enable_x64(True):
            self._tables = _Tables(
                log_likelihood=put(table.log_likelihood),
                log_prior=put(table.log_prior),
                order=put(pool.order),
                first=put(pool.first),
                size=put(pool.count),
                nearest=put(pool.nearest),
                thresholds=put(rule.thresholds),
                theta_x=put(np.float64(rule.theta_x)),
                key=(put(rule.key0), put(rule.key1)),
                saturation=put(np.float64(table.saturation)),
                trained=None if trained is None else put(trained),
            )

    def __call__(self, plan: TrialPlan, first: int, last: int, trials: Trials) -> None:
        """See `trials.run.Player`."""
        rule, n = self._rule, last - first
        with jax.enable_x64(True):
            rows = TrialPlan(*(column[first:last] for column in plan))
            part = _Plan(**jax.device_put(rows._asdict(), self._device))
            record = _play(
                self._tables,
                part,
                min(self._slots, n),
                rule.border,
                rule.deadline,
                rule.theta_x < 1,
                self._saturates,
            )
            for name, values in zip(_Record._fields, jax.device_get(record), strict=True):
                getattr(trials, name)[first:last][:, rule.column] = values


@partial(jax.jit, static_argnums=(2, 3, 5, 6))
def _play(
    tables: _Tables, plan: _Plan, slots: int, border: int, deadline: Any, moving: bool, saturates: bool
) -> _Record:
    """Decisions of all trials of a plan."""
    n, H = len(plan.where), len(tables.thresholds)
    tap = partial(_tap, tables, plan, border=border, deadline=deadline, moving=moving, saturates=saturates)
    step = jax.vmap(tap, in_axes=(_AXES,), out_axes=_AXES)
    fresh = jax.vmap(partial(_fresh, tables, plan), out_axes=_AXES)

    def busy(carry: tuple[_Slot, _Record, jax.Array]) -> jax.Array:
        return (carry[0].trial < n).any()

    def turn(carry: tuple[_Slot, _Record, jax.Array]) -> tuple[_Slot, _Record, jax.Array]:
        state, records, following = carry
        state, _ = jax.lax.scan(lambda now, _: (step(now), None), state, length=_ROUND)
        ended = (state.trial < n) & (state.decided == H)
        rows = jnp.where(ended, state.trial, n)
        records = jax.tree.map(lambda all_, new: all_.at[rows].set(new, mode="drop"), records, state.record)
        trial = jnp.minimum(following + jnp.cumsum(ended) - 1, n)
        state = jax.tree.map(partial(_choose, ended), _AXES, fresh(trial), state)
        return state, records, following + ended.sum()

    start = fresh(jnp.arange(slots))
    records = jax.tree.map(lambda field: jnp.zeros((n, *field.shape[1:]), field.dtype), start.record)
    _, records, _ = jax.lax.while_loop(busy, turn, (start, records, jnp.asarray(slots)))
    return records


def _choose(condition: jax.Array, axis: int, new: jax.Array, old: jax.Array) -> jax.Array:
    return jnp.where(jnp.expand_dims(condition, [one for one in range(old.ndim) if one != axis % old.ndim]), new, old)


def _fresh(tables: _Tables, plan: _Plan, trial: jax.Array) -> _Slot:
    """A trial before its first tap; a number past the plan's end gives an idle slot."""
    row = jnp.minimum(trial, len(plan.where) - 1)
    at = tables.nearest[plan.session[row], plan.where[row], plan.what[row]]
    zero = jnp.zeros((), dtype=jnp.int64)
    none = jnp.zeros(len(tables.thresholds), dtype=jnp.int64)
    return _Slot(
        trial=trial,
        log_belief=tables.log_prior,
        at=at,
        tap=zero,
        clamped=zero,
        substituted=(at != plan.where[row]).astype(jnp.int64),
        decided=zero,
        record=_Record(
            taps=none,
            what=none,
            where=none,
            true_where=none,
            stopped=none.astype(bool),
            clamped=none,
            substituted=none,
            belief=none.astype(jnp.float64),
            no_class_left=none.astype(bool),
        ),
    )


def _tap(
    tables: _Tables, plan: _Plan, slot: _Slot, *, border: int, deadline: Any, moving: bool, saturates: bool
) -> _Slot:
    """One tap of one trial and the move after it; the order of `episode.perceive`."""
    row = jnp.minimum(slot.trial, len(plan.where) - 1)
    session, held = plan.session[row], plan.what[row]
    word = _word(tables.key, plan.stream[row], slot.tap)
    number = seeds.below(word, tables.size[session, slot.at, held].astype(jnp.uint64)).astype(jnp.int64)
    index = tables.order[tables.first[session, slot.at, held] + number]
    log_belief, log_evidence = update(slot.log_belief, tables.log_likelihood[index])
    none_left = jnp.isneginf(log_evidence)
    log_belief = jnp.where(none_left, slot.log_belief, log_belief)
    read = temper(log_belief, tables.saturation / (slot.tap + 1 - none_left)) if saturates else log_belief
    belief = jnp.exp(read)
    where, what = belief.sum(1), belief.sum(0)
    M = tables.nearest.shape[2]
    states = len(what) // M
    if states > 1:
        what = what.reshape(states, M).sum(0)
    slot = _decide(tables, slot._replace(log_belief=log_belief), where, what, deadline, none_left)
    slot = slot._replace(tap=slot.tap + 1)
    return (
        _move(tables, slot, where, plan.fixation[row], tables.nearest[session, :, held], border, states)
        if moving
        else slot
    )


def _decide(
    tables: _Tables, slot: _Slot, where: jax.Array, what: jax.Array, deadline: Any, none_left: jax.Array
) -> _Slot:
    """Records thresholds crossed for the first time, or all others at the deadline or with no class left."""
    order = jnp.arange(len(tables.thresholds))
    above = (what.max() > tables.thresholds) & ~none_left
    reached = jnp.where(none_left | (slot.tap == deadline - 1), len(order), above.sum())
    new = (order >= slot.decided) & (order < reached)
    counts, best = (slot.clamped, slot.substituted), what.max()
    now = _Record(slot.tap + 1, what.argmax(), where.argmax(), slot.at, above, *counts, best, none_left)
    record = jax.tree.map(lambda old, value: jnp.where(new, value, old), slot.record, now)
    return slot._replace(decided=jnp.maximum(slot.decided, reached), record=record)


def _move(
    tables: _Tables, slot: _Slot, where: jax.Array, fixation: jax.Array, nearest: jax.Array, border: int, states: int
) -> _Slot:
    """Eq. 8 to 10; the true position is clipped to the range, the belief shifts by the commanded move."""
    delta = jnp.where(where.max() > tables.theta_x, fixation - where.argmax(), 0)
    commanded = slot.at + delta
    reached = jnp.clip(commanded, 0, len(where) - 1)
    landed = nearest[reached]
    return slot._replace(
        log_belief=shift(slot.log_belief, delta, border, states, tables.trained),
        at=landed,
        clamped=slot.clamped + (reached != commanded),
        substituted=slot.substituted + (landed != reached),
    )


def _word(key: tuple[jax.Array, jax.Array], stream: jax.Array, tap: jax.Array) -> jax.Array:
    """Random word of a tap, as in `seeds.words`."""
    stream, tap = stream.astype(jnp.uint64), tap.astype(jnp.uint64)
    block = seeds.philox(tap // np.uint64(seeds.PER_BLOCK), seeds.TAPS, stream & seeds.LOW, stream >> seeds.HALF, *key)
    return jnp.stack(block)[tap % np.uint64(seeds.PER_BLOCK)]
