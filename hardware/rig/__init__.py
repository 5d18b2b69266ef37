"""A stage and a skin as one sensor that taps where it is told.

Start with `rig`; `settings` reads the rig's file, `open_rig` opens its devices, `check` tests them.
"""
