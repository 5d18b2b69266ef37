"""Taps made of a model of touch: a finger, a skin and what disturbs both.

Start with `settings` and `physics`; `rig` is a sensor that taps, `session` a whole recording, `model_rig` draws taps
from a fitted model. Nothing here speaks to a port.
"""
