"""Checks that take too long for the test suite: fuzzing, fault injection, kills, mutation testing, output comparison.

Each of `fuzz`, `fuzz_files`, `faults`, `kills`, `collecting`, `mutants` and `freeze` is a command.
"""
