"""Control strategies: where to tap next.

Start with `control`: the paper's fixation strategy and alternatives; `strategies` names them all. `expected_gain` and
`information` compute the value of a tap. Rules for stopping are in `stopping`.
"""
