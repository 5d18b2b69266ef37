"""Measurement models: recovery of the true model, calibration of fits, gain of session models, plate diagrams.

All but `plates` update docs/explanation/model-studies.md.
"""
