"""Permutation tests of dependence within a class: of taxels, of times, and against drift."""
