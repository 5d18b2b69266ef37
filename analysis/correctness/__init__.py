"""`crosscheck` and simulation-based calibration, which `validate` runs too.

Start at `report` (cross-check) and `sbc` (calibration). The comparison of one model is in `analysis.experiment`, as
`reproduce` runs it too.
"""
