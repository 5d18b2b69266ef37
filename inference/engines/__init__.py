"""Engines, which compute the belief after a tap and a move; all implement `engine.Engine`.

Start with `engine`; `enumeration` is the NumPyro model with exact enumeration, `compiled` the fast one. `latency` and
`shadow` wrap any of them.
"""
