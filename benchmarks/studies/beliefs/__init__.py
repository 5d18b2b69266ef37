"""Beliefs during episodes: calibration of the chain from fit to decision, and the answer "unknown".

`chain` updates docs/explanation/calibration.md, `unknown` docs/explanation/unknown-objects.md.
"""
