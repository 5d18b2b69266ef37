"""What strategies and rules of stopping are, in words for pages."""

STRATEGY_WORDS = {
    "passive": "never moves",
    "random": "moves to a random position",
    "step": "moves by one class to either side of the most probable position",
    "fixation": "moves to the fixation point, the middle of the range (the paper's active perception)",
    "fixation:0.8": "moves to the fixation point only if the belief in a position exceeds 0.8",
    "info-what": "maximises the expected information of the next tap about the object",
    "info-where": "maximises the expected information of the next tap about the position",
    "info-joint": "maximises the expected information of the next tap about object and position",
    "info-what-per-mm": "maximises the expected information about the object per millimetre of travel (5 mm per tap)",
    "info-what-per-s": "maximises the expected information about the object per second (1 s per tap, moves at 20 mm/s)",
    "table": "moves to the position that a table, learned from training taps, lists for the most probable position",
    "risk": "minimises the expected error of a decision after one more tap plus the cost of travel",
}
"""By the names of `inference.moves.strategies`; `risk` is played where costs are told only."""
RULE_WORDS = {
    "what": "the belief in an object exceeds a threshold (the paper's rule)",
    "where": "the belief in a position exceeds a threshold",
    "both": "both beliefs exceed the same threshold",
    "number of taps": "a fixed number of taps",
    "msprt": "multihypothesis sequential probability ratio test: one threshold per object, which rises as taps become "
    "cheaper and as the object differs more from the most similar one",
    "lookahead": "one more tap is expected to reduce the error by no more than it costs",
    "what, at N taps decide": "the paper's rule with a deadline: after N taps the most probable object is chosen",
    "what, at N taps give up": "the paper's rule with null decisions: after N taps the trial ends undecided",
}
"""By the names of `curves.families`, N for half the deadline."""
