"""Measurement models: recovery of the true one, calibration of fits, gain of session models, plate diagrams.

All but `plates` fill docs/explanation/model-studies.md.
"""
