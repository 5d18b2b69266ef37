"""What a sweep tells about each cell at each threshold."""

from ..stats import tallied

QUANTITIES = tallied.QUANTITIES | {
    "trials": "number of trials, the same at every threshold",
    "seconds": "time that the cell took, the same at every threshold",
}
"""Names and what they mean, in the order in which they are stored."""
