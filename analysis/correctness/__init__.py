"""`crosscheck`, simulation-based calibration, and the checks of both that `validate` runs.

Start at `report` (cross-check) and `sbc` (calibration). The comparison of one model is in `analysis.experiment`, as
`reproduce` runs it too.
"""
