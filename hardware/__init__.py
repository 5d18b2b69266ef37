"""Sensors that perception can tap with, real or not: all are a `sensor.TouchSensor`.

Start with `sensor`, then `replay` and `simulator`; `rig` puts `stage` and `skin` together over `link`, `emulator`
stands in for the devices, `recording` collects taps. Nothing here knows of belief.
"""
