"""Where to tap next.

Start with `control`, the paper's fixation and its rivals; `strategies` names them all. `expected_gain` and
`information` compute what a tap is worth. When to stop stands in `stopping`.
"""
