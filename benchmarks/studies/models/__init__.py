"""Measurement models: recovery, calibration of fits, gain of session models, draws of new sessions, plate diagrams.

All but `plates` update docs/explanation/model-studies.md.
"""
