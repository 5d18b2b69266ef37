"""`strategies`: control strategies and stopping rules, and their regret against the exact rule.

Start at `run`, then `curves` (errors against taps) and `regret`.
No strategies: they are in `inference`; what is here compares them.
"""
