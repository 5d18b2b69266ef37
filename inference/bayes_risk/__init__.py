"""The least cost that any policy can reach, by dynamic programming on small problems.

Start with `problem` and `risk`; `bounds` brackets it where the problem is too large to solve.
"""
