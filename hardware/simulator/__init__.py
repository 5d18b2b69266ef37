"""Simulated taps from a physical model of finger, skin and disturbances.

Start with `settings` and `physics`; `rig` is a sensor that taps, `session` a whole recording, `model_rig` draws taps
from a fitted model. Nothing here uses a port.
"""
