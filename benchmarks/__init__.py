"""Measurements and long checks, run from the root of the repository: `python -m benchmarks.speed.run --quick`.

`speed` times the program; `studies` measures its statistics where the truth is known; `checks` tries to break it.
`page` and `study` are what several of them share. Nothing here is imported by the package.
"""
