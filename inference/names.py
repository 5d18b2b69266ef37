"""Forms of the names of control strategies and stopping rules; capitals stand for numbers.

It imports nothing, so that the Tab key, which lists them, answers at once.
"""

MOVES = (
    "passive",
    "fixation",
    "fixation:THETA_X",
    "random",
    "step",
    "step:REACH",
    *(f"info-{about}{per}" for about in ("what", "where", "joint") for per in ("", "-per-mm", "-per-s")),
    "table",
)
STOPS = (
    "what:THETA",
    "where:THETA",
    "both:THETA_W,THETA_X",
    "taps:N",
    "error:P",
    "each-error:P",
    "msprt:COST",
    "lookahead:COST",
)
