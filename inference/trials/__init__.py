"""Many episodes on stored taps, and what varies when taps are drawn anew.

Start with `run`, which plays a `plan` by the compiled `kernel` or on a `gpu`; `lockstep` plays policies that look at
beliefs; `resampling` gives intervals. Random numbers belong to trial and tap, see `random`.
"""
