"""Whether classes are inferred without touch, from samples before contact, beside whole taps.

Start at `run`. No tests of dependence among taps: those are in `audit.dependence`.
"""
