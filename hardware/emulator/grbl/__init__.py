"""Emulated GRBL controller: parser, planner, settings and reports.

Start with `controller`, then `firmware` and `processor`. It shares no code with the driver in `hardware.stage`, so
that each tests the other.
"""
