"""Checks that take too long for the tests: random inputs, faults, kills, planted errors, outputs before and after.

Each of `fuzz`, `faults`, `kills`, `mutants` and `freeze` is a command of its own.
"""
