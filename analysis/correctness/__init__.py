"""Simulation-based calibration, the checks of `validate`, and the cross-check as printed.

Start at `validate`, then `sbc`. The cross-check itself is in `analysis.experiment`, as `reproduce` runs it too.
No recorded data: the truth must be known.
"""
