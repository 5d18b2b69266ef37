"""Sensors that perceive by tapping, real, simulated or replayed; all implement `sensor.TouchSensor`.

Start with `sensor`, then `replay` and `simulator`; `rig` puts `stage` and `skin` together over `link`, `emulator`
emulates the devices, `recording` collects taps, `named_rigs` opens each by name. Nothing here depends on beliefs.
"""
