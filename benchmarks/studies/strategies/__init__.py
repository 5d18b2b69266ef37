"""Strategies of moving and stopping: their errors, regret against the exact rule, gain of tuning.

`comparison` fills docs/explanation/strategies.md, `tuning` docs/how-to/tuning.md.
"""
