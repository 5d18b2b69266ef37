"""Emulated devices on pseudo-terminals, with a switch for every fault seen on a bench.

Start with `emulated_bench`, then `finger`, `skin_board` and `grbl`. The drivers are tested against them, so the two
share no code except the simulated touch, and `shared_clock`, by which an emulated rig keeps time.
"""
