"""What the commands `reproduce`, `compare` and `sensitivity` find on simulated and recorded taps, and with holes.

They fill docs/reference/results.md, docs/explanation/comparison.md and docs/explanation/open-choices.md.
"""
