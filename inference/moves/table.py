"""Moves from a table learned in advance: the best target for each estimated position.

The strategy is coarse, as it uses only the most probable position, but needs neither enumeration nor training taps
online. `table_learning` creates such tables.
"""

from pathlib import Path
from typing import Annotated, Literal, NamedTuple, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.storage import complete_file
from .control import MovePolicy, where_beliefs

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
        file = msgspec.json.decode(Path(path).read_bytes(), type=_TargetsFile)
    except OSError as error:
        raise InputError(f"{path}: cannot read: {error.strerror}.") from error
    except msgspec.DecodeError as error:
        raise InputError(f"{path}: not a table of targets: {error}.") from error
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
