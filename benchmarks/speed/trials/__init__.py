"""Trials played by several methods, from a NumPy loop to C, and their running times.

Start with `job`, the input of every method; `agreement` compares decisions with the reference equations.
"""
