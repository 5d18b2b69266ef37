"""Devices on pseudo-terminals that answer as real ones do, with a switch for every fault that a bench produces.

Start with `emulated_bench`, then `finger`, `skin_board` and `grbl`. Drivers are tested against them, so no code of
theirs is shared beyond the simulated touch.
"""
