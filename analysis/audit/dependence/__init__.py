"""Permutation tests of dependence within a class: of taxels, of times, and against drift.

Start at `permutation`, which the others build on. No sentences: `audit.summary` says what the tests found.
"""
