"""Moves from a table learned in advance: the best target for each estimated position.

The strategy is coarse, as it uses only the most probable position, but needs neither enumeration nor training taps
online.

To learn it, parts of the training taps are held out of the model in turn. Trials are played on the held-out taps, and
for each estimated position and target the loss of the decision after the move is averaged.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Literal, NamedTuple, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from ...models import seeds
from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.io.mistakes import decode_json
from ...models.measurement.model import TapModel
from ...models.seeds import Purpose, derived_seed
from ...models.storage import complete_file
from ...models.taps import TapSet
from ..engines.compiled import border_number, refuse_border
from ..filter import log_fold, share, temper
from ..reference import Border
from ..trials.lockstep import drawn_taps, shifted, updated
from ..trials.records import TapTable, plan_trials
from ..tuning.held_out import held_out
from .control import MovePolicy, best_move, where_beliefs

type Floats = NDArray[np.float64]
type Integers = NDArray[np.int64]
type Loss = Literal["error", "log"]


class TargetTable(NamedTuple):
    """Learned targets for L positions.

    Attributes:
        target: Best target from each estimated position, shape (L,).
        loss: Mean loss of the decision after a move from each estimate to each target, shape (L, L).
        error: Standard error of the loss, NaN for fewer than two trials, shape (L, L).
        trials: Number of trials, shape (L, L).
        where_value: Positions, shape (L,).
        kind: Kind of the loss.
        taps: Number of taps after the move.
    """

    target: Integers
    loss: Floats
    error: Floats
    trials: Integers
    where_value: Floats
    kind: Loss
    taps: int

    def checked(self, grid: ClassGrid) -> Self:
        """The table, if it matches the grid.

        Raises:
            InputError: It was learned for other positions.
        """
        if self.where_value.shape != grid.where_value.shape or not np.allclose(self.where_value, grid.where_value):
            raise InputError(
                f"The table of targets has {len(self.where_value)} positions from {self.where_value[0]:g} to "
                f"{self.where_value[-1]:g}, the model {grid.L} from {grid.where_value[0]:g} to "
                f"{grid.where_value[-1]:g}."
            )
        return self


def lookup(table: TargetTable) -> MovePolicy:
    """Strategy that moves the estimated position to its target in the table."""

    def move(beliefs: Floats, chance: Floats) -> Integers:  # noqa: ARG001
        where = where_beliefs(beliefs)
        if where.shape[-1] != len(table.target):
            raise InputError(f"The table of targets has {len(table.target)} positions, the belief {where.shape[-1]}.")
        here = where.argmax(axis=-1)
        return (table.target[here] - here).astype(np.int64)

    return move


def save_table(table: TargetTable, path: str | Path, force: bool = False) -> None:
    """Writes a table as JSON, atomically.

    Raises:
        InputError: The file cannot be written, or exists and `force` is not set.
    """
    content = {"solidtouch": "table of targets"} | {
        name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in table._asdict().items()
    }
    with complete_file(path, force) as temporary:
        temporary.write_bytes(msgspec.json.format(msgspec.json.encode(content), indent=1) + b"\n")


class _TargetsFile(msgspec.Struct, forbid_unknown_fields=True):
    """Content of a file."""

    solidtouch: Literal["table of targets"]
    target: list[Annotated[int, msgspec.Meta(ge=0, lt=1 << 31)]]
    loss: list[list[float | None]]
    error: list[list[float | None]]
    trials: list[list[Annotated[int, msgspec.Meta(ge=0, lt=1 << 62)]]]
    where_value: list[float]
    kind: Loss
    taps: int


def load_table(path: str | Path) -> TargetTable:
    """Table read from a file.

    Raises:
        InputError: The file cannot be read or is not a table of targets.
    """
    try:
        file = decode_json(Path(path).read_bytes(), _TargetsFile)
    except OSError as error:
        raise InputError(f"{path}: cannot read: {error.strerror}.") from error
    except InputError as error:
        raise InputError(f"{path}: not a table of targets: {error}") from error
    L = len(file.target)
    square = all([len(row) for row in part] == [L] * L for part in (file.loss, file.error, file.trials))
    if not L or not square or len(file.where_value) != L or not set(file.target) <= set(range(L)):
        raise InputError(f"{path}: not a table of targets: its parts do not match {L} positions.")
    return TargetTable(
        target=np.array(file.target, np.int64),
        loss=np.array(file.loss, np.float64),
        error=np.array(file.error, np.float64),
        trials=np.array(file.trials, np.int64),
        where_value=np.array(file.where_value),
        kind=file.kind,
        taps=file.taps,
    )


BEFORE = 3
"""Maximum number of taps before the move; every number from 1 on is learned from."""
TRIALS = 2000
_LOSSES = ("error", "log")
_LEAST = 1e-6  # lowest belief in the true object, to keep the loss finite
_PRIOR = 4.0  # weight, in trials, of the mean over all estimates


def held_out_tables(taps: TapSet, grid: ClassGrid, fit: Callable[[TapSet, ClassGrid], TapModel]) -> list[TapTable]:
    """Training taps under models that they did not train: each session held out, or each half of a single session.

    Args:
        taps: Training taps.
        grid: Class grid.
        fit: Fits a model to some of the taps.

    Raises:
        InputError: As `held_out`.
    """
    return [part.table for part in held_out(taps, grid, fit).parts]


def learn_table(
    tables: Sequence[TapTable],
    grid: ClassGrid,
    *,
    border: Border = "uniform",
    loss: Loss = "log",
    taps: int = 1,
    trials: int = TRIALS,
    seed: int = 0,
) -> TargetTable:
    """Table of the best target for each estimated position.

    Each trial starts at a random position and taps there up to `BEFORE` times; after each tap every target is tried.
    The mean loss of a target is shrunk towards that over all estimates, which decides for rare estimates. A tap that is
    impossible under every class with nonzero belief leaves the belief unchanged.

    Args:
        tables: Taps under models that they did not train, see `held_out_tables`.
        grid: Class grid.
        border: Interpretation of Eq. 9 at the ends of the range.
        loss: `"error"` counts wrong objects, `"log"` takes -log of the belief in the true object, in nats.
        taps: Number of taps after the move.
        trials: Number of trials per table; their targets share all random numbers.
        seed: Random seed.

    Raises:
        InputError: An argument is out of range.
    """
    if loss not in _LOSSES:
        raise InputError(f"loss must be one of {', '.join(_LOSSES)}, got {loss!r}.")
    if taps < 1 or not len(tables):
        raise InputError(f"Learning needs at least 1 tap after the move and 1 table, got {taps} and {len(tables)}.")
    L = grid.L
    total = np.zeros((3, L, L))
    for number, table in enumerate(tables):
        refuse_border(border_number(border), table.log_prior.shape[1], grid.M)
        own = derived_seed(seed, Purpose.TARGETS, number)
        for here, target, value in _tried(table, border, loss, taps, trials, own):
            for power in range(3):
                np.add.at(total[power, :, target], here, value**power)
    count, first, second = total
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = first / count
        spread = np.maximum(second / count - mean**2, 0.0) / (count - 1)
    overall = first.sum(axis=0) / count.sum(axis=0)
    steadied = (first + _PRIOR * overall) / (count + _PRIOR)
    deltas = np.arange(L) - np.arange(L)[:, np.newaxis]
    return TargetTable(
        target=np.arange(L) + best_move(-steadied, deltas),
        loss=mean,
        error=np.where(count > 1, np.sqrt(spread), np.nan),
        trials=count.astype(np.int64),
        where_value=grid.where_value,
        kind=loss,
        taps=taps,
    )


def _tried(
    table: TapTable, border: Border, loss: Loss, taps: int, trials: int, seed: int
) -> Iterator[tuple[Integers, int, Floats]]:
    """Every target after 1 to `BEFORE` taps at one position: estimates (n,), target and losses (n,)."""
    L, M = table.pool.shape
    plan = plan_trials(table.pool, trials, seed)
    words = seeds.words(seed, plan.stream, seeds.TAPS, 0, BEFORE + taps)
    carried = np.broadcast_to(table.log_prior, (trials, *table.log_prior.shape))
    for before in range(BEFORE):
        tap = drawn_taps(table, plan.session, plan.where, plan.what, words[:, before])
        carried, _ = updated(carried, table.log_likelihood[tap])
        belief = np.exp(log_fold(temper(carried, share(before + 1, table.saturation)), M))
        here = where_beliefs(belief).argmax(axis=-1)
        for target in range(L):
            delta = target - here
            at = table.pool.nearest[plan.session, np.clip(plan.where + delta, 0, L - 1), plan.what]
            log_belief = shifted(carried, delta, border, M, table.trained)
            for more in range(taps):
                tap = drawn_taps(table, plan.session, at, plan.what, words[:, BEFORE + more])
                log_belief, _ = updated(log_belief, table.log_likelihood[tap])
            read = log_fold(temper(log_belief, share(before + 1 + taps, table.saturation)), M)
            yield here, target, _losses(np.exp(read).sum(axis=1), plan.what, loss)


def _losses(what: Floats, held: Integers, loss: Loss) -> Floats:
    if loss == "error":
        return (what.argmax(axis=1) != held).astype(np.float64)
    return -np.log(np.maximum(what[np.arange(len(held)), held], _LEAST))
