"""Strategies of moving and stopping: errors, regret against the exact rule, gain of tuning.

`comparison` updates docs/explanation/strategies.md, `tuning` docs/how-to/tuning.md.
"""
