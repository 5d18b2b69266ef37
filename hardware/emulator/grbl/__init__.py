"""A GRBL controller in software: its parser, planner, settings and reports.

Start with `controller`, then `firmware` and `processor`. It shares no code with the driver in `hardware.stage`, so that
one tests the other.
"""
