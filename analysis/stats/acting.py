"""Whether active perception is possible on a grid of classes, and the policies to compare."""

from ...models.grid import ClassGrid


def can_act(grid: ClassGrid) -> bool:
    """Whether active perception means anything: there is somewhere to move and something to tell apart."""
    return grid.L > 1 and grid.M > 1


def policies(grid: ClassGrid) -> tuple[str, ...]:
    """The policies that mean anything; the last one is the one that comparisons are about."""
    return ("passive", "active") if can_act(grid) else ("passive",)
