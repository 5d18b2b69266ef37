"""Stage and skin combined into one tapping sensor.

Start with `rig`; `settings` reads the rig's file, `open_rig` opens its devices, `check` tests them.
"""
