"""Routes to the belief after a tap and a move, all behind `engine.Engine`.

Start with `engine`; `enumeration` is the NumPyro model with exact enumeration, `compiled` the fast one. `latency` and
`shadow` wrap any of them.
"""
