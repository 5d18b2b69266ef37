"""The command line: one file per command, thin over the packages.

Start with `main`. What several commands share, options, progress, interruption, opening a sensor, is in `shared`.
Nothing is computed here that a function could not give.
"""
