"""What a sweep tells about each cell at each threshold."""

QUANTITIES = {
    "what_error": "mean error of the object, in what_unit",
    "what_error_se": "its Monte Carlo error: standard error over trials on the same taps, no interval for other taps",
    "where_error": "mean error of the position at the decision, in where_unit",
    "where_error_se": "its Monte Carlo error: standard error over trials on the same taps, no interval for other taps",
    "taps": "mean reaction time in taps",
    "taps_se": "its Monte Carlo error: standard error over trials on the same taps, no interval for other taps",
    "what_wrong": "fraction of trials that decide for a wrong object",
    "stopped_fraction": "fraction of trials that cross the threshold before the deadline",
    "clamped_fraction": "fraction of trials in which the end of the range cut a move short before the decision",
    "substituted_fraction": "fraction of trials in which a class without a test tap was replaced before the decision",
    "no_class_left_fraction": "fraction of trials that met a tap impossible under every class still believed in",
    "belief": "mean belief in the decided object",
    "trials": "number of trials, the same at every threshold",
    "seconds": "time that the cell took, the same at every threshold",
}
"""Names and what they mean, in the order in which they are stored."""
