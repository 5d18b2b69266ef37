"""Trials played in several ways, from a NumPy loop to C, and how long each takes.

Start with `job`, which every way is given; `agreement` compares their decisions with the reference equations.
"""
