"""Leakage: whether samples before contact identify the class, compared with whole taps.

Start at `run`. No tests of dependence among taps: those are in `audit.dependence`.
"""
