"""Beliefs while tapping: calibration of the chain from fit to decision, and objects that no class describes.

`chain` fills docs/explanation/calibration.md, `unknown` docs/explanation/unknown-objects.md.
"""
