"""Results of `reproduce`, `compare` and `sensitivity` on simulated and recorded taps, and on grids with holes.

They update docs/reference/results.md, docs/explanation/comparison.md and docs/explanation/open-choices.md.
"""
