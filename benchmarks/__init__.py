"""Timing, studies and long checks, run from the repository root, e.g. `python -m benchmarks.speed.run --quick`.

`speed` measures running times, `studies` the statistics behind the documentation, `checks` robustness and the tests,
`peers` checks from outside. `page` and `study` hold shared helpers. The package imports nothing from here.
"""
