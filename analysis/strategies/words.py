"""What strategies and rules of stopping are, in words for pages."""

STRATEGY_WORDS = {
    "passive": "never moves",
    "random": "goes to a place drawn anew each time",
    "step": "goes a place to either side of where it believes to be",
    "fixation": "goes to the fixation point, the middle of the range: the paper's active perception",
    "fixation:0.8": "the same, but only where the belief in a place exceeds 0.8",
    "info-what": "goes where the next tap is expected to tell most about the object",
    "info-where": "goes where the next tap is expected to tell most about the place",
    "info-joint": "goes where the next tap is expected to tell most about both together",
    "info-what-per-mm": "goes where the next tap tells most about the object per millimetre of way, 5 mm of them for "
    "the tap",
    "info-what-per-s": "the same per second: 1 s for the tap, moves at 20 mm/s",
    "table": "goes to the place that a table, learned from training taps, has for where it believes to be",
    "risk": "goes where the expected error of a decision after one more tap and the cost of the way are least together",
}
"""By the names of `inference.moves.strategies`; `risk` is played where costs are told only."""
RULE_WORDS = {
    "what": "the belief in an object exceeds a threshold: the paper's rule",
    "where": "the belief in a place exceeds a threshold",
    "both": "both beliefs exceed one threshold",
    "number of taps": "after so many taps",
    "msprt": "the multihypothesis sequential probability ratio test: a threshold for each object, the higher the "
    "cheaper taps are and the farther the object is from the one most like it",
    "lookahead": "one more tap is expected to lower the error by no more than it costs",
    "what, at N taps decide": "as the paper's rule, but after N taps the most probable object is taken: a deadline",
    "what, at N taps give up": "as the paper's rule, but after N taps nothing is decided: a null decision",
}
"""By the names of `curves.families`, N for half the deadline."""
