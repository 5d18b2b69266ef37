"""Minimum cost of any policy, by dynamic programming on small problems.

Start with `problem` and `risk`; `bounds` gives lower bounds for problems that are too large to solve.
"""
