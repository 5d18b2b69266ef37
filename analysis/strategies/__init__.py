"""`strategies`: how to move and when to stop, and the regret against the exact rule.

Start at `run`, then `curves` (errors against taps) and `regret`.
No strategies: they are in `inference`; what is here compares them.
"""
